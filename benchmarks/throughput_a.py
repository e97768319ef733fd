"""How much of what protocol A and expansion A allow is used: exact in simulated time, and as medians in real time.

Bound: the protocol's own formula. Protocol A answers each GTD (6 characters) with one DAT of L bytes in L + 6
characters, after the control's Tx, the control pausing Ti between its characters: L characters of program in
L + 12 character times + Tx + 5 Ti. Expansion A carries 256 n bytes in packets of 256 n + 4.
"""

from __future__ import annotations

import tempfile
from io import BytesIO

from benchmarks.ends import EXAMPLE, control_line, first_event, other_line, program_of, tapewire
from benchmarks.report import spread, table, write_section
from tapewire.engine import MILLISECOND, Nanos, Started
from tapewire.line.pacing import character_time
from tapewire.sim.world import World

RUNS = 3
REAL_SIZE = 40_000
DAT_BYTES = 1950
"""Nb - No as the control reports them before it has confirmed the host's SET."""

MESSAGE = 6
"""Characters of a message without data: sum, command, end code."""

POWER_ON = {"Nb": "2000", "No": "50", "Ti": "10", "Tx": "100", "Tp": "5", "Tw": "5"}
CASES: tuple[tuple[str, str, int, dict[str, str]], ...] = (
    ("A, Ti = Tx = 0", "fanuc-a", 19200, {}),
    ("A, Ti = Tx = 0", "fanuc-a", 86400, {}),
    ("A, power-on Ti = 10 ms, Tx = 100 ms", "fanuc-a", 19200, POWER_ON),
    ("expansion A, n = 1", "fanuc-a-expansion", 86400, {"n": "1"}),
    ("expansion A, n = 2", "fanuc-a-expansion", 86400, {"n": "2"}),
    ("expansion A, n = 4", "fanuc-a-expansion", 86400, {"n": "4"}),
)


ABOUT = """\
Program bytes x 11 / baud over the time from the first answer to the last byte, as a share of the line, beside what the
protocol's own formula allows; the first DAT waits for no Tx, hence a little over 100 %. The last packet's padding
counts as lost. Real time: two processes, median (minimum to maximum) of {runs} runs of {size:,} bytes, in percent of
what is allowed.

"""


def allowed(name: str, baud: int, settings: dict[str, str]) -> float:
    """Share of the line that can be program, by the formula of the protocol."""
    if name == "fanuc-a-expansion":
        data = 256 * int(settings["n"])
        return data / (data + 4)
    character = character_time(baud)
    waits: Nanos = (int(settings.get("Tx", "0")) + (MESSAGE - 1) * int(settings.get("Ti", "0"))) * MILLISECOND
    return DAT_BYTES * character / ((DAT_BYTES + 2 * MESSAGE) * character + waits)


def simulated(name: str, baud: int, settings: dict[str, str]) -> float:
    """Share of the line that was program, from the first answer to the last byte of it in the buffer."""
    program = EXAMPLE.read_bytes().rstrip()
    world = World()
    pair = world.pair(name, baud=baud, host_settings=settings, grain=16, cnc_window=64)
    pair.host.start(BytesIO(program), world.now)
    pair.cnc.cycle_start(world.now)
    world.run_until(lambda: pair.cnc.progress == len(program))
    began = next(at for at, event in pair.host_events if isinstance(event, Started))
    return len(program) * character_time(baud) / (world.now - began)


def in_real_time(kind: str, name: str, baud: int, settings: dict[str, str]) -> float:
    """The same from two processes: the host's characters over its time, less what of them is no program."""
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    common = ["--protocol", name, "--baud", str(baud)]
    with control_line(kind) as (line, path), tempfile.TemporaryDirectory() as folder:
        program = program_of(REAL_SIZE, folder)
        cnc = tapewire("cnc", "--line", line, *common)
        ready = first_event(cnc, "ready")
        host = tapewire("send", str(program), "--line", other_line(kind, ready, path), *common, *words)
        end = first_event(host, "end")
        host.wait()
        cnc.terminate()
        cnc.wait()
    assert end["outcome"] == "complete", end
    data = DAT_BYTES / (DAT_BYTES + MESSAGE) if name == "fanuc-a" else allowed(name, baud, settings)
    return float(end["utilisation"]) * data


def main() -> None:
    rows = []
    for title, name, baud, settings in CASES:
        bound = allowed(name, baud, settings)
        exact = simulated(name, baud, settings)
        real = {"TCP": "", "pty": ""}
        if baud == 86400 and settings.get("n") in (None, "4"):
            for kind in real:
                shares = [in_real_time(kind, name, baud, settings) / bound * 100 for _ in range(RUNS)]
                real[kind] = spread(shares, ".2f")
        rows.append(
            [title, str(baud), f"{bound:.2%}", f"{exact:.2%}", f"{exact / bound:.2%}", real["TCP"], real["pty"]]
        )
        print(rows[-1], flush=True)
    text = ABOUT.format(runs=RUNS, size=REAL_SIZE)
    head = [
        "what",
        "baud",
        "allowed, share of the line",
        "simulated, share of the line",
        "simulated, of what is allowed",
        "TCP, % of allowed",
        "pty, % of allowed",
    ]
    write_section("throughput-a", "Throughput of protocol A and expansion A", text + table(head, rows))


if __name__ == "__main__":
    main()
