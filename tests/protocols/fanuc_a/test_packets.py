"""Packets of expansion A against vectors, both ways, and whatever the pieces they come in."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tapewire.protocols.fanuc_a.messages import Coding, Command, Message
from tapewire.protocols.fanuc_a.packets import (
    BadMonitor,
    BadPacket,
    HostReader,
    Kind,
    Monitor,
    MonitorCode,
    MonitorPacket,
    MonitorSum,
    Packet,
    PacketReader,
    encode_monitor,
    encode_packet,
    next_number,
    packet_bytes,
)
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.words import Words

VECTORS: dict[str, Any] = json.loads((Path(__file__).parents[2] / "vectors" / "fanuc_a.json").read_text())


def read_packets(reader: PacketReader, data: bytes) -> list[Packet | BadPacket]:
    found, position = [], 0
    while position < len(data):
        position, reading = reader.read(data, position)
        if reading is not None:
            found.append(reading)
    return found


def read_host(reader: HostReader, data: bytes) -> list[object]:
    found: list[object] = []
    position = 0
    while position < len(data):
        position, reading = reader.read(data, position)
        if reading is not None:
            found.append(reading)
    return found


def host_reader(*, monitors: bool = True) -> HostReader:
    reader = HostReader(Coding(), longest=72)
    reader.monitors = monitors
    return reader


class Test52:
    """Data packet format."""

    @pytest.mark.parametrize("vector", VECTORS["packets"], ids=lambda v: f"{v['number']}-{v['tail']}")
    def test_packets_both_ways(self, vector: dict[str, str]) -> None:
        begins = bytes.fromhex(vector["begins"])
        fill = begins if "repeated" in vector else bytes.fromhex(vector["pad"])
        data = (begins + fill * 256)[:256]
        number = int(vector["number"], 16)
        wire = encode_packet(number, data, 1)
        assert wire == bytes([number]) + data + bytes.fromhex(vector["tail"])
        assert read_packets(PacketReader(1), wire) == [Packet(number=number, data=data)]

    @pytest.mark.parametrize(("n", "length"), [(1, 260), (2, 516), (4, 1028)])
    def test_length(self, n: int, length: int) -> None:
        assert packet_bytes(n) == length == len(encode_packet(0x30, bytes(256 * n), n))

    def test_numbers_go_round(self) -> None:
        numbers = [0x30]
        while len(numbers) < 12:
            numbers.append(next_number(numbers[-1]))
        assert bytes(numbers) == b"012345678901"

    def test_kinds(self) -> None:
        kinds = {number: Packet(number=number, data=b"").kind for number in (0x30, 0x39, 0xFF, 0x00, 0x2F, 0x3A)}
        invalid = dict.fromkeys((0x00, 0x2F, 0x3A), Kind.INVALID)
        assert kinds == {0x30: Kind.EFFECTIVE, 0x39: Kind.EFFECTIVE, 0xFF: Kind.END} | invalid

    @pytest.mark.parametrize("at", [0, 1, 100, 256, 257, 258, 259])
    def test_one_bad_character_spoils_one_packet(self, at: int) -> None:
        first, second = (bytearray(encode_packet(number, bytes(range(256)), 1)) for number in (0x30, 0x31))
        first[at] ^= 0x10
        [bad, good] = read_packets(PacketReader(1), bytes(first + second))
        assert isinstance(bad, BadPacket)
        assert bad.number == first[0]
        assert good == Packet(number=0x31, data=bytes(range(256)))

    @pytest.mark.parametrize("at", [0, 1, 100, 259])
    @pytest.mark.parametrize("gained", [b"", b"xy"], ids=["lost", "gained"])
    def test_a_lost_or_gained_character_spoils_one_packet(self, at: int, gained: bytes) -> None:
        packets = [encode_packet(number, bytes(range(256)), 1) for number in b"01234"]
        wire = packets[0] + packets[1][:at] + gained + packets[1][at + 1 :] + b"".join(packets[2:])
        found = read_packets(PacketReader(1), wire)
        assert [reading.number for reading in found if isinstance(reading, Packet)] == list(b"0234")
        assert sum(isinstance(reading, BadPacket) for reading in found) == 1

    def test_damage_spoils_a_packet_whose_sum_is_right(self) -> None:
        wire = encode_packet(0x30, bytes(256), 1)
        reader = PacketReader(1)
        assert read_packets(reader, wire[:10]) == []
        assert reader.pending == 10
        reader.damage()
        assert read_packets(reader, wire[10:]) == [BadPacket(number=0x30, why="a damaged character")]

    def test_restart_forgets(self) -> None:
        reader = PacketReader(1)
        read_packets(reader, b"garbage")
        assert (reader.restart(), reader.pending) == (7, 0)
        wire = encode_packet(0x30, bytes(256), 1)
        assert read_packets(reader, wire) == [Packet(number=0x30, data=bytes(256))]

    @given(
        parts=st.lists(st.sampled_from([encode_packet(n, bytes(256), 1) for n in b"01\xff\x00"]) | st.binary()),
        cuts=st.lists(st.integers(0, 1500)),
    )
    def test_the_same_whatever_the_pieces(self, parts: list[bytes], cuts: list[int]) -> None:
        whole = b"".join(parts)
        pieces, reader = PacketReader(1), PacketReader(1)
        bounds = [0, *sorted(min(cut, len(whole)) for cut in cuts), len(whole)]
        found = [r for at, to in pairwise(bounds) for r in read_packets(pieces, whole[at:to])]
        assert found == read_packets(reader, whole)
        assert pieces.pending == reader.pending < 260


class Test53:
    """Monitor packet format."""

    @pytest.mark.parametrize("vector", VECTORS["monitors"], ids=lambda v: f"{v['monitor']}{v['number']}{v['code']}")
    @pytest.mark.parametrize("covers", MonitorSum)
    def test_monitors_both_ways(self, vector: dict[str, str], covers: MonitorSum) -> None:
        monitor = Monitor[vector["monitor"]]
        number = int(vector["number"], 16) if vector["number"] else None
        wire = bytes.fromhex(vector["with_end" if covers is MonitorSum.WITH_END else "without_end"])
        code = MonitorCode(vector["code"])
        assert encode_monitor(monitor, number=number, code=code, sum_covers=covers) == wire
        [reading] = read_host(host_reader(), wire)
        assert reading == MonitorPacket(monitor=monitor, number=number, sum_covers=covers, first_byte=wire[0])

    @pytest.mark.parametrize("covers", MonitorSum)
    @pytest.mark.parametrize("code", MonitorCode)
    @pytest.mark.parametrize("monitor", Monitor)
    def test_every_form_is_understood(self, monitor: Monitor, code: MonitorCode, covers: MonitorSum) -> None:
        for number in b"0123456789" if monitor is Monitor.NAK else [None]:
            wire = encode_monitor(monitor, number=number, code=code, sum_covers=covers)
            [reading] = read_host(host_reader(), wire)
            assert isinstance(reading, MonitorPacket)
            assert (reading.monitor, reading.number, reading.sum_covers) == (monitor, number, covers)

    def test_dc3_as_printed_stands_among_ascii(self) -> None:
        firsts = {
            monitor: encode_monitor(monitor, number=0x30 if monitor is Monitor.NAK else None)[0] for monitor in Monitor
        }
        assert firsts == {Monitor.CAN: 0x18, Monitor.NAK: 0x15, Monitor.DC3: 0x93, Monitor.DC1: 0x11}

    def test_monitors_and_messages_are_told_apart_by_the_first_byte(self) -> None:
        can = encode_monitor(Monitor.CAN)
        found = read_host(host_reader(), b"07SYN\r" + can + b"07SYN\r")
        assert found == [
            Message(command=Command.SYN),
            MonitorPacket(monitor=Monitor.CAN, first_byte=0x18),
            Message(command=Command.SYN),
        ]

    def test_outside_of_packets_a_monitor_is_no_message(self) -> None:
        [reading] = read_host(host_reader(monitors=False), encode_monitor(Monitor.CAN))
        assert not isinstance(reading, MonitorPacket)

    @given(at=st.integers(0, 4), flip=st.integers(0, 7))
    def test_one_flipped_bit_is_never_another_monitor(self, at: int, flip: int) -> None:
        for monitor in Monitor:
            wire = bytearray(encode_monitor(monitor, number=0x35 if monitor is Monitor.NAK else None))
            wire[at] ^= 1 << flip
            for reading in read_host(host_reader(), bytes(wire)):
                assert not isinstance(reading, MonitorPacket) or reading.monitor is monitor

    @pytest.mark.parametrize("lost", range(1, 5))
    def test_a_lost_character_ends_it_early(self, lost: int) -> None:
        wire = encode_monitor(Monitor.DC1)
        reader = host_reader()
        found = read_host(reader, wire[:lost] + wire[lost + 1 :])
        raw = wire[:lost] + wire[lost + 1 :]
        assert (found or [reader.break_off()]) == [BadMonitor(raw=raw)]
        assert reader.pending == 0

    def test_damage(self) -> None:
        reader = host_reader()
        wire = encode_monitor(Monitor.DC1)
        read_host(reader, wire[:2])
        reader.damage()
        assert read_host(reader, wire[2:] + wire) == [
            BadMonitor(raw=wire),
            MonitorPacket(monitor=Monitor.DC1, first_byte=0x11),
        ]


def test_words_of_a_packet_dialogue() -> None:
    words = Words(Params())
    words.host(b"CBSET0000000007D00032000A000500140000000A00050000000000000001\r")
    assert words.control(b"ECGTD\r") == ["GTD"]
    data = bytes(range(256))
    sent = encode_packet(0x30, data, 1) + encode_packet(0, bytes(256), 1) + b"x" * 260 + encode_packet(0xFF, data, 1)
    said = words.host(sent)
    bad = "(bad packet 78: no end code at its place)"
    assert said == ["packet 30", data, "invalid packet 00", bad, "packet FF", data]
    nak = encode_monitor(Monitor.NAK, number=0x31)
    assert words.control(nak + encode_monitor(Monitor.DC3)) == ["NAK 31", "DC3"]
    assert words.control(b"E7ALM\r") == ["ALM"]
    assert words.host(b"DBAAL\r") == ["AAL"]
