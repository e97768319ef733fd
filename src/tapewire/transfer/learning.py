"""The guided session at a real Bridgeport control: run it, and store what was seen as a profile."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from tapewire.engine import Nanos, Notice, Outcome
from tapewire.errors import UsageError
from tapewire.line.driver import monotonic
from tapewire.protocols.bridgeport.learning import Learner
from tapewire.protocols.bridgeport.messages import STOP_CHARACTERS
from tapewire.protocols.bridgeport.profile import MOST_TITLE
from tapewire.transfer.reports import Progress, Report, Result
from tapewire.transfer.session import JobSettings, Session

__all__ = ["ProfileFile", "learn_profile"]


class ProfileFile:
    """Where a profile goes. Raises UsageError for a title or a path that cannot be, before a line is opened."""

    def __init__(self, path: Path, title: str, *, force: bool = False) -> None:
        self.path = path
        self.title = title
        self._force = force
        if len(title) > MOST_TITLE or not title.isprintable():
            raise UsageError(f"the control's name belongs into a title of one line and {MOST_TITLE} characters at most")
        if path.exists() and not (force and path.is_file()):
            raise UsageError(f"{path}: is there already; give another name, or --force to replace a file")
        if not path.parent.is_dir():
            raise UsageError(f"{path}: there is no folder {path.parent}")

    def write(self, text: str) -> None:
        """Raises OSError."""
        with self.path.open("w" if self._force else "x", encoding="utf-8") as file:
            file.write(text)


async def learn_profile(place: ProfileFile, job: JobSettings, given: Mapping[str, str]) -> Result:
    """Guide a person through the session, and store what was seen, also when it ended early. Raises LineError.

    `given` are the words that `job.params` was made of. They go into the profile too, so that it needs no others.
    """
    learner = Learner(job.params, given)

    def observe(report: Report, now: Nanos) -> None:
        if not isinstance(report, Progress):
            job.observer(report, now)

    session = Session(
        job.observed_by(observe, job.stop),
        learner,
        tolerated=STOP_CHARACTERS,
        give_up=learner.abort,
        bytes_done=lambda: learner.progress,
    )
    ended = await session.run(lambda transport, now: learner.begin(now))
    outcome, reason, stored = ended.outcome, ended.reason, b""
    if learner.seen:
        try:
            text = learner.profile(place.title).dumps()
            place.write(text)
            stored = text.encode()
            job.observer(Notice(text=f"stored in {place.path}: {', '.join(learner.seen)}"), monotonic())
        except UsageError as error:
            outcome, reason = Outcome.FAILED, f"what was seen makes no code table: {error}"
        except OSError as error:
            outcome, reason = Outcome.FAILED, f"{place.path}: {error.strerror}"
    return Result(
        outcome=outcome,
        reason=reason,
        bytes=len(stored),
        bytes_handed=len(stored),
        sha256=hashlib.sha256(stored).hexdigest(),
        seconds=session.seconds,
        stops=session.stops,
        utilisation=None,
    )
