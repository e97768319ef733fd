"""`--capture`: both ends of a real transfer put on record, and a disk that does not want it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tapewire.line.captures.reader import Packet, read_capture
from tapewire.line.captures.records import Happening
from tests.cli.helpers import FAST, Shop, invoke, program


def packets(path: Path) -> list[Packet]:
    with path.open("rb") as stream:
        items = list(read_capture(stream))
    found = [item for item in items if isinstance(item, Packet)]
    assert len(found) == len(items), items
    return found


def spoken(path: Path, what: Happening) -> bytes:
    return b"".join(packet.record.data for packet in packets(path) if packet.record.what is what)


@pytest.mark.parametrize(
    ("protocol", "kind"),
    [("fanuc-a-expansion", "tcp"), ("fanuc-b", "pty")],
)
def test_both_ends_put_the_same_on_record(shop: Shop, protocol: str, kind: str) -> None:
    source = shop.file("in.nc", program(60))
    link = shop.folder / "in-line"
    words = ("--protocol", protocol, *FAST, "--json")
    cnc = shop.start(
        *("cnc", "--line", "listen://127.0.0.1:0" if kind == "tcp" else f"pty:{link}", *words),
        *("--capture", shop.folder / "cnc.pcapng", "--save", shop.folder / "taken"),
    )
    ready = cnc.wait_for("ready")["line"]
    line = ready.replace("listen", "socket") if kind == "tcp" else link
    host = shop.run("send", source, "--line", line, *words, "--capture", shop.folder / "host.pcapng")
    assert host.outcome == (0, "complete")
    assert cnc.finish().outcome == (0, "complete")
    ours, theirs = shop.folder / "host.pcapng", shop.folder / "cnc.pcapng"
    assert spoken(ours, Happening.SENT) == spoken(theirs, Happening.RECEIVED)
    # What a control says last may find the host gone.
    assert spoken(theirs, Happening.SENT).startswith(spoken(ours, Happening.RECEIVED))
    assert {(packet.origin.side, packet.origin.protocol) for packet in packets(ours)} == {("host", protocol)}
    assert {packet.origin.side for packet in packets(theirs)} == {"control"}
    assert shop.files == {"host.pcapng", "cnc.pcapng", "taken"}


def test_a_failed_job_keeps_its_own_and_says_where(shop: Shop) -> None:
    words = ("--protocol", "fanuc-b", *FAST, "--json")
    cnc = shop.start("cnc", "--line", "listen://127.0.0.1:0", *words, "--alarm-after", 500)
    host = shop.run(
        *("send", shop.file("in.nc", program(5000)), "--line", f"socket://127.0.0.1:{cnc.port}", *words),
        *("--capture", shop.folder / "line.pcapng"),
    )
    assert host.outcome == (1, "failed")
    cnc.finish()
    (kept,) = [name for name in shop.files if ".failed-" in name]
    assert shop.files == {"line.pcapng", kept}
    assert (shop.folder / kept).read_bytes() == (shop.folder / "line.pcapng").read_bytes()
    assert any(kept in notice["text"] for notice in host.named("notice"))


def test_a_full_disk_stops_no_transfer_and_is_told(shop: Shop) -> None:
    source = program(3000)
    words = ("--protocol", "fanuc-b", *FAST, "--json")
    cnc = shop.start("cnc", "--line", "listen://127.0.0.1:0", *words, "--save", shop.folder / "taken")
    host = shop.start(
        *("send", shop.file("in.nc", source), "--line", f"socket://127.0.0.1:{cnc.port}", *words),
        *("--capture", shop.folder / "line.pcapng"),
        largest_file=16 * 1024,
    ).finish()
    assert host.outcome == (0, "complete")
    assert cnc.finish().outcome == (0, "complete")
    assert (shop.folder / "taken").read_bytes() == source
    told = [notice["text"] for notice in host.named("notice") if notice["text"].startswith("capture")]
    assert "the transfer goes on without it" in told[0]
    assert "records are missing" in told[-1]
    assert "the transfer goes on without it" in host.stderr
    packets(shop.folder / "line.pcapng")


@pytest.mark.parametrize("name", ["in.nc", "gone/line.pcapng", "."])
def test_a_place_for_no_capture_is_refused_before_the_line_is_opened(shop: Shop, name: str) -> None:
    source = shop.file("in.nc", program(3))
    refused = invoke(
        *("send", source, "--line", "pty:" + str(shop.folder / "line"), "--protocol", "fanuc-b", "--json"),
        *("--capture", shop.folder / name),
    )
    assert refused.outcome == (2, "failed")
    assert "capture" in refused.end["reason"]
    assert not shop.files
    assert source.read_bytes() == program(3)
