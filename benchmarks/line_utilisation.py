"""How much of the line a transfer uses while the control does not hold it, and how far it runs past a DC3.

Bound: the wire. 100 % is one character every 11 bit times. Two processes, a paced line; each kind runs several times.
"""

from __future__ import annotations

import tempfile

from benchmarks.ends import LINES, control_line, first_event, other_line, program_of, tapewire
from benchmarks.report import spread, table, write_section

RUNS = 5
SLOW_RUNS = 2
SLOW_SIZE = 30_000
"""Bytes that fill the buffer of either protocol, so that a slow control must stop the host."""

CASES = (("fanuc-b", 19200, 15_000), ("fanuc-b-expansion", 86400, 60_000))
SLOW_SHARE = 0.6
"""Execution speed of the slow control against the line, so that it stops the host."""


def one_run(kind: str, protocol: str, baud: int, size: int, blocks_per_second: float | None) -> tuple[float, int, int]:
    """Utilisation, the most characters that came after a DC3, and how often the host was stopped."""
    speed = [] if blocks_per_second is None else ["--blocks-per-second", f"{blocks_per_second:g}"]
    common = ["--protocol", protocol, "--baud", str(baud)]
    with control_line(kind) as (line, path), tempfile.TemporaryDirectory() as folder:
        program = program_of(size, folder)
        cnc = tapewire("cnc", "--line", line, *common, *speed)
        ready = first_event(cnc, "ready")
        host = tapewire("send", str(program), "--line", other_line(kind, ready, path), *common)
        assert cnc.stdout is not None
        end = first_event(host, "end")
        text = cnc.stdout.read()
        host.wait()
        cnc.wait()
    assert end["outcome"] == "complete", end
    counts = [int(line.split('"count": ')[1].split(",")[0]) for line in text.splitlines() if '"after_dc3"' in line]
    return end["utilisation"], max(counts, default=0), end["stops"]


def main() -> None:
    rows = []
    for protocol, baud, size in CASES:
        for kind in LINES:
            fast = [one_run(kind, protocol, baud, size, None)[0] for _ in range(RUNS)]
            blocks = baud / 11 / 15.6 * SLOW_SHARE
            slow = [one_run(kind, protocol, baud, max(size, SLOW_SIZE), blocks) for _ in range(SLOW_RUNS)]
            stops = [stops for _, _, stops in slow]
            assert min(stops) > 0, f"the slow control never stopped the host: {slow}"
            after = max(count for _, count, _ in slow)
            rows.append(
                [
                    protocol,
                    str(baud),
                    kind,
                    spread([value * 100 for value in fast], ".2f"),
                    spread([value * 100 for value, _, _ in slow], ".2f"),
                    spread(stops, ".0f"),
                    str(after),
                    "1280" if protocol == "fanuc-b-expansion" else "511",
                ]
            )
            print(rows[-1], flush=True)
    text = (
        "Characters x 11 / baud over the time not held, first window left out, in percent of the wire; median "
        f"(minimum to maximum) of {RUNS} runs, {SLOW_RUNS} with the slower control. "
        "Host and simulated control are two processes on one machine. The wire "
        "is the bound: 100 %.\n\n"
    )
    head = [
        "protocol",
        "baud",
        "line",
        "control as fast as the line, %",
        "control slower, stopping the host, %",
        "stops a run",
        "most characters after DC3",
        "allowed",
    ]
    write_section("line-utilisation", "Line utilisation", text + table(head, rows))


if __name__ == "__main__":
    main()
