"""Protocol B and expansion protocol B."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Final

from docs.generators.markup import constants, dialogues, law_rows, names_of, settings_of, states_said, table
from tapewire.protocols import delivery
from tapewire.protocols.fanuc_b import cnc, cnc_law, host, host_delivery, host_law, messages
from tapewire.protocols.fanuc_b.messages import EXPANSION_B, PROTOCOL_B, CodeSystem, ControlCode, Params, encode


def _control_codes() -> str:
    """The columns of 6.2, and what each code means from either end, as messages.py tells it."""
    meanings = dict(_meanings_of_codes())
    rows = [
        (code.name, _hex(code, CodeSystem.ISO), _hex(code, CodeSystem.ASCII), *meanings[code.name])
        for code in ControlCode
    ]
    header = ("code", "5000#2 = 0, `code=iso`", "5000#2 = 1, `code=ascii`", "from the control", "from the host")
    return table(header, rows)


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
    return table(("name", "meaning, in characters", "protocol B", "expansion B"), rows)


def _host_law() -> str:
    rows = [
        [f"`{state.name}`"]
        + [names_of(host_law.LAW.get((state, code), frozenset()), host_law.State) or "-" for code in ControlCode]
        for state in host_law.State
    ]
    return table(("state", *(code.name for code in ControlCode)), rows)


def _cnc_law() -> str:
    return law_rows(cnc_law.LAW, cnc_law.State, (*cnc_law.Act, *ControlCode))


PARTS: Final[dict[str, Callable[[], str]]] = {
    "fanuc_b control codes": _control_codes,
    "fanuc_b limits": _limits,
    "fanuc_b settings": partial(settings_of, Params),
    "fanuc_b host states": partial(states_said, host_law.State),
    "fanuc_b host law": _host_law,
    "fanuc_b control states": partial(states_said, cnc_law.State),
    "fanuc_b control law": _cnc_law,
    "fanuc_b constants": partial(constants, host, host_delivery, delivery, cnc),
    **dialogues("fanuc_b", "dialogue"),
}
