"""What the packets of expansion protocol A do not show: a number comes round every ten, and the end packet has none.

For `undetectable.py`. `n` is that of the packets (5.2); 0 is protocol A, which has none.
"""

from __future__ import annotations

from typing import Final

from tapewire.line.faults.plan import Wire
from tapewire.protocols.fanuc_a.packets import END_NUMBER, NUMBERS, Monitor, packet_bytes
from tapewire.sim.evidence import Attempt, Damage, Evidence, Job
from tapewire.sim.frames import ends_with_nak, is_monitor, right_packet, says_nak
from tapewire.sim.names import Undetectable
from tapewire.sim.scenarios import Scenario

__all__ = ["lost_packets", "never_repeated", "packets_n", "went_round"]


MOST_TAKEN: Final = 1
"""Packets of the next round that came before the line went dead again."""


def packets_n(scenario: Scenario) -> int:
    """256 n bytes of program are in a packet; 0 is protocol A, which has none."""
    return int(scenario.settings.host.get("n", "4")) if "expansion" in scenario.protocol else 0


def lost_packets(evidence: Evidence, n: int, attempt: Attempt, wrong: int) -> str:
    """Whole packets are missing from byte `wrong` on, and no number shows it: all their characters are gone, or the NAK
    that asked for them.
    """
    if not n:
        return ""
    length, program = packet_bytes(n), evidence.expected
    data, lost = length - 4, _lost(_of_host(evidence, attempt))
    unheard = any(damage.moment >= attempt.began for damage in evidence.on(Wire.FROM_CONTROL))
    gap = wrong - wrong % data
    rest = bytes(attempt.delivered[gap:])
    resumed = program.find(rest[:64], gap)
    skipped = (resumed - gap) // data
    round_trip = resumed > gap and (resumed - gap) % (10 * data) == 0
    # The first one need not be gone whole: it is asked for by its number, and another bears that by then. Nor need the
    # last one: its rest, behind what was lost, is no packet.
    if round_trip and (unheard or lost > (skipped - 2) * length):
        return Undetectable.TEN_PACKETS
    missing = len(program) - len(attempt.delivered)
    if program.endswith(rest) and missing % data == 0 and lost // length * data >= missing:
        return Undetectable.LAST_PACKET
    return ""


def went_round(evidence: Evidence, n: int, attempt: Attempt, job: Job, missing: int) -> bool:
    """The last NAK was for the packet ten, or twenty, before the one that its host takes it for, and nothing that was
    sent again came, or not well, and CAN followed: `missing` bytes count as certain that are not there. Or one
    packet came before the line went dead again: it bore the right number, and was the packet ten behind.
    """
    if not n:
        return False
    length = packet_bytes(n)
    packets, rest = divmod(missing, length - 4)
    taken = -packets % 10
    whole_rounds = packets > 0 and not rest and taken <= MOST_TAKEN
    wanted = (attempt.got // (length - 4) - taken) % 10
    until = min((other.heard for other in evidence.attempts if other.began > attempt.began), default=None)
    said = bytes(evidence.cnc.sent[attempt.heard : until])
    asked = says_nak(said, wanted) if taken else ends_with_nak(said, wanted)
    lost = _lost([damage for damage in _of_host(evidence, attempt) if job.covers(damage.moment)])
    # Of what was lost, up to two packets are in the bad ones for which it asked.
    return whole_rounds and asked and lost > (packets + taken - 2) * length


def never_repeated(evidence: Evidence, n: int, damage: Damage) -> bool:
    """It hit what nobody says again by the rules of the packets, though its sum shows it.

    DC1: the host waits for a monitor packet, and a control that has said DC1 waits for a packet (5.3 4)). And what
    makes the control pass over a good end packet, as one that was under way behind a bad effective packet would be
    (5.2 2)): the number of the end packet itself, or an invalid packet before it, which may have been either,
    where nothing but other invalid ones stand between.
    """
    if not n or not damage.place:
        return False
    if damage.wire is Wire.FROM_CONTROL:
        return _was_restart(bytes(evidence.cnc.sent), damage.place - 1)
    sent, length = bytes(evidence.host.sent), packet_bytes(n)
    start = _start_of_packet(sent, length, damage.place - 1)
    if start is None:
        return False
    if sent[start] == END_NUMBER:
        return start == damage.place - 1
    while start < len(sent) and sent[start] not in NUMBERS and right_packet(sent[start : start + length], length):
        if sent[start] == END_NUMBER:
            return True
        start += length
    return False


def _start_of_packet(sent: bytes, length: int, at: int) -> int | None:
    """Of the data packet to which the character `at` belongs."""
    starts = range(max(0, at - length + 1), at + 1)
    return next((start for start in starts if right_packet(sent[start : start + length], length)), None)


def _was_restart(sent: bytes, at: int) -> bool:
    """The character `at` of what the control said belongs to DC1."""
    packets = (sent[start : start + 5] for start in range(max(0, at - 4), at + 1))
    return any(len(packet) == 5 and packet[0] & 0x7F == Monitor.DC1.value and is_monitor(packet) for packet in packets)


def _of_host(evidence: Evidence, attempt: Attempt) -> list[Damage]:
    """Since the attempt began."""
    return [damage for damage in evidence.on(Wire.FROM_HOST) if damage.moment >= attempt.began]


def _lost(damages: list[Damage]) -> int:
    """Characters that did not arrive."""
    return sum(max(0, len(damage.sent) - len(damage.plain)) for damage in damages)
