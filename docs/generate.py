"""Writes the parts of the docs that are taken from the code, each between its two markers:

    <!-- begin generated: NAME -->
    <!-- end generated: NAME -->

`scripts/docs` runs it; a test of the house fails when a page lags behind the code.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from enum import Enum
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import click

from tapewire import engine
from tapewire.cli import main as command_line
from tapewire.codes import name_of
from tapewire.engine import MILLISECOND, SECOND
from tapewire.line.pacing import WINDOW_BAUD_PER_CHARACTER, default_window
from tapewire.protocols import PROTOCOLS, bridgeport, delivery, fanuc_a
from tapewire.protocols.bridgeport import cnc as bridgeport_cnc
from tapewire.protocols.bridgeport import cnc_law as bridgeport_cnc_law
from tapewire.protocols.bridgeport import host as bridgeport_host
from tapewire.protocols.bridgeport import (
    host_job,
    host_reception,
    host_text,
    host_transmission,
    profile,
    records,
)
from tapewire.protocols.bridgeport import host_law as bridgeport_host_law
from tapewire.protocols.bridgeport import messages as bridgeport_messages
from tapewire.protocols.bridgeport.code_table import ROLES, hex_of
from tapewire.protocols.bridgeport.profile import CODE_KEYS, LINK_CONFIDENCE, RECONSTRUCTION
from tapewire.protocols.bridgeport.records import LRC_CANDIDATES, DncEnd, lrc_of
from tapewire.protocols.fanuc_a import (
    cnc_dialogue,
    cnc_job,
    cnc_packets,
    host_agreement,
    host_exchange,
    host_line,
    host_packets,
    host_streaming,
    packets,
    status,
)
from tapewire.protocols.fanuc_a import cnc_law as a_cnc_law
from tapewire.protocols.fanuc_a import host_law as a_host_law
from tapewire.protocols.fanuc_a import messages as a_messages
from tapewire.protocols.fanuc_a.messages import Command
from tapewire.protocols.fanuc_b import cnc, cnc_law, host, host_delivery, host_law, messages
from tapewire.protocols.fanuc_b.messages import EXPANSION_B, PROTOCOL_B, CodeSystem, ControlCode, Params, encode
from tapewire.protocols.settings import describe_settings

ROOT: Final = Path(__file__).parents[1]
DOCS: Final = ROOT / "docs"
TRANSCRIPTS: Final = ROOT / "tests" / "transcripts"
HELP_WIDTH: Final = 80

_MARKED: Final = re.compile(
    r"(?P<begin><!-- begin generated: (?P<name>[^\n]+?) -->\n).*?(?P<end><!-- end generated: (?P=name) -->)", re.S
)
_HEX: Final = re.compile(r"[0-9A-F]{2}")


def main() -> None:
    for page in sorted(DOCS.glob("**/*.md")):
        page.write_text(regenerated(page.read_text()))


def regenerated(text: str) -> str:
    """A page with every marked part written anew. Raises KeyError for a name that nobody makes."""
    return _MARKED.sub(lambda found: f"{found['begin']}{PARTS[found['name']]()}\n{found['end']}", text)


def marked_names(text: str) -> list[str]:
    return [found["name"] for found in _MARKED.finditer(text)]


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _block(text: str, language: str = "") -> str:
    return f"```{language}\n{text.rstrip()}\n```"


# what the source says of its own names


def _said_of(tree: ast.Module | ast.ClassDef) -> dict[str, str]:
    """Names assigned in `tree`, each with the docstring under it, empty where there is none."""
    said: dict[str, str] = {}
    for node, after in zip(tree.body, [*tree.body[1:], None], strict=True):
        match node:
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                said[name] = _string(after)
    return said


def _string(node: ast.stmt | None) -> str:
    match node:
        case ast.Expr(value=ast.Constant(value=str(text))):
            return " ".join(text.split())
    return ""


def _members_said(words: type[Enum]) -> dict[str, str]:
    tree = ast.parse(inspect.getsource(words)).body[0]
    assert isinstance(tree, ast.ClassDef)
    return _said_of(tree)


# the command line


def _help(name: str) -> str:
    context = _context(command_line, "tapewire")
    for word in name.split():
        assert isinstance(context.command, click.Group)
        command = context.command.get_command(context, word)
        assert command is not None
        context = _context(command, word, context)
    return _block(context.command.get_help(context), "text")


def _context(command: click.Command, name: str, parent: click.Context | None = None) -> click.Context:
    options = {**command.context_settings, "terminal_width": HELP_WIDTH, "max_content_width": HELP_WIDTH}
    return click.Context(command, info_name=name, parent=parent, **options)


def command_names() -> list[str]:
    """Every command as it is typed behind `tapewire`, those of a group behind the group's name."""
    context = _context(command_line, "tapewire")
    names: list[str] = []
    for name in command_line.list_commands(context):
        command = command_line.get_command(context, name)
        names.append(name)
        if isinstance(command, click.Group):
            names += [f"{name} {under}" for under in command.list_commands(_context(command, name, context))]
    return names


