"""Feeding a control that the test plays, byte by byte as the manual has it and as it should not be."""

from __future__ import annotations

import asyncio
import hashlib
from itertools import product
from pathlib import Path
from typing import Final

import pytest

from tapewire.engine import Held, Outcome, Requested, Resumed, Violation
from tapewire.transfer.reports import Progress, Result
from tests.transfer.peer import DC1, DC3, NAK, SYN, Job, feeding

TEXT: Final = b"%\n" + b"".join(b"N%dG01X%d.Y-%d.\n" % (n, n, n) for n in range(1, 701)) + b"M30\n%"
WINDOW: Final = 510
"""Characters that may be on their way at the rate of these jobs."""

POSTING_OFF: Final = {"posting": "off"}


def complete(result: Result, text: bytes = TEXT) -> None:
    assert result.outcome is Outcome.COMPLETE, result.reason
    assert (result.bytes, result.bytes_handed) == (len(text), len(text))
    assert result.sha256 == hashlib.sha256(text).hexdigest()


def interrupted(result: Result, outcome: Outcome, reason: str, got: bytes) -> None:
    """It is not whole, and what the control has got lies between the two counts."""
    assert result.outcome is outcome, result.reason
    assert reason in result.reason
    assert result.bytes <= len(got) <= result.bytes_handed
    assert got == TEXT[: len(got)]
    assert result.sha256 == hashlib.sha256(TEXT[: result.bytes]).hexdigest()


async def test_it_waits_holds_and_goes_on_with_the_next_byte(tmp_path: Path) -> None:
    async with feeding(tmp_path, TEXT) as job:
        assert await job.peer.quiet() == 0, "nobody has asked yet"
        job.peer.say(DC1)
        await job.peer.read(8000)
        before = len(job.peer.got)
        job.peer.say(DC3)
        held = await job.peer.quiet()
        print(f"{held - before} characters came after DC3 over TCP, with a window of {WINDOW}")
        assert held - before <= 511
        assert await job.peer.quiet() == held, "it stays silent however long it takes"
        job.peer.say(DC1)
        await job.peer.read(len(TEXT))
        assert not job.work.done(), "the control has not said that it has read everything"
        job.peer.say(DC3)
        complete(await job.result())
        assert await job.peer.read_to_end() == TEXT
    assert len(job.named(Requested)) == 1
    assert len(job.named(Held)) == len(job.named(Resumed)) == 1
    assert any(progress.held for progress in job.named(Progress))


async def test_an_early_stop_with_posting_goes_on_with_the_next_byte(tmp_path: Path) -> None:
    async def one(cut: int) -> None:
        folder = tmp_path / str(cut)
        folder.mkdir()
        async with feeding(folder, TEXT) as job:
            job.peer.say(DC1)
            await job.peer.read(cut)
            job.peer.say(DC3)
            await job.peer.quiet()
            job.peer.say(DC1)
            await job.peer.read(len(TEXT))
            job.peer.say(DC3)
            complete(await job.result())
            assert job.peer.got == TEXT

    await asyncio.gather(*map(one, (0, 1, 100, 2000)))


@pytest.mark.parametrize("code", [b"\x13", b"\x93"])
async def test_an_early_stop_without_posting_and_er_may_be_a_reset(tmp_path: Path, code: bytes) -> None:
    async with feeding(tmp_path, TEXT, settings=POSTING_OFF) as job:
        job.peer.say(DC1)
        await job.peer.read(1500)
        job.peer.say(code)
        result = await job.result()
        job.peer.say(DC1)
        interrupted(result, Outcome.FAILED, "before the buffer can have filled", await job.peer.read_to_end())


async def test_a_second_stop_without_posting_may_be_a_reset(tmp_path: Path) -> None:
    async with feeding(tmp_path, TEXT, settings=POSTING_OFF) as job:
        job.peer.say(DC1)
        await job.peer.read(8000)
        job.peer.say(DC3)
        await job.peer.quiet()
        job.peer.say(DC3)
        result = await job.result()
        interrupted(result, Outcome.FAILED, "a second DC3", await job.peer.read_to_end())


@pytest.mark.parametrize(
    ("said", "outcome", "reason"),
    [
        (SYN, Outcome.CANCELLED, "reset (SYN)"),
        (b"\x16", Outcome.CANCELLED, "reset (SYN)"),
        (DC3 + SYN, Outcome.CANCELLED, "reset (SYN)"),
        (NAK, Outcome.FAILED, "alarm (NAK)"),
        (b"\x13\x15", Outcome.FAILED, "alarm (NAK)"),
    ],
)
async def test_what_the_control_posts_ends_the_job(tmp_path: Path, said: bytes, outcome: Outcome, reason: str) -> None:
    async with feeding(tmp_path, TEXT) as job:
        job.peer.say(DC1)
        await job.peer.read(5000)
        job.peer.say(said)
        result = await job.result()
        job.peer.say(DC1)
        interrupted(result, outcome, reason, await job.peer.read_to_end())


