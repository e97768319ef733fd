"""Feed one program to one control."""

from __future__ import annotations

from tapewire.engine import Ended, Nanos, Notice, Outcome
from tapewire.line.transport import Transport
from tapewire.transfer.program import Program
from tapewire.transfer.reports import Result, StopDistanceTold
from tapewire.transfer.session import JobSettings, Session

__all__ = ["send_program"]


async def send_program(program: Program, job: JobSettings) -> Result:
    """Arm `program` and give it to the control when it asks. Raises ProgramError for one that the protocol cannot
    carry, LineError when the line cannot be opened.

    The stop distance and every change made to the file are told before the first byte leaves.
    """
    if job.protocol.refuse is not None:
        program.rewind()
        job.protocol.refuse(job.params, program.read)
    host = job.protocol.host(job.params)
    session = Session(
        job,
        host,
        tolerated=host.needs_stop_distance,
        give_up=host.abort,
        bytes_done=lambda: host.progress,
        total=program.byte_count,
    )

    def begin(transport: Transport, now: Nanos) -> None:
        distance = transport.stop_distance
        told = StopDistanceTold(
            characters=distance.characters,
            needed=host.needs_stop_distance,
            guaranteed=distance.guaranteed,
            how=distance.how,
        )
        job.observer(told, now)
        for text in (*program.changes, *program.notes):
            job.observer(Notice(text=f"{program.name}: {text}"), now)
        program.rewind()
        host.start(program, now)

    ended = await session.run(begin)
    session.report_progress()
    return _result(ended, program, session)


def _result(ended: Ended, program: Program, session: Session) -> Result:
    assert ended.outcome is not Outcome.COMPLETE or ended.bytes_low == program.byte_count, "not whole, yet complete"
    return Result(
        outcome=ended.outcome,
        reason=ended.reason,
        bytes=ended.bytes_low,
        bytes_handed=ended.bytes_high,
        sha256=program.sha256(ended.bytes_low),
        seconds=session.seconds,
        stops=session.stops,
        utilisation=session.meter.utilisation,
    )