# the lines


def _windows() -> str:
    rates = (4800, 9600, 19200, 38400, 86400)
    rows = [
        [f"{baud}"] + [f"{default_window(baud, limits.overrun)}" for limits in (PROTOCOL_B, EXPANSION_B)]
        for baud in rates
    ]
    said = f"One character of window for every {WINDOW_BAUD_PER_CHARACTER} baud."
    return f"{said}\n\n" + _table(("baud", "`fanuc-b`", "`fanuc-b-expansion`"), rows)


# the engines


def _contract() -> str:
    """The verbs of the engine protocols, signature by signature, with what the code says of each."""
    tree = ast.parse(inspect.getsource(engine))
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and node.name.endswith("Engine")]
    return _block("\n\n".join("\n".join(_class_lines(node)) for node in classes), "python")


def _class_lines(node: ast.ClassDef) -> Iterable[str]:
    yield f"class {node.name}({', '.join(ast.unparse(base) for base in node.bases)}):"
    for verb in node.body:
        if isinstance(verb, ast.FunctionDef):
            returns = f" -> {ast.unparse(verb.returns)}" if verb.returns else ""
            if verb.decorator_list:
                yield "    @property"
            yield f"    def {verb.name}({ast.unparse(verb.args)}){returns}"
            yield from (f"        # {line.strip()}" for line in (ast.get_docstring(verb) or "").splitlines() if line)


def _protocols() -> str:
    rows = [(f"`{entry.name}`", entry.title, entry.clause, f"{entry.baud}") for entry in PROTOCOLS.values()]
    return _table(("name", "protocol", "manual", "baud unless told"), rows)


# protocol B


def _control_codes() -> str:
    """The columns of 6.2, and what each code means from either end, as messages.py tells it."""
    meanings = dict(_meanings_of_codes())
    rows = [
        (code.name, _hex(code, CodeSystem.ISO), _hex(code, CodeSystem.ASCII), *meanings[code.name])
        for code in ControlCode
    ]
    header = ("code", "5000#2 = 0, `code=iso`", "5000#2 = 1, `code=ascii`", "from the control", "from the host")
    return _table(header, rows)


def _meanings_of_codes() -> Iterable[tuple[str, tuple[str, str]]]:
    for line in (messages.__doc__ or "").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 3 and cells[0] in ControlCode.__members__:
            yield cells[0], (cells[1], cells[2])


def _hex(code: ControlCode, system: CodeSystem) -> str:
    return f"{encode(code, system).hex().upper()}h"


def _limits() -> str:
    names = {
        "stop_at_free": "The control sends DC3 when so little of its buffer is free",
        "start_at_free": "It sends DC1 when so much is free",
        "overrun": "Characters it tolerates after its DC3 has left",
        "first_stop": "Fewer characters than this from the start cannot have filled the buffer",
        "next_stop": "Fewer than this after a later DC1 cannot have filled it again",
    }
    rows = [
        (f"`{name}`", text, f"{getattr(PROTOCOL_B, name)}", f"{getattr(EXPANSION_B, name)}")
        for name, text in names.items()
    ]
    return _table(("name", "meaning, in characters", "protocol B", "expansion B"), rows)


