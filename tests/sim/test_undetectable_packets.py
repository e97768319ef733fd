"""What excuses packets of expansion protocol A that are missing, and what does not."""

from __future__ import annotations

import pytest

from tapewire.line.faults.plan import Wire
from tapewire.protocols.fanuc_a.packets import Monitor, encode_monitor, encode_packet
from tapewire.sim.evidence import Damage, Evidence
from tapewire.sim.undetectable import first_difference
from tapewire.sim.unnumbered import never_repeated
from tests.sim.test_undetectable import case


def test_whole_packets_are_excused_where_so_many_characters_were_lost() -> None:
    evidence, excuses = case("fanuc-a-expansion", sent=bytes(1000), arrived=())
    evidence.program = evidence.expected = bytes(range(33, 97)) * 48 + b"%"
    attempt = evidence.attempts[0]
    attempt.delivered[:] = evidence.expected[1024:]
    assert excuses.content(attempt, 0, bytes(attempt.delivered)) == "", "a thousand characters are no packet of 1028"


@pytest.mark.parametrize(("lost", "excused"), [(8 * 1028, False), (8 * 1028 + 1, True)])
def test_ten_packets_are_skipped_where_eight_are_gone_whole_and_two_in_part(lost: int, excused: bool) -> None:
    """The first is asked for by its number, and that is the number of the packet behind them by then; the rest of the
    last is no packet.
    """
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
        (10 * 1024, 8 * 1028 + 1, b"\x1584D\r", True),
        (10 * 1024, 8 * 1028, b"\x1584D\r", False),
        (10 * 1024, 9 * 1028 + 1, b"\x1594E\r", False),
        (10 * 1024, 9 * 1028 + 1, b"\x1584D\r\x11 31\r", False),
        (10 * 1024, 9 * 1028 + 1, b"", False),
        (9 * 1024, 9 * 1028 + 1, b"\x1584D\r", False),
        (9 * 1024, 8 * 1028 + 1, b"\x1574C\r\x93 B3\r", True),
        (9 * 1024, 8 * 1028, b"\x1574C\r\x93 B3\r", False),
        (9 * 1024, 8 * 1028 + 1, b"\x1574C\r", True),
        (8 * 1024, 20 * 1028, b"\x1564B\r", False),
        (1024, 20 * 1028, b"\x1594E\r", False),
        (10 * 1024 - 1, 9 * 1028 + 1, b"\x1584D\r", False),
        (10 * 1024, 9 * 1028 + 1, b"\x1584D\r\x18 38\r", True),
        (10 * 1024, 9 * 1028 + 1, b"\x95\xb84\xc4\x8d", True),
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


LONE_END = encode_packet(0xFF, b"%\nO1\nM30\n%".ljust(256), 1)
EFFECTIVE = encode_packet(0x30, b"N1 X1\n".ljust(256), 1)
INVALID = encode_packet(0x00, bytes(256), 1)
SET = b"0CSET\r"


@pytest.mark.parametrize(
    ("before", "hit", "behind", "at", "never"),
    [
        (SET, LONE_END, b"", 0, True),
        (SET, LONE_END, b"", 1, False),
        (SET, LONE_END, b"", 258, False),
        (SET + EFFECTIVE, LONE_END, b"", 0, True),
        (SET, EFFECTIVE, LONE_END, 0, False),
        (SET, EFFECTIVE, LONE_END, 100, False),
        (SET, INVALID, LONE_END, 100, True),
        (SET, INVALID, INVALID + LONE_END, 0, True),
        (SET, INVALID, EFFECTIVE + LONE_END, 100, False),
        (SET, INVALID, b"", 100, False),
        (b"", SET, LONE_END, 3, False),
    ],
)
def test_what_makes_the_control_pass_over_a_good_end_packet(
    before: bytes, hit: bytes, behind: bytes, at: int, never: bool
) -> None:
    """5.2 2): behind a bad packet that may have been an effective one, FFh is stale, and nothing draws it again."""
    evidence = Evidence(program=b"%", expected=b"%")
    evidence.host.sent += before + hit + behind
    seen = Damage(0, "bit flip", Wire.FROM_HOST, len(before) + at + 1, hit[at : at + 1], (b"?",))
    assert never_repeated(evidence, 1, seen) is never
    assert not never_repeated(evidence, 0, seen), "protocol A has no packets"


@pytest.mark.parametrize(("monitor", "never"), [(Monitor.DC1, True), (Monitor.DC3, False), (Monitor.CAN, False)])
@pytest.mark.parametrize("at", range(5))
def test_a_dc1_is_said_once(monitor: Monitor, never: bool, at: int) -> None:
    evidence = Evidence(program=b"%", expected=b"%")
    said = encode_monitor(monitor)
    evidence.cnc.sent += b"ECGTD\r" + said + b"ECGTD\r"
    hit = Damage(0, "bit flip", Wire.FROM_CONTROL, 7 + at, said[at : at + 1], (b"?",))
    assert never_repeated(evidence, 1, hit) is never
