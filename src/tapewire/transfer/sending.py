"""Feed one program to one control."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from tapewire.engine import Ended, HostEngine, Nanos, Notice, Outcome
from tapewire.line.transport import Transport
from tapewire.protocols.bridgeport.host_arming import Policy
from tapewire.transfer.folder import ProgramFolder
from tapewire.transfer.numbered import FolderLibrary, numbered_host
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Result, StopDistanceTold
from tapewire.transfer.session import JobSettings, Session

__all__ = ["send_by_number", "send_program"]


async def send_program(program: Program, job: JobSettings) -> Result:
    """Arm `program` and give it to the control when it asks. Raises ProgramError for one that the protocol cannot
    carry, LineError when the line cannot be opened.

    The stop distance and every change made to the file are told before the first byte leaves.
    """
    if job.protocol.refuse is not None:
        program.rewind()
        job.protocol.refuse(job.params, program.read)
    host = job.protocol.host(job.params)

    def arm(now: Nanos) -> None:
        for text in (*program.changes, *program.notes):
            job.observer(Notice(text=f"{program.name}: {text}"), now)
        program.rewind()
        host.start(program, now)

    session = _session(host, job, program.byte_count)
    ended = await _run(session, host, job, arm)
    return _result(ended, program, session)


async def send_by_number(folder: ProgramFolder, job: JobSettings, *, raw: bool = False) -> Result:
    """Give the control the program out of `folder` whose number it asks for, one program in all.

    Raises UsageError for a protocol without program numbers, LineError when the line cannot be opened.
    """
    host = numbered_host(job)
    library = FolderLibrary(folder, job, raw=raw)
    session = _session(host, job, None)
    try:
        ended = await _run(session, host, job, lambda now: host.serve(library, now, policy=Policy.ONCE))
        return _result(ended, library.program, session)
    finally:
        library.close()


def _session(host: HostEngine, job: JobSettings, total: int | None) -> Session:
    return Session(
        job,
        host,
        tolerated=host.needs_stop_distance,
        give_up=host.abort,
        bytes_done=lambda: host.progress,
        total=total,
    )


async def _run(session: Session, host: HostEngine, job: JobSettings, arm: Callable[[Nanos], None]) -> Ended:
    def begin(transport: Transport, now: Nanos) -> None:
        distance = transport.stop_distance
        told = StopDistanceTold(
            characters=distance.characters,
            needed=host.needs_stop_distance,
            guaranteed=distance.guaranteed,
            how=distance.how,
        )
        job.observer(told, now)
        arm(now)

    ended = await session.run(begin)
    session.report_progress()
    return ended


def _result(ended: Ended, program: Program | None, session: Session) -> Result:
    """`program` is None where none was given out."""
    byte_count = program.byte_count if program is not None else 0
    assert ended.outcome is not Outcome.COMPLETE or ended.bytes_low == byte_count, "not whole, yet complete"
    return Result(
        outcome=ended.outcome,
        reason=ended.reason,
        bytes=ended.bytes_low,
        bytes_handed=ended.bytes_high,
        sha256=program.sha256(ended.bytes_low) if program is not None else hashlib.sha256().hexdigest(),
        seconds=session.seconds,
        stops=session.stops,
        utilisation=session.meter.utilisation,
    )
