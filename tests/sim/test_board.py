"""The board beside a running engine: LEDs in every normal state, the memory as it fills, and SR941."""

from __future__ import annotations

from io import BytesIO

import pytest

from tapewire.engine import LineFault, Outcome
from tapewire.errors import UsageError
from tapewire.fanuc.leds import STATUSES, BoardStatus, Red
from tapewire.fanuc.memory import Address, Cause, pointers_say
from tapewire.sim.board import Board, Request, watch
from tapewire.sim.world import World

PROGRAM = b"%\nO0001\n" + b"G91G01X1.F100\n" * 200 + b"M30\n%"
PROTOCOLS = ("fanuc-a", "fanuc-a-expansion", "fanuc-b", "fanuc-b-expansion")


class Rig:
    """A host, a control, and the board of the latter."""

    def __init__(self, protocol: str, **operator: float) -> None:
        self.world = World()
        self.pair = self.world.pair(protocol, **operator)  # type: ignore[arg-type]
        self.board: Board = watch(self.pair)
        self.seen: list[BoardStatus] = [self.board.status]

    def read(self, program: bytes = PROGRAM) -> None:
        self.pair.host.start(BytesIO(program), self.world.now)
        self.board.request(Request.READ.value, self.world.now)

    def run(self) -> None:
        def look() -> bool:
            if self.board.status is not self.seen[-1]:
                self.seen.append(self.board.status)
            return self.pair.cnc_end is not None and self.pair.host_end is not None

        self.world.run_until(look)
        look()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_12_1_1_idle_handling_stopping_idle(protocol: str) -> None:
    rig = Rig(protocol)
    rig.read()
    rig.run()
    idle, handling, stopping = BoardStatus.IDLE, BoardStatus.HANDLING, BoardStatus.STOPPING
    assert rig.seen == [idle, handling, stopping, idle]
    assert rig.pair.cnc_end is not None
    assert rig.pair.cnc_end.outcome is Outcome.COMPLETE


@pytest.mark.parametrize("request_", [Request.RESET, Request.ALARM])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_12_1_1_no_5_a_reset_or_an_alarm_stops_it(protocol: str, request_: Request) -> None:
    rig = Rig(protocol, blocks_per_second=50)
    rig.read()
    rig.world.run_until(lambda: rig.pair.cnc.buffered > 100)
    rig.board.request(request_.value, rig.world.now)
    assert rig.board.panel == "green on,on; red 0"
    rig.run()
    assert rig.board.status is BoardStatus.IDLE


@pytest.mark.parametrize("protocol", ["fanuc-b", "fanuc-b-expansion"])
def test_12_1_1_no_5_an_alarm_of_the_communication_stops_it(protocol: str) -> None:
    rig = Rig(protocol, blocks_per_second=50)
    rig.read()
    rig.world.run_until(lambda: rig.pair.cnc.buffered > 100)
    rig.pair.cnc.receive_line_fault(LineFault.FRAMING, ord("A"), rig.world.now)
    rig.run()
    assert rig.seen[-2:] == [BoardStatus.STOPPING, BoardStatus.IDLE]


def test_12_1_1_power_on() -> None:
    board = Rig("fanuc-b").board
    board.power_on()
    assert (board.status, board.red, board.panel) == (BoardStatus.POWER_ON, Red.RESET, "green on,on; red 1")
    board.start()
    assert (board.status, board.red, board.panel) == (BoardStatus.INITIALISING, Red.NONE, "green off,off; red 0")
    board.initialised()
    assert (board.status, board.panel) == (BoardStatus.IDLE, "green on,off; red 0")


@pytest.mark.parametrize("error", [status for status, row in STATUSES.items() if not row.is_normal])
def test_12_1_2_a_system_error_stays_until_power_off_and_on(error: BoardStatus) -> None:
    board = Rig("fanuc-b").board
    board.fail(error, Red.DRAM_PARITY)
    board.initialised()
    assert (board.status, board.red) == (error, Red.DRAM_PARITY)
    assert board.green == STATUSES[error].green
    board.power_on()
    assert board.status is BoardStatus.POWER_ON


def test_a_normal_state_is_no_error() -> None:
    with pytest.raises(UsageError, match="no system error"):
        Rig("fanuc-b").board.fail(BoardStatus.IDLE)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_12_2_the_pointers_while_the_control_is_slow_and_at_the_end(protocol: str) -> None:
    rig = Rig(protocol, blocks_per_second=50)
    memory = rig.board.memory
    rig.read()
    rig.world.run_until(lambda: rig.pair.cnc.buffered > 500)
    read, write = (memory.long(memory.address(of)) for of in (Address.READ_POINTER, Address.WRITE_POINTER))
    assert pointers_say(read, write) is Cause.CONTROL
    assert write - read == rig.pair.cnc.buffered
    base = memory.address(Address.BUFFER)
    assert bytes(memory.byte(base + place) for place in range(read, write)) == PROGRAM[read:write]
    rig.run()
    assert pointers_say(memory.read_pointer, memory.write_pointer) is Cause.HOST_OR_BUFFER


@pytest.mark.parametrize(("protocol", "latest"), [("fanuc-b", b"\x93"), ("fanuc-a", b"SAT")])
def test_12_2_the_send_buffer_holds_what_the_remote_buffer_said_last(protocol: str, latest: bytes) -> None:
    rig = Rig(protocol)
    rig.read()
    rig.run()
    assert latest in rig.board.memory.latest_sent[-70:]


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("code", [0, 5, 255, -1])
def test_11_sr941_a_command_that_there_is_none_of(protocol: str, code: int) -> None:
    rig = Rig(protocol, blocks_per_second=50)
    rig.read()
    rig.world.run_until(lambda: rig.pair.cnc.buffered > 100)
    rig.board.request(code, rig.world.now)
    assert [alarm.number for alarm in rig.board.alarms] == ["SR941"]
    rig.run()
    assert rig.pair.cnc_end is not None
    assert rig.pair.cnc_end.outcome is Outcome.FAILED


def test_a_punch_is_handled_and_ends() -> None:
    rig = Rig("fanuc-b")
    rig.pair.host.receive(rig.pair.received, 0)
    rig.board.request(Request.PUNCH.value, 0, BytesIO(PROGRAM))
    rig.run()
    assert rig.seen == [BoardStatus.IDLE, BoardStatus.HANDLING, BoardStatus.IDLE]
    assert rig.pair.received.getvalue() == PROGRAM
    with pytest.raises(UsageError, match="what is to be punched"):
        rig.board.request(Request.PUNCH.value, 0)
