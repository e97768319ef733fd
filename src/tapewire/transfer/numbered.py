"""Sending and receiving by program number, where the protocol has them: what a folder gives out and takes in."""

from __future__ import annotations

from tapewire.engine import Notice
from tapewire.errors import UsageError
from tapewire.line.driver import monotonic
from tapewire.protocols.bridgeport.host import BridgeportHost
from tapewire.protocols.bridgeport.messages import Mode
from tapewire.transfer.folder import ProgramFolder
from tapewire.transfer.program import Program
from tapewire.transfer.session import JobSettings

__all__ = ["FolderLibrary", "numbered_host"]


def numbered_host(job: JobSettings) -> BridgeportHost:
    """The host engine of `job`. Raises UsageError for a protocol whose controls know no program numbers."""
    host = job.protocol.host(job.params)
    if not isinstance(host, BridgeportHost):
        raise UsageError(f"a control asks for no number by {job.protocol.name}: name one FILE, not --program-dir")
    return host


class FolderLibrary:
    """Programs out of a folder, each read and prepared when it is asked for. `program` is what was given out last."""

    def __init__(self, folder: ProgramFolder, job: JobSettings, *, raw: bool) -> None:
        self._folder = folder
        self._job = job
        self._raw = raw
        self.program: Program | None = None

    def find(self, number: str | None, mode: Mode | None) -> Program | None:
        if number is None:
            self._tell("the control asks without a number; only programs asked for by number are given out")
            return None
        try:
            path = self._folder.find(number)
            if path is None:
                self._tell(f"there is no program {number} in {self._folder.path}")
                return None
            program = Program.from_file(path, self._job.protocol.text(self._job.params), raw=self._raw)
        except UsageError as error:
            self._tell(str(error))
            return None
        for text in (*program.changes, *program.notes):
            self._tell(f"{program.name}: {text}")
        self.close()
        self.program = program
        program.rewind()
        return program

    def _tell(self, text: str) -> None:
        self._job.observer(Notice(text=text), monotonic())

    def close(self) -> None:
        if self.program is not None:
            self.program.close()
