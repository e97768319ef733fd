"""What a guided session does at each step, and what it concludes from what the control says.

    step 1   program -1           DC1 alone: read_request
    step 2   a save               open_write, what answers it, name_end, what ends a program
    step 3   a load by number     read_request, text_end
    step 4   a load, cancelled    cancel and the other half of its pair
    step 5   DNC LINK             first_record, lrc, dnc_end

Whether the control has taken an end is on its display and not on the line. So the person is told to cancel where it has
not, and no cancel within `VERDICT_LIMIT` says that it has.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Final, TypeAlias

from tapewire.codes import CR, DEL, LF, NUL, name_of
from tapewire.engine import MILLISECOND, SECOND, Nanos
from tapewire.protocols.bridgeport.code_table import SEVEN_BITS, SPACE, hex_of
from tapewire.protocols.bridgeport.messages import FirstRecord, Params
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd, Lrc, encode_record

__all__ = ["PROGRAM", "STEP_LIMIT", "VERDICT_LIMIT", "Listen", "Script", "Steps", "in_words", "is_code"]

PROGRAM: Final = b"N10G90\r\nN20M2\r\n"
"""Absolute dimensions, end of program: nothing moves. No two candidates agree on its check character."""

IDLE_LINES: Final = b"N10G90\r\n" * 1000
"""What is there to be cancelled: 8,000 characters, and no end behind them."""

STEP_LIMIT: Final[Nanos] = 300 * SECOND
"""How long the person has for a step."""

VERDICT_LIMIT: Final[Nanos] = 30 * SECOND
"""How long the person has to look at the display and to cancel what the control has not taken."""

QUIET: Final[Nanos] = SECOND
"""What the control says in one go has no longer gaps: 27 characters at 300 baud."""

OPENING_QUIET: Final[Nanos] = 100 * MILLISECOND
"""After its first code the control waits for an answer."""

REPEAT_LIMIT: Final[Nanos] = 6 * SECOND
"""Whether the control says its first code again, which is expected every three seconds."""

ANSWER_LIMIT: Final[Nanos] = 3 * SECOND
"""A control that has not talked by then was not answered rightly."""

RECORD_LIMIT: Final[Nanos] = 10 * SECOND
"""For the answer to a record."""

TRIES: Final = 2
"""The second NAK speaks against a candidate, the first may have been a disturbance."""

_READY: Final = (0x11, 0x06)
"""What may make a control talk after its first code, the likelier first."""

_TEXT_ENDS: Final = (0x04, 0x03)
"""What may end a text, the likelier first."""

_DNC_ENDS: Final = (DncEnd.EOT_ON_ACK, DncEnd.ETX_LAST, DncEnd.EMPTY_THEN_EOT, DncEnd.EOT_AFTER_LRC)

_NAME: Final = re.compile(rb"\d{1,6};[LD]")
_BETWEEN: Final = bytes((NUL, DEL, CR, LF))


@dataclass(frozen=True, slots=True, kw_only=True)
class Listen:
    """Say `say`, then listen: until something has come and `quiet` has passed, or nothing has come for `limit`."""

    say: bytes = b""
    limit: Nanos
    quiet: Nanos = QUIET


Script: TypeAlias = Generator[Listen, bytes, None]
_Verdict: TypeAlias = Generator[Listen, bytes, bool]


class Steps:
    """The script of a session. `seen` holds what the control has shown, as words for `--set`."""

    def __init__(self, params: Params, tell: Callable[[str], None]) -> None:
        self._params = params
        self._tell = tell
        self._repeats_asked = False
        self._save_ends = b""
        self.now: Nanos = 0
        self.seen: dict[str, str] = {}

    def script(self) -> Script:
        """Yields what to say and how long to listen, and is sent what was heard."""
        steps = (
            ("ask for program -1, which is taken as from a tape reader", self._dumb),
            ("save any short program as 1234", self._save),
            ("ask for program 1234 by REMOTE LOAD", self._load),
            ("ask for program 1234 by REMOTE LOAD again, and cancel while it comes in", self._cancel),
            ("ask for program 1234 by DNC LINK", self._link),
        )
        for number, (what, step) in enumerate(steps, 1):
            self._tell(f"step {number} of {len(steps)}: at the control, {what}")
            yield from step(what)
            self._tell(f"step {number} is over; bring the control back to rest")
            yield Listen(limit=ANSWER_LIMIT)

    # the steps

    def _dumb(self, what: str) -> Script:
        first = yield from self._opening(QUIET)
        if len(first) != 1:
            self._missed("one code")
            return
        self._note("read_request", first)
        yield Listen(say=PROGRAM + self._end_code, limit=ANSWER_LIMIT)

    def _save(self, what: str) -> Script:
        behind = yield from self._name()
        if behind is None:
            return
        self._note("name_end", behind[:-1])
        text = yield Listen(say=bytes([self._code("write_ready")]), limit=ANSWER_LIMIT)
        ends = _codes(text)
        if len(text) - len(ends) < 3 or not 1 <= len(ends) <= 2:
            self._missed("a program and one or two codes behind it")
            return
        self._save_ends = ends
        self._note_ends(self._params.text_end if self._params.text_end in ends else ends[0])
        self._tell(f"its lines end with {'CR LF' if bytes((CR, LF)) in text else 'no CR LF'}")

    def _load(self, what: str) -> Script:
        """1.2.1 line 3. What ends a program it saves need not end one it loads, or not in that order."""
        for attempt, end in enumerate(self._likely_text_ends()):
            if attempt:
                yield from self._once_more(what)
            behind = yield from self._name()
            if behind is None:
                return
            self._note("name_end", behind[:-1])
            self._note("read_request", behind[-1:])
            if (yield from self._taken(PROGRAM + bytes([end]), f"text_end={end:02X}")):
                self._note_ends(end)
                return
        self._tell("no end was taken; text_end stays as it is")

    def _likely_text_ends(self) -> list[int]:
        ends = self._save_ends
        return list(dict.fromkeys([*(end for end in _TEXT_ENDS if end in ends), *ends, *_TEXT_ENDS]))

    def _note_ends(self, text_end: int) -> None:
        """`text_end` ends a text; what else ends a program the control saves goes with it as what closes it."""
        self._note("text_end", bytes([text_end]))
        if closing := self._save_ends.replace(bytes([text_end]), b""):
            self._note("write_close", closing[:1])

    def _cancel(self, what: str) -> Script:
        if (yield from self._name()) is None:
            return
        pair = _codes((yield Listen(say=IDLE_LINES, limit=STEP_LIMIT)))
        if not 1 <= len(pair) <= 2:
            self._missed("one or two codes")
            return
        usual = self._params.cancel
        self._note("cancel", bytes([usual if usual in pair else pair[-1]]))
        self._note("cancel_tail", bytes(sorted({*self._params.cancel_tail, *pair})))

    def _link(self, what: str) -> Script:
        for attempt, end in enumerate(_DNC_ENDS):
            if attempt:
                yield from self._once_more(what)
            behind = yield from self._name()
            if behind is None:
                return
            self._note_first_record(behind)
            if (taken := (yield from self._linked(end))) is None:
                return
            if taken:
                self.seen["dnc_end"] = end
                return
        self._tell("no end of a DNC LINK file was taken; dnc_end stays as it is")

    def _note_first_record(self, behind: bytes) -> None:
        """A control that wants to ask for the first record too says ACK behind its request."""
        on_ack = len(behind) > 2 and behind[-1] == self._params.ack
        self.seen["first_record"] = FirstRecord.ON_ACK if on_ack else FirstRecord.AT_ONCE
        request = len(behind) - 2 if on_ack else len(behind) - 1
        self._note("name_end", behind[:request])
        self._note("read_request", behind[request : request + 1])

    def _linked(self, end: DncEnd) -> Generator[Listen, bytes, bool | None]:
        """One program by DNC LINK with this end: whether it was taken; None where no record was."""
        etx = end is DncEnd.ETX_LAST
        end_code = self._last_code if etx else self._params.rec_end
        appended = self._end_code if end is DncEnd.EOT_AFTER_LRC else b""
        lrc = yield from self._lrc(end_code, appended)
        if lrc is None:
            if "lrc" not in self.seen:
                self._missed("ACK, whatever the check character")
                return None
            self._tell(f"the control does not take dnc_end={end}")
            return False
        self.seen["lrc"] = lrc
        self._note("rec_end_last" if etx else "rec_end", bytes([end_code]))
        if end is DncEnd.EMPTY_THEN_EOT:
            answer = yield Listen(say=encode_record(b"", end_code, lrc), limit=RECORD_LIMIT, quiet=OPENING_QUIET)
            if answer != bytes([self._params.ack]):
                return False
        return (yield from self._taken(self._end_code if not appended else b"", f"dnc_end={end}"))

    def _lrc(self, end_code: int, appended: bytes) -> Generator[Listen, bytes, Lrc | None]:
        params = self._params
        candidates = (Lrc(self.seen["lrc"]),) if "lrc" in self.seen else LRC_CANDIDATES
        for lrc in candidates:
            for _ in range(TRIES):
                record = encode_record(PROGRAM, end_code, lrc) + appended
                answer = yield Listen(say=record, limit=RECORD_LIMIT, quiet=OPENING_QUIET)
                if answer == bytes([params.ack]):
                    if "lrc" not in self.seen:
                        self._tell(f"the control takes lrc={lrc}")
                    self._note("ack", answer)
                    return lrc
                if answer != bytes([params.nak]):
                    return None
                self._note("nak", answer)
        return None

    # what several steps do

    def _taken(self, say: bytes, what: str) -> _Verdict:
        """Say the end, and let the person judge."""
        self._tell(
            f"trying {what}: if the control says that the program is in, do nothing; if it still waits, or shows an "
            f"error, cancel there within {VERDICT_LIMIT // SECOND} s"
        )
        said = _codes((yield Listen(say=say, limit=VERDICT_LIMIT)))
        taken = not said.replace(bytes([self._params.ack]), b"")
        self._tell(f"{what} was {'not refused' if taken else 'refused'}")
        return taken

    def _once_more(self, what: str) -> Script:
        self._tell("bring the control back to rest")
        yield Listen(limit=ANSWER_LIMIT)
        self._tell(f"once more: at the control, {what.removesuffix(' again')}")

    def _opening(self, quiet: Nanos) -> Generator[Listen, bytes, bytes]:
        """What the control begins with. A cancel of what went before is no beginning."""
        cancel = {self._code("cancel"), self._params.xoff, *self._params.cancel_tail}
        while said := (yield Listen(limit=STEP_LIMIT, quiet=quiet)):
            if codes := _codes(said).lstrip(bytes(cancel)):
                return codes
        return b""

    def _name(self) -> Generator[Listen, bytes, bytes | None]:
        """1.1: the codes behind the name, of which the last is a request, or in a save the next opening."""
        opening = (yield from self._opening(OPENING_QUIET))[:1]
        if not opening:
            self._missed("a code")
            return None
        if not self._repeats_asked:
            yield from self._repeat(opening)
        said = yield from self._answered(opening)
        name = _NAME.search(said)
        if name is None:
            self._missed("a name as 1234;L")
            return None
        behind = said[name.end() :]
        if len(_codes(behind)) == 1:
            behind += yield Listen(limit=ANSWER_LIMIT)
        codes = _codes(behind)
        if len(codes) < 2:
            self._missed("the end of the name and a code behind it")
            return None
        self._note("open_write", opening)
        return codes

    def _repeat(self, opening: bytes) -> Script:
        self._repeats_asked = True
        began = self.now - OPENING_QUIET
        again = yield Listen(limit=REPEAT_LIMIT, quiet=0)
        if again[:1] == opening:
            self._tell(f"it says that again after {(self.now - began) / SECOND:.1f} s without an answer")

    def _answered(self, opening: bytes) -> Generator[Listen, bytes, bytes]:
        """Answer until the control says digits."""
        for ready in dict.fromkeys((self._code("write_ready"), *_READY)):
            said = yield Listen(say=bytes([ready]), limit=ANSWER_LIMIT)
            said = said.lstrip(opening)
            if said:
                self._note("write_ready", bytes([ready]))
                return said
        return b""

    def _note(self, key: str, codes: bytes) -> None:
        unique = dict.fromkeys(codes)
        self.seen[key] = hex_of(sorted(unique) if key == "name_end" else unique)

    def _code(self, key: str) -> int:
        word = self.seen.get(key)
        code: int = int(word, 16) if word else getattr(self._params, key)
        return code

    @property
    def _last_code(self) -> int:
        """ETX; where that has shown itself to end texts, EOT, its only neighbour that is free."""
        usual = self._params.rec_end_last
        return usual if usual != self._code("text_end") else _TEXT_ENDS[0]

    @property
    def _end_code(self) -> bytes:
        return bytes([self._code("text_end")])

    def _missed(self, what: str) -> None:
        self._tell(f"{what} was expected and did not come: this step is left out")


def _codes(said: bytes) -> bytes:
    """The control codes in what was said."""
    return bytes(byte for byte in said if is_code(byte))


def is_code(character: int) -> bool:
    """No text, no line end, no blank tape."""
    return character < SPACE and character not in _BETWEEN


def in_words(said: bytes) -> str:
    """The first of what was said, in hexadecimal and by name."""
    shown = " ".join(chr(byte) if SPACE < byte < SEVEN_BITS else name_of(byte).split()[0] for byte in said[:40])
    return f"{hex_of(said[:40])}{' ...' if len(said) > 40 else ''} ({shown})"