@pytest.mark.parametrize(("said", "outcome"), [(DC3 + SYN, Outcome.CANCELLED), (NAK, Outcome.FAILED)])
async def test_a_reset_after_the_last_byte_is_not_complete(tmp_path: Path, said: bytes, outcome: Outcome) -> None:
    async with feeding(tmp_path, TEXT) as job:
        job.peer.say(DC1)
        await job.peer.read(len(TEXT))
        job.peer.say(said)
        result = await job.result()
    assert result.outcome is outcome
    assert "not executed" in result.reason


async def act(job: Job, kind: str) -> None:
    match kind:
        case "hang up":
            job.peer.hang_up()
        case "vanish":
            await job.peer.vanish()
        case "reset":
            job.peer.say(DC3 + SYN)
        case "alarm":
            job.peer.say(NAK)
        case "give up":
            job.stop.set()
        case "hold, then give up":
            job.peer.say(DC3)
            await asyncio.sleep(0.2)
            job.stop.set()
        case _:
            raise AssertionError(kind)


KINDS: Final = ("hang up", "vanish", "reset", "alarm", "give up", "hold, then give up")
CUTS: Final = (0, 1, 50, WINDOW - 1, WINDOW + 1, 1000, 4097, 7680, len(TEXT) - 2 * WINDOW)


@pytest.mark.parametrize("kind", KINDS)
async def test_the_control_has_at_least_and_at_most_what_we_say(tmp_path: Path, kind: str) -> None:
    """However a job is cut short, and wherever."""

    async def cut_short(protocol: str, cut: int) -> None:
        folder = tmp_path / f"{protocol}-{cut}"
        folder.mkdir()
        async with feeding(folder, TEXT, protocol=protocol) as job:
            job.peer.say(DC1)
            await job.peer.read(cut)
            await act(job, kind)
            result = await job.result()
            if kind != "vanish":
                await job.peer.read_to_end()
            got = bytes(job.peer.got)
            assert result.outcome is not Outcome.COMPLETE, (cut, result)
            assert result.bytes <= len(got) <= result.bytes_handed, (cut, result)
            assert result.bytes_handed - result.bytes <= 8 * WINDOW, "a count that says nothing"
            assert got == TEXT[: len(got)]

    await asyncio.gather(*(cut_short(*case) for case in product(("fanuc-b", "fanuc-b-expansion"), CUTS)))


async def test_nobody_asks(tmp_path: Path) -> None:
    async with feeding(tmp_path, TEXT, timeout_s=0.3) as job:
        result = await job.result()
        assert (result.outcome, result.bytes_handed) == (Outcome.FAILED, 0)
        assert "0.3 s" in result.reason
        assert await job.peer.read_to_end() == b""


async def test_the_time_is_up_in_mid_transfer(tmp_path: Path) -> None:
    async with feeding(tmp_path, TEXT, timeout_s=0.6) as job:
        job.peer.say(DC1)
        result = await job.result()
        interrupted(result, Outcome.FAILED, "not complete within 0.6 s", await job.peer.read_to_end())
        assert result.bytes_handed > 0


async def test_noise_before_the_first_code_starts_nothing(tmp_path: Path) -> None:
    async with feeding(tmp_path, TEXT) as job:
        job.peer.say(b"\x00\x7f\x00")
        job.peer.say(b"#login: \xff\xfe")
        assert await job.peer.quiet() == 0
        job.peer.say(DC1)
        await job.peer.read(len(TEXT))
        job.peer.say(DC3)
        complete(await job.result())
        assert job.peer.got == TEXT
    assert job.named(Violation)


async def test_a_start_after_the_end_gets_nothing(tmp_path: Path) -> None:
    """The DC1 of a second reading must not be answered by a program that nobody armed for it (safety rule 1)."""
    async with feeding(tmp_path, TEXT, settings={"notice_time": "0.5", "closing_time": "0.5"}) as job:
        job.peer.say(DC1)
        await job.peer.read(len(TEXT))
        job.peer.say(DC3)
        await asyncio.sleep(0.2)
        job.peer.say(DC1)
        await asyncio.sleep(0.2)
        job.peer.say(DC3)
        complete(await job.result())
        assert await job.peer.read_to_end() == TEXT


async def test_a_level_stop_after_the_last_byte_is_not_yet_the_end(tmp_path: Path) -> None:
    async with feeding(tmp_path, TEXT, settings={"closing_time": "0.8"}) as job:
        job.peer.say(DC1)
        await job.peer.read(len(TEXT))
        job.peer.say(DC3)
        await asyncio.sleep(0.4)
        assert not job.work.done(), "it may have been a stop"
        job.peer.say(DC1)
        await asyncio.sleep(0.1)
        job.peer.say(DC3)
        complete(await job.result())


@pytest.mark.parametrize("posting", ["on", "off"])
async def test_a_line_that_is_closed_behind_the_last_stop_was_read_and_one_without_it_was_not(
    tmp_path: Path, posting: str
) -> None:
    async with feeding(tmp_path, TEXT, settings={"posting": posting}) as job:
        job.peer.say(DC1)
        await job.peer.read(len(TEXT))
        job.peer.say(DC3)
        job.peer.hang_up()
        complete(await job.result())
    async with feeding(tmp_path, TEXT, settings={"posting": posting}) as job:
        job.peer.say(DC1)
        await job.peer.read(len(TEXT))
        job.peer.hang_up()
        interrupted(await job.result(), Outcome.FAILED, "the line is gone", TEXT)
