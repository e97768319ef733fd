"""The REMOTE's end of Bridgeport REMOTE LOAD and DNC LINK: the host computer.

    cnc   DC2                       it wants to say a name
    host  DC1
    cnc   77;D DC4
    cnc   DC1                       send me the program
    host  text ETB LRC              a record
    cnc   ACK                       the next one, please; NAK: that one again
    host  text ETB LRC
    cnc   ACK
    host  EOT                       there is no more

DC1 means "go ahead", "send me the program" and "go on"; which of them, the state says. A program is only sent to a
request for it, only when somebody has armed one, and a DC1 that may be a late "go on" is not taken for a request.
"""

from __future__ import annotations

from typing import Final

from tapewire.codes import with_even_parity
from tapewire.engine import (
    ALL_ON,
    Closure,
    Event,
    Held,
    LineFault,
    Nanos,
    Notice,
    Outcome,
    Requested,
    Resumed,
    SignalsIn,
    SignalsOut,
    Violation,
)
from tapewire.protocols.bridgeport.code_table import SEVEN_BITS
from tapewire.protocols.bridgeport.host_job import AGAIN, ASK_AGAIN
from tapewire.protocols.bridgeport.host_law import (
    LAW,
    SENDING,
    Heard,
    State,
    Timer,
    heard_at_rest,
    heard_while_receiving,
    heard_while_sending,
)
from tapewire.protocols.bridgeport.host_reception import FEED, Reception, marks_of
from tapewire.protocols.bridgeport.host_sending import Sending
from tapewire.protocols.bridgeport.messages import STOP_CHARACTERS, ErLine, Name, Params, Parity, on_the_wire
from tapewire.protocols.bridgeport.text import TEXT
from tapewire.protocols.settings import Switch

__all__ = ["LAW", "BridgeportHost", "State"]

_SEVEN_BITS: Final = bytes(byte & SEVEN_BITS for byte in range(256))
_ODD_WEIGHT: Final = frozenset(byte for byte in range(256) if with_even_parity(byte & SEVEN_BITS) != byte)


