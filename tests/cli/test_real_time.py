"""At the rate of a real line, by a control slower than it: nothing is lost, and little comes after DC3."""

from __future__ import annotations

import hashlib
import socket
from itertools import product
from typing import Final

from tests.cli.helpers import DEADLINE_S, Finished, Shop, program
from tests.cli.test_transfer import LINES, finish, identical, start

ALLOWED: Final = {"fanuc-b": 511, "fanuc-b-expansion": 1280}
"""Characters after DC3 that the control tolerates (B-63322EN-1 6.3, chapter 7)."""


def figures(finished: Finished) -> list[int]:
    return [int(event["count"]) for event in finished.named("after_dc3")]


SLOW_THEN_FAST: Final = (
    b"%\n" + b"G01X1.5Y2.\n" * 1250 + b"(THE CONTROL TAKES ITS TIME BY THE BLOCK)\n" * 150 + b"M30\n%"
)
"""Fills the buffer while the short blocks are executed, and is soon over when it comes to the long ones."""


def test_a_slow_control_is_never_overrun(shop: Shop) -> None:
    """Each protocol over TCP and over a pseudo terminal."""
    file = shop.file("in.nc", SLOW_THEN_FAST)
    most: dict[str, int] = {}
    runs = []
    for protocol, line in product(ALLOWED, (LINES[0], LINES[3])):
        saved, link = shop.folder / f"{protocol}-{line.kind}.nc", f"in-line-{protocol}"
        common: list[object] = ["--protocol", protocol, "--baud", "86400"]
        cnc = ["--save", saved, "--blocks-per-second", "280", *common]
        runs.append((protocol, line, saved, start(shop, line, host=["send", file, *common], cnc=cnc, link=link)))
    for protocol, line, saved, ends in runs:
        sent, taken = finish(*ends)
        identical(sent, taken, SLOW_THEN_FAST)
        assert saved.read_bytes() == SLOW_THEN_FAST
        assert sent.named("held")
        assert 0 <= len(sent.named("held")) - len(sent.named("resumed")) <= 1, "the last DC3 may be the closing one"
        print(f"{protocol}, {line}: after DC3 {figures(taken)}, allowed {ALLOWED[protocol]}")
        assert figures(taken)
        most[line.kind] = max(most.get(line.kind, 0), *figures(taken))
        assert max(figures(taken)) <= ALLOWED[protocol]
        assert {event["allowed"] for event in taken.named("after_dc3")} == {ALLOWED[protocol]}
        assert max(event["buffered"] for event in taken.named("progress")) > 4096
    assert all(most.values()), "something is on its way at most stops: nothing at any of them would be a blind count"


def test_protocol_a_and_expansion_a_at_the_rate_of_a_real_line(shop: Shop) -> None:
    """Over TCP and over a pseudo terminal at 86400, byte-identical."""
    file = shop.file("in.nc", SLOW_THEN_FAST)
    runs = []
    for protocol, line in product(("fanuc-a", "fanuc-a-expansion"), (LINES[0], LINES[3])):
        saved, link = shop.folder / f"{protocol}-{line.kind}.nc", f"in-line-{protocol}"
        common: list[object] = ["--protocol", protocol, "--baud", "86400"]
        ends = start(shop, line, host=["send", file, *common], cnc=["--save", saved, *common], link=link)
        runs.append((protocol, saved, ends))
    for _, saved, ends in runs:
        sent, taken = finish(*ends)
        identical(sent, taken, SLOW_THEN_FAST)
        assert saved.read_bytes() == SLOW_THEN_FAST


def test_a_host_that_does_not_stop_is_found_out(shop: Shop) -> None:
    """The counter-proof: without it the counts above might be small because nobody looks."""
    listen = ("--line", "listen://127.0.0.1:0", "--baud", "86400", "--json", "--set", "code=ascii")
    controls = {name: shop.start("cnc", *listen, "--blocks-per-second", "10", "--protocol", name) for name in ALLOWED}
    for protocol, cnc in controls.items():
        with socket.create_connection(("127.0.0.1", cnc.port), DEADLINE_S) as host:
            assert host.recv(1) == b"\x11"
            host.sendall(b"%\n" + b"G01X1.Y2.Z3.\n" * 1000)
            assert host.recv(1) == b"\x13"
            host.sendall(b"X" * 2000)
            taken = cnc.finish()
        assert taken.outcome == (1, "failed")
        assert "SR856" in taken.end["reason"]
        assert "SR856" in taken.stderr
        assert [event["number"] for event in taken.named("alarm")] == ["SR856"]
        assert taken.end["bytes"] <= taken.end["bytes_handed"] <= 8192 + taken.end["bytes"]
        print(f"{protocol}: after DC3 {figures(taken)}, allowed {ALLOWED[protocol]}")
        if protocol == "fanuc-b-expansion":
            assert figures(taken) == [ALLOWED[protocol] + 1]
        else:
            # What came before the DC3 had left counts for the buffer, which is full at the same 512.
            assert "full" in taken.end["reason"] or figures(taken) == [ALLOWED[protocol] + 1]


def test_the_hash_of_the_end_event_can_differ(shop: Shop) -> None:
    """Neither end takes the other's word for it: a byte that changes on the way shows."""
    cnc = shop.start("cnc", "--line", "listen://127.0.0.1:0", "--protocol", "fanuc-b", "--json")
    text = program(3)
    with socket.create_connection(("127.0.0.1", cnc.port), DEADLINE_S) as host:
        assert host.recv(1) == b"\x11"
        host.sendall(text.replace(b"N2", b"N3"))
        taken = cnc.finish()
    assert taken.outcome == (0, "complete")
    assert taken.end["bytes"] == len(text)
    assert taken.end["sha256"] != hashlib.sha256(text).hexdigest()
