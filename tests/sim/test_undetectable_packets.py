"""What excuses packets of expansion protocol A that are missing, and what does not."""

from __future__ import annotations

import pytest

from tapewire.sim.undetectable import first_difference
from tests.sim.test_undetectable import case


def test_whole_packets_are_excused_where_so_many_characters_were_lost() -> None:
    evidence, excuses = case("fanuc-a-expansion", sent=bytes(1000), arrived=())
    evidence.program = evidence.expected = bytes(range(33, 97)) * 48 + b"%"
    attempt = evidence.attempts[0]
    attempt.delivered[:] = evidence.expected[1024:]
    assert excuses.content(attempt, 0, bytes(attempt.delivered)) == "", "a thousand characters are no packet of 1028"


@pytest.mark.parametrize(("lost", "excused"), [(9 * 1028, False), (9 * 1028 + 1, True)])
def test_ten_packets_are_skipped_where_nine_are_gone_whole_and_one_in_part(lost: int, excused: bool) -> None:
    """The tenth is asked for by its number, and that is the number of the packet behind them by then."""
    evidence, excuses = case("fanuc-a-expansion", sent=bytes(lost), arrived=())
    evidence.program = evidence.expected = b"".join(b"N%d X%d\n" % (line, line) for line in range(4000)) + b"%"
    attempt = evidence.attempts[0]
    attempt.delivered[:] = evidence.expected[:1024] + evidence.expected[11 * 1024 :]
    wrong = first_difference(bytes(attempt.delivered), evidence.expected)
    assert wrong is not None
    assert bool(excuses.content(attempt, wrong, bytes(attempt.delivered))) is excused


@pytest.mark.parametrize(
    ("missing", "lost", "nak", "excused"),
    [
        (10 * 1024, 9 * 1028 + 1, b"\x1584D\r", True),
        (10 * 1024, 9 * 1028, b"\x1584D\r", False),
        (10 * 1024, 9 * 1028 + 1, b"\x1594E\r", False),
        (10 * 1024, 9 * 1028 + 1, b"\x1584D\r\x11 31\r", False),
        (10 * 1024, 9 * 1028 + 1, b"", False),
        (9 * 1024, 9 * 1028 + 1, b"\x1584D\r", False),
        (10 * 1024 - 1, 9 * 1028 + 1, b"\x1584D\r", False),
        (10 * 1024, 9 * 1028 + 1, b"\x1584D\r\x18 38\r", True),
    ],
)
def test_a_nak_for_the_packet_ten_before(missing: int, lost: int, nak: bytes, excused: bool) -> None:
    """5.3: eight packets are there, and the NAK is for packet 38; its host takes that for the one behind the gap, and
    nothing comes of it.
    """
    evidence, excuses = case("fanuc-a-expansion", sent=bytes(lost), arrived=())
    evidence.program = evidence.expected = b"".join(b"N%d X%d\n" % (line, line) for line in range(4000)) + b"%"
    attempt = evidence.attempts[0]
    attempt.delivered[:] = evidence.expected[: 8 * 1024]
    attempt.got = 8 * 1024
    evidence.cnc.sent += nak
    assert bool(excuses.less(evidence.attempts, evidence.jobs[0], missing)) is excused