class BridgeportHost(Sending):
    """A host computer on REMOTE LOAD and DNC LINK. A HostEngine.

    When a job does not end complete, `Ended.bytes_low` are, in DNC LINK, the bytes of the records that the control
    acknowledged; in REMOTE LOAD, which acknowledges nothing, what had left before it can have said what it said last.
    """

    def __init__(self, params: Params) -> None:
        super().__init__(params)
        self._marks = marks_of(params)
        self._cts = True
        self._er = False

    @property
    def needs_stop_distance(self) -> int:
        """3.2."""
        return STOP_CHARACTERS

    # from the line

    def receive_data(self, data: bytes, now: Nanos) -> None:
        if self._params.parity is Parity.LINE:
            self._receive(data.translate(_SEVEN_BITS), now)
            return
        begun = 0
        for position, byte in enumerate(data):
            if byte in _ODD_WEIGHT:
                self._receive(data[begun:position].translate(_SEVEN_BITS), now)
                self.receive_line_fault(LineFault.PARITY, byte, now)
                begun = position + 1
        self._receive(data[begun:].translate(_SEVEN_BITS), now)

    def receive_line_fault(self, fault: LineFault, byte: int | None, now: Nanos) -> None:
        """A damaged character is obeyed as no code: one wrong bit makes DC1 of DLE."""
        self._events.put(Violation(what=f"{fault} in what the control sent"))
        if self._state is State.RECEIVING:
            assert self._reception is not None
            self._reception.line_fault(fault, None if byte is None else byte & SEVEN_BITS)
            self._note_received(now)
        elif self._more_to_send:
            self._on_fault_while_sending(fault, now)
        else:
            self._doubt(fault, now)
            self._doubt_head(fault, now)

    def receive_signals(self, signals: SignalsIn, now: Nanos) -> None:
        """Where the line shows whether the control is switched on, its going off ends the job."""
        if signals.cts != self._cts:
            self._cts = signals.cts
            if self._state in SENDING and not self._held:
                self._events.put(Resumed(why="CTS is ON again") if self._cts else Held(why="CTS is OFF"))
        fell = self._er and not signals.dsr
        self._er = signals.dsr
        if not fell or self._params.er is not ErLine.AUTO:
            return
        self._break_off()
        if self._in_transfer:
            self._end(Outcome.FAILED, "DSR fell: the control lost power or its cable", now)
        else:
            self._lose_the_control(now)

    def receive_closed(self, closure: Closure, reason: str, now: Nanos) -> None:
        orderly = closure is Closure.ORDERLY
        self._break_off()
        if self._state is State.SAVED and orderly:
            self._finish_saved(now)
        elif self._state is State.TAIL and orderly and self._end_has_left:
            self._finish_tail(now)
        elif self._has_job and self._ending is None:
            self._end(Outcome.FAILED, f"the line is gone: {reason}", now)
        self._rest()
        self._finish()

    # to the line

    def data_to_send(self, limit: int) -> bytes:
        return on_the_wire(self._look(limit), self._params.parity)

    def _look(self, limit: int) -> bytes:
        if self._replies:
            return bytes(self._replies[:limit])
        if self._state is State.RECEIVING and self._pause_wanted is not self._pause_told:
            return bytes([self._params.xoff if self._pause_wanted else self._params.xon])
        if self._held or self._state not in SENDING or self._transmission is None:
            return b""
        return self._transmission.look(limit)

    def data_sent(self, count: int, now: Nanos) -> None:
        self._delivery.hand_over(count)
        if self._replies:
            del self._replies[:count]
        elif self._state is State.RECEIVING:
            self._pause_told = self._pause_wanted
            if not self._pause_told:
                self._start(Timer.TEXT, self._params.text_timeout, now)
        elif count:
            assert self._transmission is not None
            self._transmission.hand_over(count)
            self._follow(now)

    def data_left(self, count: int, now: Nanos) -> None:
        self._delivery.leave(count, now)
        self._listen_in_tail(now)

    def data_discarded(self, count: int, now: Nanos) -> None:
        self._recall = False
        self._delivery.call_back(count)
        self._finish()

    @property
    def recall(self) -> bool:
        return self._recall

    @property
    def signals(self) -> SignalsOut:
        return ALL_ON

    # time and what happened

    def next_deadline(self) -> Nanos | None:
        return self._timers.next()

    def handle_timer(self, now: Nanos) -> None:
        for timer in self._timers.due(now):
            assert isinstance(timer, Timer)
            self._on_timer(timer, now)

    def _on_timer(self, timer: Timer, now: Nanos) -> None:
        params = self._params
        match timer:
            case Timer.TEXT:
                self._on_silence(now)
            case Timer.SOURCE:
                self._pump(now)
            case Timer.PAUSE:
                self._end(Outcome.FAILED, f"held by XOFF for longer than {params.pause_limit:g} s; {AGAIN}", now)
            case Timer.HOLD:
                self._end(Outcome.FAILED, f"nobody gave {self._what} within {params.hold_limit:g} s; {AGAIN}", now)
            case Timer.LIBRARY:
                self._look_again(now)
            case Timer.ACK:
                self._end(Outcome.FAILED, f"no answer to a record within {params.ack_limit:g} s; {AGAIN}", now)
            case Timer.GRACE:
                self._resume(f"ACK, and no XON within {params.xoff_ack_grace:g} s")
            case Timer.END if self._state is State.SAVED:
                self._finish_saved(now)
            case Timer.END:
                self._finish_tail(now)
            case Timer.DAMAGED:
                self._end(Outcome.FAILED, f"a damaged character came and nothing after it; {AGAIN}", now)

    def next_event(self) -> Event | None:
        return self._events.get()

    # what the control says

    def _receive(self, characters: bytes, now: Nanos) -> None:
        position = 0
        while position < len(characters):
            if self._state is State.RECEIVING:
                position = self._receive_text(characters, position, now)
                if position == len(characters):
                    return
            self._hear(characters[position], now)
            position += 1

    def _receive_text(self, characters: bytes, position: int, now: Nanos) -> int:
        """Take text up to the next mark. Returns where that stands."""
        assert self._reception is not None
        mark = self._marks.search(characters, position)
        end = mark.start() if mark else len(characters)
        if end > position:
            self._reception.take(characters[position:end])
            self._note_received(now)
        return end

    def _note_received(self, now: Nanos) -> None:
        reception = self._reception
        assert reception is not None
        self._start(Timer.TEXT, self._params.text_timeout, now)
        self._note_stored()
        if reception.problem:
            self._end(Outcome.FAILED, reception.problem, now)

    def _hear(self, character: int, now: Nanos) -> None:
        state = self._state
        if state is State.RECEIVING:
            heard = heard_while_receiving(character, self._params)
        elif state in SENDING:
            heard = heard_while_sending(character, self._params)
            self._note_certain(now)
        else:
            heard = heard_at_rest(character, self._params)
        allowed = LAW.get((state, heard))
        if allowed is None:
            self._ignore(heard, character)
            return
        self._obey(heard, character, now)
        assert self._state in allowed, f"{heard} led from {state} to {self._state}"

    def _obey(self, heard: Heard, character: int, now: Nanos) -> None:
        match heard:
            case Heard.OPEN_WRITE:
                self._on_open_write(now)
            case Heard.REQUEST:
                self._on_request(now)
            case Heard.CANCEL:
                self._on_cancel(character, now)
            case Heard.XOFF:
                self._on_xoff(character, now)
            case Heard.XON:
                self._on_xon(character, now)
            case Heard.ACK:
                self._on_ack(now)
            case Heard.NAK:
                self._on_nak(now)
            case Heard.END:
                self._on_end(character, now)
            case Heard.TEXT:
                self._on_uninvited(character, now)

    def _on_open_write(self, now: Nanos) -> None:
        """A new transaction in any state (1.1, 1.2.2); what it interrupts is over."""
        state = self._state
        behind = self._break_off()
        if state is State.SAVED:
            self._finish_saved(now)
        elif state is State.TAIL and self._end_has_left:
            self._finish_tail(now)
        elif state in SENDING or (state is State.RECEIVING and self._in_transfer):
            self._end(Outcome.FAILED, "the control began anew before the program was complete", now)
        elif state is State.HOLD:
            self._name = None
        elif behind:
            self._events.put(Violation(what=f"the control began anew {behind}"))
        self._stop_waiting()
        self._spoilt_name = self._behind = ""
        self._held = self._pause_told = False
        self._reception = Reception(self._place, self._params.upload_limit, behind)
        self._transmission = None
        self._replies[:] = bytes([self._params.write_ready])
        self._state = State.RECEIVING
        self._start(Timer.TEXT, self._params.text_timeout, now)

    def _on_request(self, now: Nanos) -> None:
        """1.2.1. In HOLD the control only repeats itself."""
        if self._state is State.HOLD:
            return
        if self._state is State.SAVED:
            self._finish_saved(now)
        if self._spoilt_name:
            self._events.put(Requested(served=False))
            self._events.put(Notice(text=f"its name came damaged ({self._spoilt_name}): nothing is sent; {ASK_AGAIN}"))
            return
        if self._name is None and self._held and self._just_ended(now):
            self._held = False
            self._events.put(Notice(text="XON after an XOFF at the end of the program: no request"))
            return
        self._serve(now)

    def _on_end(self, character: int, now: Nanos) -> None:
        """The end of a name or of a program, or what closes it after that (1.1, 1.2.2)."""
        if self._state is State.SAVED:
            return
        if self._state is State.REST:
            self._behind = ""
            self._ignore(Heard.END, character)
            return
        reception = self._reception
        assert reception is not None
        self._timers.stop(Timer.TEXT)
        name = reception.finish()
        if reception.problem:
            self._end(Outcome.FAILED, reception.problem, now)
            self._behind = ""
            return
        if self._pause_told:
            # Its last codes may wait for it.
            self._pause_told = False
            self._replies.append(self._params.xon)
        if self._params.closing_dc3 is Switch.ON:
            self._replies.append(self._params.xoff)
        self._state = State.REST
        if name is not None and reception.damage:
            self._name, self._spoilt_name = None, reception.damage
        elif name is not None and name.raw.strip(FEED + b" "):
            self._take_name(name)
        elif name is not None:
            self._name = None
            self._events.put(Notice(text="the control announced a name or a program, and ended it before it began"))
        elif reception.kept:
            self._state = State.SAVED
            self._start(Timer.END, self._params.end_wait, now)
            self._note_stored()
        else:
            self._name = None
            self._events.put(Notice(text=f"{reception.count:,} bytes of it were dropped"))

    def _take_name(self, name: Name) -> None:
        self._name = name
        if name.usual:
            return
        said = name.raw.decode("ascii", "backslashreplace").strip()
        known = f"taken as the number {name.number}" if name.number else "no number in it"
        self._events.put(Notice(text=f"the control sent the unusual name {said!r}: {known}"))

    def _has_gone_on(self, character: int, now: Nanos) -> bool:
        """Text behind the end of a program: the end may have been none. True: it is over, and this begins another."""
        assert self._reception is not None
        if character not in TEXT or character in FEED:
            return False
        self._reception.damage = self._reception.damage or "text behind its end"
        if self._punch_shelf is None:
            return False
        self._finish_saved(now)
        self._behind = "behind an end that may have been none"
        return True

    def _on_uninvited(self, character: int, now: Nanos) -> None:
        """Text at rest: a program, where the control sends as to a tape punch."""
        if self._state is State.SAVED and not self._has_gone_on(character, now):
            self._ignore(Heard.TEXT, character)
            return
        if self._punch_shelf is None or character not in TEXT:
            self._ignore(Heard.TEXT, character)
            return
        behind = self._behind
        self._on_open_write(now)
        self._replies.clear()
        assert self._reception is not None
        self._reception.behind = behind
        self._reception.take(bytes([character]))

    def _on_silence(self, now: Nanos) -> None:
        """The control said nothing more, and no end code."""
        if self._state is not State.RECEIVING:
            self._behind = ""
            return
        if self._pause_told:
            self._start(Timer.TEXT, self._params.text_timeout, now)
            return
        silence = f"silence of {self._params.text_timeout:g} s"
        behind = self._break_off()
        if self._in_transfer:
            self._end(Outcome.FAILED, f"{silence} inside the program, and no end of it", now)
        else:
            self._events.put(Violation(what=f"{silence} where a name or a program was announced"))
            assert self._reception is not None
            self._rest()
            self._behind = "" if self._reception.is_feed else behind