def _settings(settings: Iterable[tuple[str, str, str, str, str]]) -> str:
    rows = [(f"`{key}`", values, f"`{default}`", whose, why) for key, values, default, whose, why in settings]
    return _table(("key", "values", "default", "end", "meaning"), rows)


def _settings_of(record: type[Any]) -> str:
    return _settings(describe_settings(record))


def _states(states: type[Enum]) -> str:
    said = _members_said(states)
    return _table(
        ("state", "in words"),
        [
            (f"`{state.name}`", f"{state.value}{'. ' + said[state.name] if said[state.name] else ''}")
            for state in states
        ],
    )


def _names(states: AbstractSet[Enum], order: type[Enum]) -> str:
    return ", ".join(f"`{state.name}`" for state in order if state in states)


def _host_law() -> str:
    rows = [
        [f"`{state.name}`"]
        + [_names(host_law.LAW.get((state, code), frozenset()), host_law.State) or "-" for code in ControlCode]
        for state in host_law.State
    ]
    return _table(("state", *(code.name for code in ControlCode)), rows)


def _cnc_law() -> str:
    return _law(cnc_law.LAW, cnc_law.State, (*cnc_law.Act, *ControlCode))


def _law(law: Mapping[Any, AbstractSet[Enum]], states: type[Enum], causes: Sequence[Enum]) -> str:
    rows = [
        (f"`{state.name}`", _cause(cause), _names(law[state, cause], states))
        for state in states
        for cause in causes
        if (state, cause) in law
    ]
    return _table(("state", "what happens", "then"), rows)


def _cause(cause: Enum) -> str:
    return cause.name if isinstance(cause, ControlCode) else f"`{cause.name}` {cause.value}"


def _constants(*modules: ModuleType) -> str:
    rows = []
    for module in modules:
        said = _said_of(ast.parse(inspect.getsource(module)))
        rows += [
            (f"`{name}`", module.__name__.rpartition(".")[2], _quantity(module, name), text)
            for name, text in said.items()
            if text and not name.startswith("_") and isinstance(getattr(module, name), int)
        ]
    return _table(("name", "file", "value", "meaning"), rows)


def _quantity(module: ModuleType, name: str) -> str:
    value: int = getattr(module, name)
    if not re.search(rf"^{name}: Final.*\b(MILLI)?SECOND\b", inspect.getsource(module), re.M):
        return f"{value}"
    return f"{value / SECOND:g} s" if value >= SECOND else f"{value / MILLISECOND:g} ms"


# REMOTE LOAD and DNC LINK


def _roles() -> str:
    """The code table, and how sure of each row anybody can be."""
    header = ("code", "character", "from", "meaning", "sure", "else perhaps")
    rows = [
        (f"`{key}`", _named(RECONSTRUCTION.settings[key]), role.says, role.meaning, _percent(role.confidence), other)
        for key, role in ROLES.items()
        for other in [_named(role.instead)]
    ]
    return _table(header, rows)


def _named(characters: str) -> str:
    """`04 14` as `EOT 04h, DC4 14h`; words stay."""
    words = characters.replace(",", " ").split()
    return ", ".join(f"{name_of(int(word, 16)).split()[0]} {word}h" if _HEX.fullmatch(word) else word for word in words)


def _percent(confidence: int | None) -> str:
    return "our choice" if confidence is None else f"{confidence} %"


def _uncertain_settings() -> str:
    described = {key: (values, default) for key, values, default, *_ in describe_settings(bridgeport.Params)}
    rows = [
        (f"`{key}`", f"`{described[key][1]}`", _percent(confidence), described[key][0])
        for key, confidence in LINK_CONFIDENCE.items()
    ]
    return _table(("setting", "taken for true", "sure", "what it may be"), rows)


def _bridgeport_settings() -> str:
    return _settings(row for row in describe_settings(bridgeport.Params) if row[0] not in CODE_KEYS)


def _lrc_candidates() -> str:
    """The check character of three records by every candidate."""
    etb = bridgeport.Params().rec_end
    texts = (b"N10G1X1F5\r\n", b"N20Y1\r\n", b"N30M2\r\n")
    header = ("`lrc`", *(f"`{text.decode().strip()}` CR LF" for text in texts))
    return _table(
        header, [(f"`{lrc}`", *(f"{hex_of([lrc_of(text, etb, lrc)])}h" for text in texts)) for lrc in LRC_CANDIDATES]
    )


