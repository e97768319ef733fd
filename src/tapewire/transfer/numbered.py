"""Sending and receiving by program number, where the protocol has them: what a folder gives out and takes in."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from tapewire.engine import SECOND, Nanos, Notice
from tapewire.errors import UsageError
from tapewire.line.driver import monotonic
from tapewire.protocols.bridgeport.host import BridgeportHost
from tapewire.protocols.bridgeport.messages import Mode
from tapewire.transfer.folder import ProgramFolder, Signature, signature_of
from tapewire.transfer.program import Program
from tapewire.transfer.session import JobSettings

__all__ = ["AtRest", "FolderLibrary", "numbered_host"]

REST_S: Final = 2
"""Longer than a copy over a shop's network pauses between two pieces, short for somebody who waits at a control."""


class AtRest:
    """Which files have not changed for REST_S. Those `known` from the start count as long at rest."""

    def __init__(self, known: Mapping[Path, Signature]) -> None:
        self._known: dict[Path, tuple[Signature, Nanos | None]] = {path: (known[path], None) for path in known}

    def is_so(self, path: Path, now: Nanos) -> bool:
        """`path` is as it was REST_S ago. Raises UsageError where it is gone."""
        signature = signature_of(path)
        before, since = self._known.get(path, (None, None))
        if signature != before:
            self._known[path] = signature, now
            return False
        return since is None or now - since >= REST_S * SECOND


def numbered_host(job: JobSettings) -> BridgeportHost:
    """The host engine of `job`. Raises UsageError for a protocol whose controls know no program numbers."""
    host = job.protocol.host(job.params)
    if not isinstance(host, BridgeportHost):
        raise UsageError(f"a control asks for no number by {job.protocol.name}: name one FILE, not --program-dir")
    return host


class FolderLibrary:
    """Programs out of a folder, each read and prepared when it is asked for. `program` is what was given out last.

    The host looks again while the control waits. A file that is new, or not as it was at the start, is given out when
    it has not changed for REST_S: until then somebody may still be writing it.
    """

    def __init__(self, folder: ProgramFolder, job: JobSettings, *, raw: bool) -> None:
        self._folder = folder
        self._job = job
        self._raw = raw
        self._told = ""
        self._at_rest = AtRest(folder.signatures())
        self.program: Program | None = None

    def find(self, number: str | None, mode: Mode | None) -> Program | None:
        if number is None:
            self._tell("the control asks without a number; only programs asked for by number are given out")
            return None
        try:
            program = self._read(number)
        except UsageError as error:
            self._tell(f"{error}; mend it and it is sent, or cancel at the control")
            return None
        if program is None:
            return None
        for text in (*program.changes, *program.notes):
            self._tell(f"{program.name}: {text}")
        self.close()
        self.program = program
        program.rewind()
        return program

    def _read(self, number: str) -> Program | None:
        """Raises UsageError for a program that cannot be sent."""
        path = self._folder.find(number)
        if path is None:
            self._tell(f"there is no program {number} in {self._folder.path}: put it there and it is sent")
            return None
        if not self._at_rest.is_so(path, monotonic()):
            self._tell(f"{path.name} is new or was changed: it is sent when it has not changed for {REST_S} s")
            return None
        entry, params = self._job.protocol, self._job.params
        program = Program.from_file(path, entry.text(params), raw=self._raw)
        try:
            if entry.refuse is not None:
                program.rewind()
                entry.refuse(params, program.read)
            unchanged = self._at_rest.is_so(path, monotonic())
        except BaseException:
            program.close()
            raise
        if not unchanged:
            program.close()
        return program if unchanged else None

    def _tell(self, text: str) -> None:
        """What was told last is not told again: the host looks every second."""
        if text != self._told:
            self._told = text
            self._job.observer(Notice(text=text), monotonic())

    def close(self) -> None:
        if self.program is not None:
            self.program.close()
