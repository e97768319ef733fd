"""From Ctrl-C to the last byte the other side sees. Goal: 100 ms.

Bound: the window, 27.5 ms of line, is what may be on its way when the signal comes.
"""

from __future__ import annotations

import os
import select
import signal
import socket
import time
import tty

from benchmarks.ends import EXAMPLE, LINES, first_event, tapewire
from benchmarks.report import spread, table, write_section

RUNS = 5
CASES = (("fanuc-b", 19200), ("fanuc-b-expansion", 86400))
SENDING_S = 1.0
QUIET_S = 1.0


class Peer:
    """The bare other side: it asks for the program, reads, and notes when the last byte came."""

    def __init__(self, kind: str) -> None:
        if kind == "TCP":
            self._listener = socket.create_server(("127.0.0.1", 0))
            self.line = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
            self.descriptor = -1
        else:
            self.descriptor, slave = os.openpty()
            tty.setraw(slave)
            self.line = os.ttyname(slave)

    def ask(self) -> None:
        if self.descriptor < 0:
            self._connection, _ = self._listener.accept()
            self.descriptor = self._connection.fileno()
        os.write(self.descriptor, b"\x11")

    def read_for(self, seconds: float) -> tuple[int, float | None]:
        """Bytes read and the moment of the last one (None without any), until `seconds` pass or the line ends."""
        count, last, end = 0, None, time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            if not select.select([self.descriptor], [], [], left)[0]:
                break
            try:
                data = os.read(self.descriptor, 65536)
            except OSError:
                break
            if not data:
                break
            count, last = count + len(data), time.monotonic()
        return count, last


def one_run(kind: str, protocol: str, baud: int) -> float | None:
    """Seconds from the signal to the last byte after it, None when none came; the counts of the end must hold."""
    peer = Peer(kind)
    host = tapewire("send", str(EXAMPLE), "--line", peer.line, "--protocol", protocol, "--baud", str(baud))
    first_event(host, "ready")
    peer.ask()
    before, _ = peer.read_for(SENDING_S)
    signalled = time.monotonic()
    host.send_signal(signal.SIGINT)
    after, last = peer.read_for(QUIET_S)
    end = first_event(host, "end")
    host.wait()
    assert end["outcome"] == "cancelled", end
    assert end["bytes"] <= before + after <= end["bytes_handed"], (end, before + after)
    return None if last is None else last - signalled


def told(spans_s: list[float | None]) -> str:
    """The runs in which something came, in ms, and how many those were."""
    some = [span * 1000 for span in spans_s if span is not None]
    return f"{spread(some, '.1f')}, {len(some)} of {len(spans_s)} runs" if some else "none in any run"


def main() -> None:
    rows = []
    for protocol, baud in CASES:
        for kind in LINES:
            spans = [one_run(kind, protocol, baud) for _ in range(RUNS)]
            rows.append([protocol, str(baud), kind, told(spans)])
    text = (
        "From SIGINT to the last byte seen by a bare peer, in ms; median (minimum to maximum) of "
        f"those of {RUNS} runs in which a byte came after the signal at all. In every run "
        "the peer's count lay between the two counts of the end event. Bound: the window, "
        "27.5 ms of line, which TCP and a pty hand over at once and a serial line would still be carrying; goal: "
        "100 ms with it.\n\n"
    )
    write_section("ctrl-c", "Ctrl-C to the last byte", text + table(["protocol", "baud", "line", "ms"], rows))


if __name__ == "__main__":
    main()
