"""What the protocols cannot detect by their own rules, by name, decided from what was really injected.

An excuse is as narrow as it can be made: it wants the damage that explains this very deviation, unseen by the UART, on
the wire and at the place where it matters. docs/simulator.md says in words what stands here.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from tapewire.codes import EOR_CODES
from tapewire.line.faults.plan import Wire
from tapewire.protocols.fanuc_a.packets import packet_bytes
from tapewire.sim.evidence import Attempt, Damage, Evidence
from tapewire.sim.frames import cancelled_sums, forged_records
from tapewire.sim.scenarios import Act, Direction, Scenario

__all__ = ["Excuses", "first_difference"]

_FANUC_B_CODES: Final = frozenset(b"\x11\x12\x13\x14\x15\x16\x93\x95\x96")
_BRIDGEPORT_ANSWERS: Final = frozenset(b"\x04\x06\x10\x11\x12\x13\x14\x15\x17")


def first_difference(got: bytes, program: bytes) -> int | None:
    """Where `got` is no beginning of `program` any more; None where it is one."""
    if program.startswith(got):
        return None
    return next((at for at, (one, other) in enumerate(zip(got, program, strict=False)) if one != other), len(program))


_BRIDGEPORT_NAME: Final = frozenset(b"0123456789;LD")

_MOST_AMBIGUOUS: Final = "more faults than a line can have and work"
_PULLED: Final = "characters in a pulled cable that nothing shows"


class Excuses:
    """For one transfer. Each method returns the name of what nobody could have detected, or nothing."""

    def __init__(self, scenario: Scenario, evidence: Evidence) -> None:
        self._scenario = scenario
        self._evidence = evidence
        self._sends = scenario.direction is Direction.SEND
        self._is_a = scenario.protocol.startswith("fanuc-a")
        self._is_b = scenario.protocol.startswith("fanuc-b")
        self._data_wire = Wire.FROM_HOST if self._sends else Wire.FROM_CONTROL
        self._frame = 4 if self._is_b else 20
        """Characters a place may be off by the codes between program and wire: DC2, DC3; DC2 again and a name."""
        self._linked = scenario.settings.cnc.get("mode", "D") == "D" and scenario.protocol == "bridgeport"

    # what happened, and would not have been noticed

    def _unseen(self, wire: Wire) -> list[Damage]:
        damages = self._evidence.unseen(wire)
        if self._scenario.settings.host.get("parity") == "software":
            # The engines check parity themselves: an odd number of bits turned is noticed.
            damages = [damage for damage in damages if not _odd(damage)]
        return damages

    def _program_damage(self, attempt: Attempt, until: int) -> Damage | None:
        """Unseen damage of the program's characters at or before byte `until` of an attempt."""
        before = attempt.place if self._sends else attempt.heard
        for damage in self._unseen(self._data_wire):
            is_before = not damage.place or damage.place - 1 - before <= until + self._frame
            if is_before and damage.moment >= attempt.began:
                return damage
        return None

    def _codes_hit(self, wire: Wire, codes: Iterable[int]) -> Damage | None:
        """Unseen damage that took one of `codes` away or made one."""
        wanted = frozenset(codes)
        for damage in self._unseen(wire):
            if wanted & (set(damage.sent) | set(damage.plain)):
                return damage
        return None

    @property
    def _pulled_unseen(self) -> bool:
        return any(damage.kind == "pulled cable" and damage.sent for damage in self._evidence.damages)

    @property
    def _dark_control(self) -> str:
        """What ended the control's operation and reached no host to which ER says nothing."""
        if self._scenario.has_signals and self._scenario.settings.host.get("er") != "hidden":
            return ""
        if self._evidence.happened("power cut: control"):
            return "a control whose loss of power nothing shows"
        if not self._is_a and self._evidence.kinds("pulled cable"):
            # SR855; and while DR is OFF neither SYN nor NAK is posted (6.1.2).
            return "an alarm of the control while its cable was pulled"
        return ""

    # the rules

    def content(self, attempt: Attempt | None, wrong: int) -> str:
        """Other bytes than the program's came through, from byte `wrong` on."""
        if self._evidence.too_many:
            return _MOST_AMBIGUOUS
        if attempt is None:
            return ""
        if self._is_a:
            return self._content_a(attempt, wrong)
        if self._linked and self._sends:
            return self._content_linked()
        damage = self._program_damage(attempt, wrong)
        return damage.name if damage is not None else ""

    def _content_a(self, attempt: Attempt, wrong: int) -> str:
        if not self._evidence.on(Wire.FROM_HOST):
            return ""
        if cancelled_sums(bytes(self._evidence.host.sent), bytes(self._evidence.cnc.brought), self._n):
            return "a sum of eight bits that cancels"
        return self._lost_packets(attempt, wrong)

    @property
    def _n(self) -> int:
        """Of the packets; 0 is protocol A."""
        return int(self._scenario.settings.host.get("n", "4")) if "expansion" in self._scenario.protocol else 0

    def _lost_packets(self, attempt: Attempt, wrong: int) -> str:
        """Whole packets are missing from byte `wrong` on, and no number shows it."""
        if not self._n:
            return ""
        data, program = packet_bytes(self._n) - 4, self._evidence.program
        gap = wrong - wrong % data
        rest = bytes(attempt.delivered[gap:])
        resumed = program.find(rest[:64], gap)
        if resumed > gap and (resumed - gap) % (10 * data) == 0:
            return "ten packets running lost: their numbers go round"
        if program.endswith(rest) and (len(program) - len(attempt.delivered)) % data == 0:
            return "a packet lost directly before the end packet"
        return ""

    def _content_linked(self) -> str:
        cnc = self._scenario.settings.cnc
        if forged_records(
            bytes(self._evidence.host.sent), bytes(self._evidence.cnc.brought), cnc.get("lrc", "xor7_etb")
        ):
            return "a check character of seven bits that cancels"
        if self._codes_hit(Wire.FROM_CONTROL, b"\x06\x15"):
            return "ACK or NAK lost or forged"
        return ""

    def short(self, attempt: Attempt | None) -> str:
        """Complete was said, and the program is not there whole."""
        if self._evidence.too_many:
            return _MOST_AMBIGUOUS
        if attempt is not None and self._is_a:
            wrong = first_difference(bytes(attempt.delivered), self._evidence.program)
            if wrong is not None and (excuse := self._content_a(attempt, wrong)):
                return excuse
        elif attempt is not None:
            damage = self._program_damage(attempt, len(self._evidence.program))
            if damage is not None:
                return damage.name
        if dark := self._dark_control:
            return dark
        if self._scenario.protocol == "bridgeport" and self._codes_hit(Wire.FROM_CONTROL, _BRIDGEPORT_NAME):
            return "a program name that came otherwise"
        return self.told_wrongly()

    def told_wrongly(self) -> str:
        """What the control said of itself came otherwise."""
        if self._is_b and self._codes_hit(Wire.FROM_CONTROL, _FANUC_B_CODES):
            return "a control code lost or forged"
        if self._scenario.protocol == "bridgeport" and self._codes_hit(Wire.FROM_CONTROL, _BRIDGEPORT_ANSWERS):
            return "a control code lost or forged"
        if self._is_a and cancelled_sums(bytes(self._evidence.cnc.sent), bytes(self._evidence.host.brought), 0):
            return "a sum of eight bits that cancels"
        return ""

    def less(self, attempts: list[Attempt]) -> str:
        """Fewer characters are with the control than the host holds for certain."""
        if self._evidence.too_many:
            return _MOST_AMBIGUOUS
        if attempts and not self._is_a:
            damage = self._program_damage(attempts[-1], len(self._evidence.program))
            if damage is not None:
                return damage.name
        if dark := self._dark_control:
            return dark
        if attempts and self._is_a:
            wrong = first_difference(bytes(attempts[-1].delivered), self._evidence.program)
            if wrong is not None and (lost := self._lost_packets(attempts[-1], wrong)):
                return lost
        if self._evidence.kinds("late stop"):
            return "a word of the control that is heard later than 100 ms"
        return self.told_wrongly()

    def more(self, attempts: list[Attempt]) -> str:
        """More characters are with the control than were handed over."""
        if self._evidence.too_many:
            return _MOST_AMBIGUOUS
        if attempts and not self._is_a:
            names = [damage.name for damage in self._unseen(Wire.FROM_HOST) if len(damage.plain) > len(damage.sent)]
            return names[0] if names else ""
        return ""

    def out_of_nothing(self, attempt: Attempt) -> str:
        """Something of a program that was not armed came."""
        for damage in self._unseen(Wire.FROM_HOST):
            if damage.moment >= attempt.began and not damage.place:
                return damage.name
        return ""

    def overrun(self) -> str:
        """Too many characters came after a stop, on a path that would have stopped."""
        if self._evidence.too_many:
            return _MOST_AMBIGUOUS
        damages = self._unseen(Wire.FROM_CONTROL) if self._is_b else self._evidence.on(Wire.FROM_CONTROL)
        if damages:
            # A host of protocol B stops at a damaged character too.
            return "a stop request lost, damaged or late"
        if self._evidence.kinds("late stop"):
            return "a stop request lost, damaged or late"
        return ""

    def waiting(self, who: str) -> str:
        """Nobody moves any more until a person does something."""
        if self._evidence.too_many:
            return _MOST_AMBIGUOUS
        if who == "control":
            return self._control_waits()
        return self._lost_the_thread()

    def _control_waits(self) -> str:
        """A control whose host has ended, or died, or never had anything, waits for its operator."""
        return "the host's job is over, and the control waits for RESET"

    def _lost_the_thread(self) -> str:
        evidence, settings = self._evidence, self._scenario.settings
        if self._is_a:
            return ""
        if dark := self._dark_control:
            return dark
        if self._is_b and settings.cnc.get("alarm") == "at-reset" and evidence.happened(Act.ALARM.value):
            return "an alarm that is told only at RESET (6.4 note 1)"
        if self._sends and evidence.moving and self._scenario.override is not None and evidence.unseen(Wire.FROM_HOST):
            return "a damaged block that takes hours"
        codes = _FANUC_B_CODES if self._is_b else _BRIDGEPORT_ANSWERS
        if any(codes & set(damage.sent) for damage in evidence.on(Wire.FROM_CONTROL)):
            return "a control code lost or damaged"
        if self._codes_hit(Wire.FROM_CONTROL, codes):
            return "a control code forged"
        if self._is_b and self._sends and self._codes_hit(Wire.FROM_HOST, EOR_CODES[settings.data]):
            return "an EOR lost or forged"
        return ""


def _odd(damage: Damage) -> bool:
    return any(byte.bit_count() % 2 for byte in damage.plain)
