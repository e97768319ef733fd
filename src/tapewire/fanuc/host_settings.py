"""From the parameters of a machine to the settings of a host that suits it (B-63322EN-1/01 2.1, 2.2, 3.1, 10.2)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import ceil
from types import MappingProxyType
from typing import Final

from tapewire.codes import DataCode
from tapewire.errors import UsageError
from tapewire.fanuc.parameter_check import Finding, Weight, check, refuse_unusable
from tapewire.fanuc.parameters import BAUD_CODES, LINE_NUMBERS, REMOTE_BUFFER_DEVICE, Interface, ParameterSet
from tapewire.g05.layout import AuxiliaryUse, BinaryInput, Layout, RecordFormat, UnitTime, required_baud

__all__ = ["ControlSettings", "HostSettings", "control_settings", "host_settings", "longest_cable_m"]

PROTOCOL_A: Final = "fanuc-a"
EXPANSION_A: Final = "fanuc-a-expansion"
PROTOCOL_B: Final = "fanuc-b"
EXPANSION_B: Final = "fanuc-b-expansion"

_BY_NUMBER: Final[Mapping[int, tuple[str, ...]]] = MappingProxyType(
    {1: (PROTOCOL_B,), 2: (EXPANSION_B,), 3: (PROTOCOL_A, EXPANSION_A)}
)
_OVER_RS_422_ALONE: Final = (EXPANSION_A, EXPANSION_B)
"""2.2; 5084 offers both for RS-232-C too."""

_CLOCKED_FROM_BAUD: Final = 38400
"""From here on the receive clock is always the sender's (5070 note 1)."""

_PACKET_FRAME: Final = 4
"""Characters of a packet beside its data (5.2): number, sum, end code."""
_BITS_PER_CHARACTER: Final = 11
_POWER_ON_TO_S: Final = 20
"""To at power-on (4.5)."""

_CABLES: Final[Mapping[Interface, tuple[tuple[int, int], ...]]] = MappingProxyType(
    {
        Interface.RS_232_C: ((4800, 100), (9600, 50), (19200, 15)),
        Interface.RS_422: ((9600, 800), (86400, 50)),
    }
)
"""2.1: up to so many baud, at most so many metres."""


