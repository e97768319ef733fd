"""Puts what is said on a line of protocol A or expansion A into words, for transcripts."""

from __future__ import annotations

import dataclasses
from typing import TypeAlias

from tapewire.protocols.fanuc_a.messages import (
    Command,
    DataError,
    Message,
    MessageReader,
    Unreadable,
    encode_message,
)
from tapewire.protocols.fanuc_a.packets import (
    BadMonitor,
    BadPacket,
    HostReader,
    Kind,
    Monitor,
    MonitorPacket,
    PacketReader,
)
from tapewire.protocols.fanuc_a.params import Params
from tapewire.protocols.fanuc_a.status import LIMITS, POWER_ON, Parameters, Setting, Status

__all__ = ["Words"]

Word: TypeAlias = str | bytes


class Words:
    """Listens to both ends of one line.

    What the host sends after a GTD is packets when its last SET said so, or the last SAT since. It is until the control
    says a message: behind the end packet the same packets may come again. The one message a host has for a control
    that awaits packets is SYN; no program holds one, since no block holds its end code.
    """

    def __init__(self, params: Params) -> None:
        self._control = HostReader(params.coding, longest=72)
        self._host = MessageReader(params.coding)
        self._packets: PacketReader | None = None
        self._parameters = POWER_ON
        self._n = 0
        self._syn = encode_message(Message(command=Command.SYN), params.coding)
        self._before = b""

    def control(self, data: bytes) -> list[Word]:
        """What the control sent."""
        words: list[Word] = []
        self._control.monitors = self._n > 0
        position = 0
        while position < len(data):
            position, reading = self._control.read(data, position)
            match reading:
                case None:
                    pass
                case MonitorPacket(monitor=Monitor.NAK, number=number):
                    words.append(f"NAK {number:02X}")
                case MonitorPacket(monitor=monitor):
                    words.append(monitor.name)
                case BadMonitor(raw=raw):
                    words.append(f"(bad monitor packet {raw.hex(' ')})")
                case Message(command=Command.GTD):
                    words.append("GTD")
                    self._packets = PacketReader(self._n) if self._n else None
                    self._before = b""
                case Message() | Unreadable():
                    self._packets = None
                    words.append(self._of_message(reading))
        return words

    def host(self, data: bytes) -> list[Word]:
        """What the host sent. The data of DAT and of effective packets are program bytes."""
        words: list[Word] = []
        position = 0
        while position < len(data):
            if self._packets is not None:
                end = self._end_of_syn(data, position)
                position = self._read_packet(self._packets, data[:end], position, words)
                if position == end:
                    cut_off = self._packets.restart() - len(self._syn)
                    words += [f"({cut_off} characters of a packet)"] if cut_off > 0 else []
                    words.append("SYN")
                continue
            position, reading = self._host.read(data, position)
            match reading:
                case None:
                    pass
                case Message(command=Command.DAT, data=program):
                    words += ["DAT", program]
                case Message() | Unreadable():
                    words.append(self._of_message(reading))
        return words

    def _end_of_syn(self, data: bytes, position: int) -> int | None:
        """Where in `data` a SYN ends; what has been looked at before counts, in whatever pieces it came."""
        self._before = self._before[-len(self._syn) + 1 :]
        at = (self._before + data[position:]).find(self._syn)
        return None if at < 0 else at + len(self._syn) - len(self._before) + position

    def _read_packet(self, reader: PacketReader, data: bytes, position: int, words: list[Word]) -> int:
        begin = position
        position, packet = reader.read(data, begin)
        match packet:
            case None:
                pass
            case BadPacket(number=number, why=why):
                words.append(f"(bad packet {number:02X}: {why})")
            case _ if packet.kind is Kind.INVALID:
                words.append(f"invalid packet {packet.number:02X}")
            case _:
                words += [f"packet {packet.number:02X}", packet.data]
        self._before = (self._before + data[begin:position])[-len(self._syn) + 1 :]
        return position

    def _of_message(self, reading: Message | Unreadable) -> str:
        if isinstance(reading, Unreadable):
            return f"({reading.error})"
        try:
            return f"{reading.command.value} {self._detail(reading)}".rstrip()
        except DataError as error:
            return f"{reading.command.value} ({error})"

    def _detail(self, message: Message) -> str:
        data = message.data
        match message.command:
            case Command.SAT:
                status = Status.parse(data, self._parameters)
                self._parameters = status.parameters
                self._n = status.parameters.packet_n
                return f"{status.state.name.lower().replace('_', ' ')}, {status.stored} stored"
            case Command.SET if data:
                wanted = Setting.parse(data, self._parameters).parameters
                self._n = wanted.packet_n
                return _changes(self._parameters, wanted)
            case Command.RTY | Command.SDI | Command.SDO:
                return data.decode("latin-1").rstrip()
            case _:
                return ""


def _changes(before: Parameters, after: Parameters) -> str:
    names = {field: limit.name for field, limit in LIMITS.items()}
    return " ".join(
        f"{names.get(field.name, field.name)}={getattr(after, field.name)}"
        for field in dataclasses.fields(Parameters)
        if getattr(after, field.name) != getattr(before, field.name)
    )
