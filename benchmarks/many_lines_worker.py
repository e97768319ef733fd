"""One process that feeds many lines at once, and what it took: ours, or the plainest there is.

`python -m benchmarks.many_lines_worker tapewire|pyserial PROGRAM BAUD` reads the names of the terminals from stdin
until an empty line, says "ready", feeds all of them, and prints processor seconds, memory and outcomes as JSON. It is
started by `benchmarks/many_lines.py`.
"""

from __future__ import annotations

import asyncio
import json
import os
import resource
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

DC1: Final = b"\x11"
DC3: Final = b"\x13"

SETTLE_S: Final = 1.0
"""From the opening of the last line until the controls ask: what each job does once at its start is no feeding."""


def memory_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def feed_by_tapewire(paths: list[str], program: str, baud: int, ready: Callable[[], None]) -> Counter[str]:
    """Each line with its own job, engine and driver, as `tapewire send` has them."""
    from tapewire.engine import Nanos
    from tapewire.transfer.api import send
    from tapewire.transfer.reports import Ready, Report

    opened = 0

    def observe(report: Report, now: Nanos) -> None:
        nonlocal opened
        if isinstance(report, Ready):
            opened += 1
            if opened == len(paths):
                asyncio.get_running_loop().call_later(SETTLE_S, ready)

    async def all_of_them() -> Counter[str]:
        jobs = (
            send(
                program,
                line=path,
                protocol="fanuc-b-expansion",
                baud=baud,
                # The last DC3 is the end here, and the waiting for a DC1 behind it no feeding.
                settings={"closing_time": "0.1"},
                observer=observe,
                timeout_s=120.0,
            )
            for path in paths
        )
        return Counter(result.outcome.value for result in await asyncio.gather(*jobs))

    return asyncio.run(all_of_them())


def feed_by_pyserial(paths: list[str], program: str, baud: int, ready: Callable[[], None]) -> Counter[str]:
    """A thread a port, with the same window as ours: what came in is looked at before each quarter of it is written."""
    import serial

    data = Path(program).read_bytes()
    window = baud // 400
    chunk, character_s = window // 4, 11 / baud
    outcomes: Counter[str] = Counter()
    ports = [serial.Serial(path, baud, parity=serial.PARITY_NONE) for path in paths]

    def feed(port: serial.Serial) -> None:
        while port.read(1) != DC1:
            pass
        free_at = time.monotonic()
        at = 0
        while at < len(data):
            if port.in_waiting and DC3 in port.read(port.in_waiting):
                while port.read(1) != DC1:
                    pass
            port.write(data[at : at + chunk])
            at += chunk
            free_at = max(free_at, time.monotonic()) + chunk * character_s
            if (ahead := free_at - time.monotonic() - (window - chunk) * character_s) > 0:
                time.sleep(ahead)
        while port.read(1) != DC3:
            pass
        outcomes["complete"] += 1

    threads = [threading.Thread(target=feed, args=(port,)) for port in ports]
    for thread in threads:
        thread.start()
    ready()
    for thread in threads:
        thread.join()
    return outcomes


def main() -> None:
    way, program, baud = sys.argv[1:]
    paths = [line.strip() for line in iter(sys.stdin.readline, "\n")]
    feed = {"tapewire": feed_by_tapewire, "pyserial": feed_by_pyserial}[way]
    if way == "tapewire":
        import tapewire.transfer.api  # noqa: F401 - what a process needs once is no line's memory
    else:
        import serial  # noqa: F401
    memory = memory_bytes()
    began = 0.0

    def ready() -> None:
        nonlocal began
        began = cpu_s()
        print("ready", flush=True)

    outcomes = feed(paths, program, int(baud), ready)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    told = {"cpu_s": cpu_s() - began, "memory": (peak - memory) / len(paths), "outcomes": outcomes}
    print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