def _dnc_ends() -> str:
    said = _members_said(DncEnd)
    return _table(("`dnc_end`", "meaning"), [(f"`{end}`", said[end.name]) for end in DncEnd])


def _bridgeport_host_law() -> str:
    law, states, heard = bridgeport_host_law.LAW, bridgeport_host_law.State, bridgeport_host_law.Heard
    rows = [
        [f"`{state.name}`"] + [_names(law.get((state, what), frozenset()), states) or "-" for what in heard]
        for state in states
    ]
    return _table(("state", *(f"`{what.name}`" for what in heard)), rows)


def _bridgeport_cnc_law() -> str:
    causes = (*bridgeport_cnc_law.Act, *bridgeport_cnc_law.Word)
    return _law(bridgeport_cnc_law.LAW, bridgeport_cnc_law.State, causes)


def _profile() -> str:
    return _block((Path(profile.__file__).parent / "reconstruction.toml").read_text(), "toml")


# protocol A


def _commands() -> str:
    """The table of 4.4.1: who sends it, what the host may answer, what its data is."""
    said = _members_said(Command)
    rows = [
        (
            command.name,
            a_messages.ORIGINS[command],
            said[command.name],
            _command_names(a_messages.ANSWERS.get(command, frozenset())),
            _data_of(command),
        )
        for command in Command
    ]
    return _table(("command", "from", "meaning", "the host may answer", "data"), rows)


def _command_names(commands: AbstractSet[Command]) -> str:
    return " ".join(command.name for command in Command if command in commands)