def longest_cable_m(interface: Interface, baud: int) -> int | None:
    """The longest cable 2.1 allows, in metres; None for a rate beyond the interface."""
    return next((metres for limit, metres in _CABLES[interface] if baud <= limit), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class HostSettings:
    """What a host must be told. `settings` are `--set` words; `data` is the code of programs in each direction."""

    interface: Interface
    protocol: str
    alternatives: tuple[str, ...]
    """Protocols that the host may choose instead, with the same parameters."""
    baud: int
    stopbits: int
    settings: Mapping[str, str]
    data_to_control: DataCode | None
    """None: 0000 was not told."""
    data_from_control: DataCode | None
    findings: tuple[Finding, ...]

    def command(self, verb: str, *, file: str = "FILE", line: str = "LINE") -> str:
        """The command line, `verb` being send or receive. `--line` is for the user to fill in."""
        data = self.data_to_control if verb == "send" else self.data_from_control
        words = dict(self.settings) | ({} if data is None else {"data": str(data)})
        options = [f"--protocol {self.protocol}", f"--baud {self.baud}", f"--stopbits {self.stopbits}"]
        options += [f"--set {key}={value}" for key, value in words.items()]
        return " ".join(["tapewire", verb, file, f"--line {line}", *options])

    def control_command(self, control: ControlSettings, *, line: str = "LINE") -> str:
        """The command line of a simulated control with the same parameters."""
        options = [f"--protocol {self.protocol}", f"--baud {control.baud}", f"--stopbits {control.stopbits}"]
        options += [f"--set {key}={value}" for key, value in control.settings.items()]
        return " ".join(["tapewire", "cnc", f"--line {line}", *options])

    @property
    def receives(self) -> bool:
        """Protocol A has no punch-out (2.2, chapter 1 2))."""
        return self.protocol in (PROTOCOL_B, EXPANSION_B)


def host_settings(
    parameters: ParameterSet,
    *,
    board: Interface | None = None,
    protocol: str | None = None,
    cable_length_m: float | None = None,
) -> HostSettings:
    """The settings that suit a control with these parameters.

    `board` is needed where 5000 was not told; `protocol` chooses between A and expansion A, which the control leaves
    to the host. Raises UsageError with everything that is wrong, SR807 where the control would raise it.
    """
    interface = board or parameters.interface
    if interface is None:
        raise UsageError("No. 5000 is missing: its bit 0 says whether the board has RS-232-C or RS-422")
    findings = check(parameters, interface) + tuple(_missing(parameters, interface))
    refuse_unusable(findings)
    numbers = LINE_NUMBERS[interface]
    baud = BAUD_CODES[parameters.values[numbers.baud]]
    chosen, others = _choose(_BY_NUMBER[parameters.values[numbers.protocol]], interface, protocol)
    findings += tuple(_about_the_line(parameters, interface, chosen, baud, cable_length_m))
    findings += tuple(_about_devices(parameters, interface, chosen))
    findings += tuple(_about_binary_input(parameters, chosen, baud))
    refuse_unusable(findings)
    to_control, from_control = _data_codes(parameters)
    if to_control is None:
        text = "No. 0000 was not told: programs go in ASCII; with 0000#2 = 0 the control expects --set data=iso"
        findings += (Finding(weight=Weight.NOTE, number=0, text=text),)
    return HostSettings(
        interface=interface,
        protocol=chosen,
        alternatives=others,
        baud=baud,
        stopbits=parameters.values[numbers.stop_bits],
        settings=_host_words(parameters, chosen, baud),
        data_to_control=to_control,
        data_from_control=from_control,
        findings=findings,
    )


def _missing(parameters: ParameterSet, interface: Interface) -> Iterator[Finding]:
    numbers = LINE_NUMBERS[interface]
    names = {numbers.protocol: "the protocol", numbers.baud: "the baud rate", numbers.stop_bits: "the stop bits"}
    for number, name in names.items():
        if number not in parameters:
            text = f"No. {number} is missing: {name} of {interface}"
            yield Finding(weight=Weight.ERROR, number=number, text=text)


def _choose(names: tuple[str, ...], interface: Interface, wanted: str | None) -> tuple[str, tuple[str, ...]]:
    """Expansion A where its interface is; the host decides by SET (2.2, 5074)."""
    if wanted is not None and wanted not in names:
        raise UsageError(f"the control is set to {' or '.join(names)}, not to {wanted}: see No. 5074 or 5084")
    allowed = [name for name in names if interface is Interface.RS_422 or name not in _OVER_RS_422_ALONE] or names
    chosen = wanted or allowed[-1]
    return chosen, tuple(name for name in allowed if name != chosen)


def _host_words(parameters: ParameterSet, protocol: str, baud: int) -> Mapping[str, str]:
    tcc, etx = parameters.bit(5000, 2), parameters.bit(5000, 3)
    binary = binary_input(parameters)
    records = {} if binary is None else {"g05": str(binary)}
    if protocol in (PROTOCOL_A, EXPANSION_A):
        words = {"code": "iso" if tcc else "ascii", "end": "etx" if etx else "cr"}
        return MappingProxyType(words | (_packet_words(baud) if protocol == EXPANSION_A else {}) | records)
    return MappingProxyType({"code": "ascii" if tcc else "iso", "posting": "on" if etx else "off"} | records)


def binary_input(parameters: ParameterSet) -> BinaryInput | None:
    """The records of binary input operation (10.3); None where 7635 was not told, or is 0."""
    axes, unit_time_ms = parameters.get(7635), parameters.unit_time_ms
    if not axes or unit_time_ms is None:
        return None
    layout = Layout(
        axis_count=axes,
        format=RecordFormat.GENERAL if parameters.bit(7609, 2) else RecordFormat.SPECIAL,
        auxiliary=AuxiliaryUse.USED if parameters.bit(7609, 3) else AuxiliaryUse.UNUSED,
    )
    return BinaryInput(layout=layout, unit_time=UnitTime(unit_time_ms))


def _packet_words(baud: int) -> dict[str, str]:
    """Packets short enough for the rate: one that takes longer than To is SR944 (5.4 7)), so half of To at most."""
    for data_bytes in (1024, 512, 256):
        seconds = (data_bytes + _PACKET_FRAME) * _BITS_PER_CHARACTER / baud
        if 2 * seconds <= _POWER_ON_TO_S:
            return {} if data_bytes == 1024 else {"n": str(data_bytes // 256)}
    return {"n": "1", "To": str(ceil(2 * seconds))}


def _data_codes(parameters: ParameterSet) -> tuple[DataCode | None, DataCode | None]:
    """Code of programs to the control (0000#2) and from it (0000#2 and #4)."""
    if 0 not in parameters:
        return None, None
    iso = DataCode.ASCII if parameters.bit(0, 2) else DataCode.ISO
    return iso, DataCode.EIA if parameters.bit(0, 4) else iso


def _about_the_line(
    parameters: ParameterSet, interface: Interface, protocol: str, baud: int, cable_length_m: float | None
) -> Iterator[Finding]:
    """2.1, 2.2 and 5070."""
    if interface is Interface.RS_232_C and protocol in _OVER_RS_422_ALONE:
        text = f"{protocol} on RS-232-C: No. 5084 offers it, 2.2 gives it for RS-422 alone"
        yield Finding(weight=Weight.WARNING, number=5084, text=text)
    if interface is Interface.RS_232_C and baud >= 19200:
        text = "19200 baud on RS-232-C is allowed to 15 m; 2.1 note 2 asks for RS-422 from this rate on"
        yield Finding(weight=Weight.NOTE, number=5083, text=text)
    longest = longest_cable_m(interface, baud)
    assert longest is not None, "the tables of 5073 and 5083 end where 2.1 does"
    if cable_length_m is not None and cable_length_m > longest:
        limit = f"{interface} at {baud} baud goes to {longest} m (2.1)"
        text = f"a cable of {cable_length_m:g} m: {limit}; {_slower(interface, cable_length_m)}"
        yield Finding(weight=Weight.WARNING, text=text)
    if interface is Interface.RS_422:
        yield from _about_the_clock(parameters, baud)
    elif not parameters.bit(5000, 4):
        text = "5000#4 = 0, CD is checked: strap CD to ER at the control's side (3.2)"
        yield Finding(weight=Weight.NOTE, number=5000, text=text)


def _about_binary_input(parameters: ParameterSet, protocol: str, baud: int) -> Iterator[Finding]:
    """9.1 (5) note, 9.2."""
    binary = binary_input(parameters)
    if binary is None or binary.layout is None:
        return
    needed = required_baud(binary.layout, binary.unit_time)
    if needed > baud:
        text = (
            f"binary input operation, {binary.layout}, {binary.unit_time.value} ms, needs {needed} baud (9.2): "
            f"at {baud} the axes would stop between records"
        )
        yield Finding(weight=Weight.WARNING, number=7618, text=text)
    if protocol == PROTOCOL_A and binary.layout.format is RecordFormat.GENERAL:
        text = "7609#2 = 1: protocol A carries records in the special format alone (9.1 (5) note)"
        yield Finding(weight=Weight.WARNING, number=7609, text=text)


def _slower(interface: Interface, cable_length_m: float) -> str:
    rates = [limit for limit, metres in _CABLES[interface] if metres >= cable_length_m]
    if rates:
        return f"at {rates[-1]} baud or less it may be so long"
    other = "use RS-422" if interface is Interface.RS_232_C else "use a line driver or a serial server"
    return f"no rate allows so long a cable: {other}"


def _about_the_clock(parameters: ParameterSet, baud: int) -> Iterator[Finding]:
    lowest = parameters.get(5070)
    if baud >= _CLOCKED_FROM_BAUD or (lowest is not None and parameters.values[5073] >= lowest):
        way_out = "" if baud >= _CLOCKED_FROM_BAUD else "; or set No. 5070 above No. 5073, and the clock is not used"
        text = (
            f"at {baud} baud the control receives with the host's clock (No. 5070): wire TT and RT both ways, and use "
            f"a port that gives its transmit clock out, which an ordinary one does not{way_out}"
        )
        yield Finding(weight=Weight.WARNING, number=5070, text=text)
    elif lowest is None:
        text = "No. 5070 was not told: where it is not above No. 5073 the control expects the host's clock"
        yield Finding(weight=Weight.NOTE, number=5070, text=text)


def _about_devices(parameters: ParameterSet, interface: Interface, protocol: str) -> Iterator[Finding]:
    device = parameters.get(20)
    if device is not None and device != REMOTE_BUFFER_DEVICE:
        text = f"No. 0020 is {device}: DNC operation reads from there, and not from the remote buffer, which is 10"
        yield Finding(weight=Weight.WARNING, number=20, text=text)
    number = LINE_NUMBERS[interface].specification
    specification = parameters.get(number)
    if specification is None or protocol in (PROTOCOL_A, EXPANSION_A):
        return
    if specification in (2, 4):
        text = (
            f"No. {number} is {specification}: the control sends no DC1, and the host would wait for ever; set 1 or 3"
        )
        yield Finding(weight=Weight.ERROR, number=number, text=text)
    elif specification not in (1, 3):
        text = f"No. {number} is {specification}: that is no host computer; set 1 or 3"
        yield Finding(weight=Weight.ERROR, number=number, text=text)
    elif specification == 1:
        text = f"No. {number} is 1: punch-outs begin and end with feed, which `receive` leaves out"
        yield Finding(weight=Weight.NOTE, number=number, text=text)


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlSettings:
    """What a simulated control with these parameters is made of."""

    protocol: str
    baud: int
    stopbits: int
    settings: Mapping[str, str]
    punches_feed: bool
    """Specification numbers 1 and 2 (10.2)."""


def control_settings(parameters: ParameterSet, board: Interface) -> ControlSettings:
    """The simulated control behind `parameters`, read from chapter 10 apart from `host_settings`.

    Raises UsageError as the control raises SR807. For protocol A it is the host's SET that chooses the expansion.
    """
    refuse_unusable(check(parameters, board))
    numbers = LINE_NUMBERS[board]
    specification, stopbits, baud, number = (parameters.values.get(each, 1) for each in numbers)
    cd = board is Interface.RS_232_C and not parameters.bit(5000, 4)
    words = {"data": "ascii" if parameters.bit(0, 2) else "iso", "cd": "on" if cd else "off"}
    match number, parameters.bit(5000, 2):
        case 3, 0:
            words["code"] = "ascii"
        case 3, 1:
            words["code"] = "iso"
        case _, 0:
            words["code"] = "iso"
        case _, _:
            words["code"] = "ascii"
    if parameters.get(7635):
        form, use = parameters.bit(7609, 2), parameters.bit(7609, 3)
        kind = f"{('special', 'general')[form]},{('no-aux', 'aux')[use]}"
        words["g05"] = f"{parameters.get(7635)},{kind},{parameters.unit_time_ms}ms"
    if number == 3:
        words |= {"end": ("cr", "etx")[parameters.bit(5000, 3)], "echo": ("off", "on")[parameters.bit(5000, 1)]}
    else:
        words["posting"] = ("off", "on")[parameters.bit(5000, 3)]
    return ControlSettings(
        protocol=_BY_NUMBER[number][0],
        baud=BAUD_CODES[baud],
        stopbits=stopbits,
        settings=MappingProxyType(words),
        punches_feed=specification in (1, 2),
    )
