"""`tapewire qualify`: against a loop-back plug, a line that damages, a control, and a talker at an unknown rate."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tests.cli.helpers import Shop, program

WORDS = ("--protocol", "fanuc-b", "--baud", "38400", "--json", "--timeout", "60")


@contextmanager
def far_end(change: Callable[[bytes], bytes]) -> Iterator[str]:
    """A LINE at whose end everything comes back as `change` makes it."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def work() -> None:
            connection, _ = listener.accept()
            with connection:
                while data := connection.recv(4096):
                    connection.sendall(change(data))

        thread = threading.Thread(target=work)
        thread.start()
        yield f"socket://127.0.0.1:{listener.getsockname()[1]}"
        thread.join(10)


def test_a_loop_back_plug_proves_a_line(shop: Shop) -> None:
    report = shop.folder / "in-report.json"
    with far_end(bytes) as line:
        judged = shop.run("qualify", "--line", line, "--loop-back", "--report", report, *WORDS)
    assert judged.outcome == (0, "complete"), judged.stderr
    assert "fit for drip feed by fanuc-b at 38400 baud, with 96 characters in flight" in judged.end["reason"]
    facts = json.loads(report.read_text())
    assert facts["fit"]
    told = " ".join(finding["text"] for finding in facts["findings"])
    for words in ("0 wrong or lost", "after 10 stops at most", "no control lines", "of the line in use"):
        assert words in told
    page = report.with_suffix(".html").read_text()
    assert facts["verdict"] in page
    assert "http" not in page
    again = shop.run("qualify", "--line", line, "--report", report, *WORDS)
    assert again.status == 2


def test_a_line_that_damages_is_not_fit(shop: Shop) -> None:
    with far_end(lambda data: data.replace(b"\x31", b"\x30")) as line:
        judged = shop.run("qualify", "--line", line, "--loop-back", *WORDS)
    assert judged.outcome == (1, "failed")
    assert "not fit" in judged.end["reason"]
    assert "wrong or lost" in judged.end["reason"]


def test_no_plug_is_told(shop: Shop) -> None:
    with far_end(lambda data: b"") as line:
        judged = shop.run("qualify", "--line", line, "--loop-back", *WORDS)
    assert judged.outcome == (1, "failed")
    assert "is the plug on?" in judged.end["reason"]


def test_a_protocol_that_tolerates_less_than_the_line_states_is_not_fit(shop: Shop) -> None:
    with far_end(bytes) as line:
        judged = shop.run("qualify", "--line", line, "--protocol", "bridgeport", "--json")
    assert judged.outcome == (1, "failed")
    assert "more may be under way than the control tolerates" in judged.end["reason"]


def test_a_control_and_its_cable(shop: Shop) -> None:
    words = ("--protocol", "fanuc-b", "--baud", "38400", "--json", "--timeout", "60")
    control = shop.start("cnc", "--line", "rfc2217+listen://127.0.0.1:0", *words)
    line = f"rfc2217://127.0.0.1:{control.port}"
    looked = shop.run("qualify", "--line", line, *words)
    assert looked.outcome == (0, "complete")
    assert "nothing was proved" in looked.end["reason"]
    told = " ".join(event["text"] for event in looked.named("notice"))
    assert "CTS is ON whatever we drive" in told
    control.interrupt()
    control.finish()


def test_a_program_is_given_as_a_job(shop: Shop) -> None:
    file, path = shop.file("in.nc", program(60)), shop.folder / "line"
    control = shop.start("cnc", "--line", f"pty:{path}", *WORDS)
    control.wait_for("ready")
    judged = shop.run("qualify", "--line", path, "--send", file, *WORDS)
    assert judged.outcome == (0, "complete")
    assert judged.end["bytes"] == len(program(60))
    assert "fit for drip feed" in judged.end["reason"]
    assert control.finish().outcome == (0, "complete")


def test_it_can_be_stopped_and_has_an_end(shop: Shop) -> None:
    waiting = shop.start("qualify", "--line", "listen://127.0.0.1:0", "--protocol", "fanuc-b", "--json")
    waiting.wait_for("ready")
    waiting.interrupt()
    assert waiting.finish().outcome == (130, "cancelled")
    late = shop.run("qualify", "--line", "listen://127.0.0.1:0", *WORDS[:-1], "0.5")
    assert late.outcome == (1, "failed")
    assert "not complete within 0.5 s" in late.end["reason"]


def test_a_port_that_cannot_be_opened_is_told_as_ever(shop: Shop) -> None:
    judged = shop.run("qualify", "--line", shop.folder / "none", *WORDS)
    assert judged.outcome == (1, "failed")
    assert "plugged in" in judged.end["reason"]
