"""Which protocol a stream speaks, and which side wrote it: from what the capture says, from the user, or guessed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from tapewire.errors import UsageError
from tapewire.line.captures.records import Origin, Record, Side
from tapewire.protocols import PROTOCOLS, ProtocolEntry, protocol
from tapewire.protocols.settings import End
from tapewire.transfer.decoding.dialogue import Dialogue, Spoken
from tapewire.transfer.decoding.entry import Entry

__all__ = ["Asked", "Stream", "recognise"]

SAMPLE_RECORDS: Final = 4000
SAMPLE_CHARACTERS: Final = 64 * 1024
"""Where the protocol is not known, so much is looked at before the first entry; then one way of reading is chosen."""

ENOUGH_EVIDENCE: Final = 8
"""Live, a guess is good with this much: a handful of messages with right sums, or some turns of DC1 and DC3."""

SOME_EVIDENCE: Final = 2
"""At the last look this will do."""

LIVE_LOOKS: Final = (25, 50, 100, 200)
"""Live, a guess is tried after so many records; then it begins anew. More would hold up the line it stands in."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What the user said of a capture; None for what is to be found out."""

    protocol: str | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    side: Side | None = None

    def __post_init__(self) -> None:
        """Raises UsageError for a protocol or a setting there is not."""
        if self.protocol is None and self.settings:
            raise UsageError("--set belongs to a protocol: say which one with --protocol")
        if self.protocol is not None:
            entry = protocol(self.protocol)
            if self.side is None:
                _params_of_any_end(entry, self.settings)
            else:
                entry.params(self.settings, End(self.side))


def _params_of_any_end(entry: ProtocolEntry, settings: Mapping[str, str]) -> Any:
    """The words on the line are the same for both ends, whichever end a setting belongs to."""
    try:
        return entry.params(settings, End.HOST)
    except UsageError:
        return entry.params(settings, End.CONTROL)


def recognise(asked: Asked, origin: Origin, sample: list[Record]) -> tuple[Spoken, str, int]:
    """How to read a stream, how that is known, in words, and how much speaks for it."""
    side = asked.side or origin.side
    if asked.protocol is not None:
        way, evidence = _best(sample, side, [(protocol(asked.protocol), asked.settings)])
        return way, f"{asked.protocol}, as told", evidence
    if origin.protocol in PROTOCOLS:
        return _as_it_says(origin, side, sample)
    candidates: list[tuple[ProtocolEntry, Mapping[str, str]]] = [(entry, {}) for entry in PROTOCOLS.values()]
    way, evidence = _best(sample, side, candidates, baud=origin.baud)
    if evidence <= 0 or way.protocol is None:
        way = Spoken(protocol=None, params=None, side=side or Side.HOST)
        return way, "no protocol recognised: characters as they are", 0
    return way, f"{way.protocol.name}, a guess; --protocol NAME settles it", evidence


def _as_it_says(origin: Origin, side: Side | None, sample: list[Record]) -> tuple[Spoken, str, int]:
    entry = PROTOCOLS[origin.protocol]
    known = f"{entry.name}, as the capture says"
    settings = origin.settings
    try:
        _params_of_any_end(entry, settings)
    except UsageError:
        known += "; its settings mean nothing"
        settings = {}
    way, evidence = _best(sample, side, [(entry, settings)])
    return way, known, evidence


def _best(
    sample: list[Record],
    side: Side | None,
    candidates: list[tuple[ProtocolEntry, Mapping[str, str]]],
    *,
    baud: int = 0,
) -> tuple[Spoken, int]:
    """The way of reading with the most evidence. Of two that read it alike, the one for this rate, then the first."""
    ways = [
        Spoken(protocol=entry, params=_params_of_any_end(entry, settings), side=each)
        for entry, settings in candidates
        for each in ((side,) if side is not None else Side)
    ]
    if len(ways) == 1:
        return ways[0], 0
    judged = [(way, _evidence(way, sample)) for way in ways]
    return max(judged, key=lambda each: (each[1], _suits(each[0], baud)))


def _suits(spoken: Spoken, baud: int) -> bool:
    """A rate that protocol A or B does not allow speaks for its expansion."""
    return spoken.protocol is not None and (spoken.protocol.baud > 19200) is (baud > 19200)


def _evidence(spoken: Spoken, sample: list[Record]) -> int:
    dialogue = Dialogue(spoken)
    for record in sample:
        for _ in dialogue.feed(record):
            pass
    return dialogue.evidence


class Stream:
    """One stream of a capture, or of a line that is watched: its records become entries as soon as it is known how to
    read them. `known` says how that was decided, None until then.

    With `live` nothing waits for the decision: characters are shown as they are until the protocol shows itself.
    """

    def __init__(self, asked: Asked, origin: Origin, *, live: bool = False) -> None:
        self._asked = asked
        self.origin = origin
        self._live = live
        self._sample: list[Record] = []
        self._characters = 0
        self._dialogue: Dialogue | None = None
        self.known: str | None = None
        told = asked.side or origin.side
        if (asked.protocol is not None or origin.protocol in PROTOCOLS) and told is not None:
            self._decide()
        elif live:
            self._dialogue = Dialogue(Spoken(protocol=None, params=None, side=told or Side.HOST))

    @property
    def dialogue(self) -> Dialogue:
        """Only once something has been fed, or it is finished."""
        assert self._dialogue is not None
        return self._dialogue

    def feed(self, record: Record) -> Iterator[Entry]:
        if self.known is None:
            self._sample.append(record)
            self._characters += len(record.data)
            if self._live:
                assert self._dialogue is not None
                yield from self._dialogue.feed(record)
                yield from self._look_again()
                return
            if len(self._sample) < SAMPLE_RECORDS and self._characters < SAMPLE_CHARACTERS:
                return
            yield from self._replay()
            return
        yield from self.dialogue.feed(record)

    def finish(self) -> Iterator[Entry]:
        """Decide at the latest now; what is left."""
        if self.known is None and not self._live:
            yield from self._replay()
        yield from self.dialogue.finish()

    def _replay(self) -> Iterator[Entry]:
        sample = self._sample
        self._decide()
        for record in sample:
            yield from self.dialogue.feed(record)

    def _look_again(self) -> Iterator[Entry]:
        """A guess that is good takes over, knowing what has been said before; a long sample is forgotten."""
        count, is_last = len(self._sample), self._characters >= SAMPLE_CHARACTERS
        if count not in LIVE_LOOKS and not is_last:
            return
        is_last = is_last or count == LIVE_LOOKS[-1]
        spoken, known, evidence = recognise(self._asked, self.origin, self._sample)
        if evidence >= (SOME_EVIDENCE if is_last else ENOUGH_EVIDENCE):
            yield from self.dialogue.finish()
            self._take_over(spoken, known)
        elif is_last:
            self._sample, self._characters = [], 0

    def _take_over(self, spoken: Spoken, known: str) -> None:
        self._dialogue = Dialogue(spoken)
        for record in self._sample:
            for _ in self._dialogue.feed(record):
                pass
        for _ in self._dialogue.finish():
            pass
        self.known, self._sample = known, []

    def _decide(self) -> None:
        spoken, self.known, _ = recognise(self._asked, self.origin, self._sample)
        self._dialogue = Dialogue(spoken)
        self._sample = []