def _data_of(command: Command) -> str:
    match command:
        case Command.DAT:
            return f"NC data, at most {a_messages.LONGEST_DAT} bytes, and at most Nb - No"
        case Command.SAT:
            return "state, stored, parameters: 56 or 72 positions"
        case Command.SET:
            return "parameters: 56 or 72 positions, or none"
        case Command.RTY:
            reasons = (f"{reason.value.decode()} {reason.name.lower()}" for reason in a_messages.RetryReason)
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
        ((status.USED_LENGTH + 1, a_messages.LONGEST_DATA), "not used; may be missing", "not used; may be missing", ""),
    ]
    rows += [
        (span, _parameter_said(field), _parameter_said(field), _hexadecimal(field, span))
        for field, span in status._POSITIONS.items()
    ]
    rows.sort()
    header = ("positions", "SAT", "SET", "at power-on")
    return _table(
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
    return _table(("parameter", "meaning", "unit", "range", "at power-on", "our host asks for"), rows)


def _packet_lengths() -> str:
    rows = [(f"{n}", f"0{n}", f"{packets.data_bytes(n)}", f"{packets.packet_bytes(n)}") for n in (1, 2, 4)]
    return _table(("n", "positions 55 and 56", "data", "whole packet"), rows)


def _monitors() -> str:
    said = _members_said(packets.Monitor)
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
    return _table(("packet", "meaning", *forms, "printed, `monitor_sum=with-end`"), rows)


_FORMS: Final = tuple(packets.MonitorCode)


def _monitor(monitor: packets.Monitor, code: packets.MonitorCode, covers: packets.MonitorSum) -> str:
    number = packets.NUMBERS[1] if monitor is packets.Monitor.NAK else None
    return packets.encode_monitor(monitor, number=number, code=code, sum_covers=covers).hex(" ").upper()


def _a_host_law() -> str:
    commands = [command for command in Command if a_messages.ORIGINS[command] is not a_messages.Origin.HOST]
    rows = [
        [f"`{state.name}`"]
        + [
            _names(a_host_law.LAW[state, command].states, a_host_law.State)
            if (state, command) in a_host_law.LAW
            else "-"
            for command in commands
        ]
        for state in a_host_law.State
    ]
    return _table(("state", *(command.name for command in commands)), rows)


def _a_cnc_law() -> str:
    """Each pair that has a row; what the control of its own may not be sent falls to the two alarms."""
    rows = [
        (f"`{state.name}`", _command_names(commands), f"`{act.name}`", act.value)
        for state in a_cnc_law.State
        for act in a_cnc_law.Act
        if (commands := {command for command in Command if a_cnc_law.LAW.get((state, command)) is act})
    ]
    return _table(("state", "the host says", "act", "the control"), rows)


def _a_refusals() -> str:
    rows = [
        (f"`{state.name}`", *(_command_names(_refused(state, alarm)) for alarm in a_cnc_law.Refusal))
        for state in a_cnc_law.State
        if _refused(state, None)
    ]
    return _table(("state", *(alarm.value for alarm in a_cnc_law.Refusal)), rows)


def _refused(state: a_cnc_law.State, alarm: a_cnc_law.Refusal | None) -> set[Command]:
    return {
        command
        for command in Command
        if (state, command) not in a_cnc_law.LAW and alarm in (None, a_cnc_law.refusal(state, command))
    }


def _members(words: type[Enum], header: str) -> str:
    said = _members_said(words)
    return _table((header, "in words"), [(f"`{w.name}`", f"{w.value}. {said[w.name]}".rstrip(" .")) for w in words])


def _a_constants() -> str:
    host = (host_exchange, host_agreement, host_line, host_packets, host_streaming)
    return _constants(*host, cnc_job, cnc_dialogue, cnc_packets)


def _dialogue(path: Path) -> str:
    return f"```\n{path.read_text()}```"


def _dialogues(protocol: str, name: str) -> dict[str, Callable[[], str]]:
    paths = sorted((TRANSCRIPTS / protocol).glob("*.txt"))
    return {f"{name} {path.stem}": partial(_dialogue, path) for path in paths}


PARTS: Final[dict[str, Callable[[], str]]] = {
    "tapewire --help": partial(_help, ""),
    **{f"tapewire {name} --help": partial(_help, name) for name in command_names()},
    "windows": _windows,
    "engine contract": _contract,
    "protocols": _protocols,
    "fanuc_b control codes": _control_codes,
    "fanuc_b limits": _limits,
    "fanuc_b settings": partial(_settings_of, Params),
    "fanuc_b host states": partial(_states, host_law.State),
    "fanuc_b host law": _host_law,
    "fanuc_b control states": partial(_states, cnc_law.State),
    "fanuc_b control law": _cnc_law,
    "fanuc_b constants": partial(_constants, host, host_delivery, delivery, cnc),
    "fanuc_a commands": _commands,
    "fanuc_a positions": _positions,
    "fanuc_a parameters": _parameters,
    "fanuc_a packet lengths": _packet_lengths,
    "fanuc_a monitor packets": _monitors,
    "fanuc_a settings": partial(_settings_of, fanuc_a.Params),
    "fanuc_a host states": partial(_states, a_host_law.State),
    "fanuc_a host law": _a_host_law,
    "fanuc_a host timers": partial(_members, a_host_law.Timer, "deadline"),
    "fanuc_a control states": partial(_states, a_cnc_law.State),
    "fanuc_a control law": _a_cnc_law,
    "fanuc_a control refusals": _a_refusals,
    "fanuc_a control timers": partial(_members, a_cnc_law.Timer, "deadline"),
    "fanuc_a constants": _a_constants,
    "bridgeport codes": _roles,
    "bridgeport uncertain settings": _uncertain_settings,
    "bridgeport settings": _bridgeport_settings,
    "bridgeport lrc candidates": _lrc_candidates,
    "bridgeport endings": _dnc_ends,
    "bridgeport host states": partial(_states, bridgeport_host_law.State),
    "bridgeport host law": _bridgeport_host_law,
    "bridgeport control states": partial(_states, bridgeport_cnc_law.State),
    "bridgeport control law": _bridgeport_cnc_law,
    "bridgeport constants": partial(
        _constants,
        bridgeport_messages,
        records,
        bridgeport_host,
        host_job,
        host_text,
        host_reception,
        host_transmission,
        bridgeport_cnc,
    ),
    "bridgeport profile": _profile,
    **_dialogues("fanuc_a", "dialogue"),
    **_dialogues("fanuc_b", "dialogue"),
    **_dialogues("bridgeport", "bridgeport dialogue"),
}


if __name__ == "__main__":
    main()
