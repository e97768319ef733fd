"""Protocol A and expansion protocol A."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from functools import partial
from typing import Final

from docs.generators.markup import (
    constants,
    dialogues,
    members_said,
    members_table,
    names_of,
    settings_of,
    states_said,
    table,
)
from tapewire.protocols import fanuc_a
from tapewire.protocols.fanuc_a import (
    cnc_dialogue,
    cnc_job,
    cnc_law,
    cnc_packets,
    host_agreement,
    host_exchange,
    host_law,
    host_line,
    host_packets,
    host_streaming,
    messages,
    packets,
    status,
)
from tapewire.protocols.fanuc_a.messages import Command


def _commands() -> str:
    """The table of 4.4.1: who sends it, what the host may answer, what its data is."""
    said = members_said(Command)
    rows = [
        (
            command.name,
            messages.ORIGINS[command],
            said[command.name],
            _command_names(messages.ANSWERS.get(command, frozenset())),
            _data_of(command),
        )
        for command in Command
    ]
    return table(("command", "from", "meaning", "the host may answer", "data"), rows)


def _command_names(commands: AbstractSet[Command]) -> str:
    return " ".join(command.name for command in Command if command in commands)


def _data_of(command: Command) -> str:
    match command:
        case Command.DAT:
            return f"NC data, at most {messages.LONGEST_DAT} bytes, and at most Nb - No"
        case Command.SAT:
            return "state, stored, parameters: 56 or 72 positions"
        case Command.SET:
            return "parameters: 56 or 72 positions, or none"
        case Command.RTY:
            reasons = (f"{reason.value.decode()} {reason.name.lower()}" for reason in messages.RetryReason)
            return f"one digit: {', '.join(reasons)}"
        case Command.SDI | Command.SDO:
            return "two hexadecimal digits"
        case _:
            return ""


def _positions() -> str:
    """All 72 positions of SAT and SET; those of the parameters as the code has them."""
    states = ", ".join(f"{state.value} {state.name.lower().replace('_', ' ')}" for state in status.BufferState)
    causes = ", ".join(f"{cause.value} {cause.name.lower().replace('_', ' ')}" for cause in status.AlarmCause)
    rows = [
        ((1, 1), "the digit of the last SET, or always 0 (5000#1)", "`switching`", ""),
        ((2, 2), f"state: {states}", "ignored", "0"),
        ((3, 3), f"cause of the alarm: {causes}", "not used", "0"),
        ((4, 4), "not used", "not used", ""),
        ((5, 8), "bytes in the buffer", "not used", "0000"),
        ((49, 54), "not used", "not used", ""),
        ((status.USED_LENGTH + 1, messages.LONGEST_DATA), "not used; may be missing", "not used; may be missing", ""),
    ]
    rows += [
        (span, _parameter_said(field), _parameter_said(field), _hexadecimal(field, span))
        for field, span in status._POSITIONS.items()
    ]
    rows.sort()
    header = ("positions", "SAT", "SET", "at power-on")
    return table(
        header, [(f"{a}" if a == b else f"{a} to {b}", sat, set_, initial) for (a, b), sat, set_, initial in rows]
    )


def _parameter_said(field: str) -> str:
    others = {
        "unit": f"unit of Tp: {status.TENTHS_OF_SECONDS:04X} is 0.1 s (P2), 0000 is 1 s",
        "convert_from": "code to be converted",
        "convert_to": "code after conversion; 00 and 00: none",
        "n": "n: 01, 02, 04 packets; anything else protocol A",
    }
    limit = status.LIMITS.get(field)
    return others[field] if limit is None else f"{limit.name}: {limit.meaning}"


def _hexadecimal(field: str, span: tuple[int, int]) -> str:
    return f"{getattr(status.POWER_ON, field):0{span[1] - span[0] + 1}X}"


def _parameters() -> str:
    wanted = dataclasses.asdict(fanuc_a.Params().wanted)
    rows = [
        (limit.name, limit.meaning, limit.unit, f"{limit.low} to {limit.high}", str(limit.power_on), str(wanted[field]))
        for field, limit in status.LIMITS.items()
    ]
    return table(("parameter", "meaning", "unit", "range", "at power-on", "our host asks for"), rows)


def _packet_lengths() -> str:
    rows = [(f"{n}", f"0{n}", f"{packets.data_bytes(n)}", f"{packets.packet_bytes(n)}") for n in (1, 2, 4)]
    return table(("n", "positions 55 and 56", "data", "whole packet"), rows)


def _monitors() -> str:
    said = members_said(packets.Monitor)
    rows = [
        (
            monitor.name,
            said[monitor.name],
            *(_monitor(monitor, code, packets.MonitorSum.WITHOUT_END) for code in _FORMS),
            _monitor(monitor, packets.MonitorCode.PRINTED, packets.MonitorSum.WITH_END),
        )
        for monitor in packets.Monitor
    ]
    forms = (f"`monitor={code}`" for code in _FORMS)
    return table(("packet", "meaning", *forms, "printed, `monitor_sum=with-end`"), rows)


_FORMS: Final = tuple(packets.MonitorCode)


def _monitor(monitor: packets.Monitor, code: packets.MonitorCode, covers: packets.MonitorSum) -> str:
    number = packets.NUMBERS[1] if monitor is packets.Monitor.NAK else None
    return packets.encode_monitor(monitor, number=number, code=code, sum_covers=covers).hex(" ").upper()


def _host_law() -> str:
    commands = [command for command in Command if messages.ORIGINS[command] is not messages.Origin.HOST]
    rows = [
        [f"`{state.name}`"]
        + [
            names_of(host_law.LAW[state, command].states, host_law.State) if (state, command) in host_law.LAW else "-"
            for command in commands
        ]
        for state in host_law.State
    ]
    return table(("state", *(command.name for command in commands)), rows)


def _cnc_law() -> str:
    """Each pair that has a row; what the control of its own may not be sent falls to the two alarms."""
    rows = [
        (f"`{state.name}`", _command_names(commands), f"`{act.name}`", act.value)
        for state in cnc_law.State
        for act in cnc_law.Act
        if (commands := {command for command in Command if cnc_law.LAW.get((state, command)) is act})
    ]
    return table(("state", "the host says", "act", "the control"), rows)


def _refusals() -> str:
    rows = [
        (f"`{state.name}`", *(_command_names(_refused(state, alarm)) for alarm in cnc_law.Refusal))
        for state in cnc_law.State
        if _refused(state, None)
    ]
    return table(("state", *(alarm.value for alarm in cnc_law.Refusal)), rows)


def _refused(state: cnc_law.State, alarm: cnc_law.Refusal | None) -> set[Command]:
    return {
        command
        for command in Command
        if (state, command) not in cnc_law.LAW and alarm in (None, cnc_law.refusal(state, command))
    }


def _constants() -> str:
    host = (host_exchange, host_agreement, host_line, host_packets, host_streaming)
    return constants(*host, cnc_job, cnc_dialogue, cnc_packets)


PARTS: Final[dict[str, Callable[[], str]]] = {
    "fanuc_a commands": _commands,
    "fanuc_a positions": _positions,
    "fanuc_a parameters": _parameters,
    "fanuc_a packet lengths": _packet_lengths,
    "fanuc_a monitor packets": _monitors,
    "fanuc_a settings": partial(settings_of, fanuc_a.Params),
    "fanuc_a host states": partial(states_said, host_law.State),
    "fanuc_a host law": _host_law,
    "fanuc_a host timers": partial(members_table, host_law.Timer, "deadline"),
    "fanuc_a control states": partial(states_said, cnc_law.State),
    "fanuc_a control law": _cnc_law,
    "fanuc_a control refusals": _refusals,
    "fanuc_a control timers": partial(members_table, cnc_law.Timer, "deadline"),
    "fanuc_a constants": _constants,
    **dialogues("fanuc_a", "dialogue"),
}
