"""The parameters of both ends, drawn: every switch of a protocol's record, and the numbers that change a dialogue.

What both ends must agree on is drawn once, foreign code tables among it. What would only tell the two ends different
things is left at its default: that is a wrong setting, not a fault of a line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from tapewire.codes import DataCode, encode
from tapewire.protocols import PROTOCOLS
from tapewire.protocols.settings import End, describe_settings
from tapewire.sim.streams import Draws

__all__ = ["Settings", "draw_settings"]

CHANGED: Final = 0.25
"""How often a setting is another than its default."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Words for `--set` at each end, and the code of the program."""

    host: Mapping[str, str]
    cnc: Mapping[str, str]
    data: DataCode


_FANUC_A: Final[Mapping[str, tuple[str, ...]]] = {
    "code": ("ascii", "iso"),
    "end": ("cr", "etx"),
    "data": ("ascii", "iso", "eia"),
    "Nb": ("2000", "4000"),
    "No": ("50", "300", "512"),
    "Ne": ("1", "3", "10"),
    "Tp": ("1", "2", "5"),
    "To": ("5", "20"),
    "Ti": ("0", "2", "10"),
    "Tx": ("0", "100"),
    "Tw": ("0", "1"),
    "retries": ("exchange", "job"),
    "first": ("control", "host"),
    "set_data": ("changes", "always"),
    "set_length": ("56", "72"),
    "wat_after": ("0", "1.0"),
    "pad": ("0", "32", "10"),
    "invalid": ("0", "32"),
    "rst_at_end": ("complete", "cancelled"),
    "longest_dat": ("100", "4096"),
    "start_time": ("0.5", "2.0"),
    "sat_length": ("56", "72"),
    "filler": ("0", "blank"),
    "echo": ("on", "off"),
    "open_line": ("waits", "speaks"),
    "syn_parameters": ("kept", "power-on"),
    "time_out": ("bytes", "message"),
    "after_end": ("reset", "operating"),
}
_PACKETS: Final[Mapping[str, tuple[str, ...]]] = {
    **{key: values for key, values in _FANUC_A.items() if key not in ("Nb", "longest_dat")},
    "n": ("1", "2", "4"),
    "monitor": ("printed", "ascii", "iso"),
    "monitor_sum": ("without-end", "with-end"),
    "naks": ("error", "packet"),
    "time_out_in_hold": ("off",),
    "dc3_free": ("2560", "3000"),
    "dc1_free": ("4096", "6000"),
}
_FANUC_B: Final[Mapping[str, tuple[str, ...]]] = {
    "code": ("iso", "ascii"),
    "posting": ("on", "off"),
    "resume": ("auto", "dc1", "dc2"),
    "data": ("ascii", "iso", "eia"),
    "er": ("auto", "hidden"),
    "closing_time": ("0.5", "5.0"),
    "notice_time": ("0.2", "0.5"),
    "early_stop": ("0.5", "2.0"),
    "syn_at_end": ("cancelled", "complete"),
    "closing": ("read", "received"),
    "alarm": ("at-once", "at-reset"),
    "idle_posting": ("on", "off"),
    "punch_overrun": ("0", "16", "500"),
}
_BRIDGEPORT: Final[Mapping[str, tuple[str, ...]]] = {
    "lrc": ("xor7_etb", "xor7", "neg7_etb", "sum7_etb", "sum7", "xor7_etb_inv"),
    "dnc_end": ("eot_on_ack", "eot_after_lrc", "etx_last", "empty_then_eot"),
    "first_record": ("at_once", "on_ack"),
    "parity": ("line", "line", "software"),
    "record_cut": ("lines", "fixed"),
    "record_bytes": ("256", "100"),
    "avoid_lrc_codes": ("on", "off"),
    "text_timeout": ("5", "30"),
    "end_wait": ("0.3", "1.0"),
    "ack_limit": ("30", "0"),
    "er": ("auto", "hidden"),
    "mode": ("L", "D"),
    "name_trailer": ("14", "04"),
    "save_trailer": ("04 14", "04", "14"),
    "operator_cancel": ("13 10", "10 04", "10"),
    "record_timeout": ("2", "5"),
    "nak_limit": ("0", "5"),
    "naming": ("on", "on", "off"),
    "hold": ("ack", "xoff"),
    "late_xon": ("on", "off"),
    "nak_quiet": ("0.2", "0.5"),
    "load_timeout": ("0", "20"),
    "answer_limit": ("0", "20"),
    "after_stop": ("0", "3"),
}
_CHOICES: Final[Mapping[str, Mapping[str, tuple[str, ...]]]] = {
    "fanuc-a": _FANUC_A,
    "fanuc-a-expansion": _PACKETS,
    "fanuc-b": _FANUC_B,
    "fanuc-b-expansion": _FANUC_B,
    "bridgeport": _BRIDGEPORT,
}

_FOREIGN_CODES: Final[tuple[Mapping[str, str], ...]] = (
    {"open_write": "05"},
    {"ack": "0E", "nak": "0F"},
    {"rec_end": "1E", "rec_end_last": "1F"},
    {"cancel": "18", "cancel_tail": "13 18", "operator_cancel": "13 18", "parity_cancel": "18"},
    {"xon": "1A", "xoff": "1B", "operator_cancel": "10"},
)
"""Tables that a Bridgeport control may have instead of ours: the same at both ends."""

FOREIGN: Final = 0.15
"""How often each of these is so: foreign codes, a program that is converted, a host that finds out by itself how its
records are checked, and one that answers the end of what the control sends by XOFF.
"""

_ANYWAY: Final = frozenset({"mode"})
"""Drawn evenly: half of a protocol hangs on it."""


def draw_settings(protocol: str, draws: Draws, foreign: Draws, *, receives: bool) -> Settings:
    """What both ends are set to. `receives`: the program comes from the control. `foreign` is drawn from apart."""
    ends = _whose(protocol)
    host: dict[str, str] = {}
    cnc: dict[str, str] = {}
    for key, words in _CHOICES[protocol].items():
        changed = draws.happens(CHANGED) or key in _ANYWAY
        word = draws.choice(words)
        if not changed:
            continue
        if End.HOST in ends[key] or End.BOTH in ends[key]:
            host[key] = word
        if ends[key] in ({End.CONTROL}, {End.BOTH}) and key != "n":
            cnc[key] = word
    _agree(protocol, host, cnc, draws, receives)
    _make_foreign(protocol, host, cnc, foreign)
    return Settings(host=host, cnc=cnc, data=DataCode(host.get("data", "ascii")))


def _whose(protocol: str) -> dict[str, set[End]]:
    """A setting whose default differs between the ends has a row for each: the host's words are then its own."""
    whose: dict[str, set[End]] = {}
    for key, _, _, end, _ in describe_settings(PROTOCOLS[protocol].record):
        whose.setdefault(key, set()).add(End(end))
    return whose


def _make_foreign(protocol: str, host: dict[str, str], cnc: dict[str, str], draws: Draws) -> None:
    if protocol == "bridgeport":
        codes = draws.choice(_FOREIGN_CODES)
        if draws.happens(FOREIGN):
            host.update({key: word for key, word in codes.items() if not key.endswith("_cancel")})
            cnc.update({key: word for key, word in codes.items() if key != "cancel_tail"})
        if draws.happens(FOREIGN):
            host["lrc"] = "auto"
            if cnc.get("nak_limit", "0") != "0":
                # The host finds it by two NAKs for each of seven candidates, which the default allows.
                del cnc["nak_limit"]
        if draws.happens(FOREIGN):
            host["closing_dc3"] = cnc["closing_dc3"] = "on"
    elif protocol.startswith("fanuc-a") and draws.happens(FOREIGN):
        # 4.4.2: 45-48 of SET. The control has every X read as U.
        code = DataCode(host.get("data", "ascii"))
        host["convert_from"], host["convert_to"] = (str(encode(word, code)[0]) for word in (b"X", b"U"))


def _agree(protocol: str, host: dict[str, str], cnc: dict[str, str], draws: Draws, receives: bool) -> None:
    """Combinations that a shop would not set, or that are refused."""
    if protocol.startswith("fanuc-b"):
        if host.get("posting") == "off" and receives and draws.happens(0.3):
            host["pause"] = "cs"
        if host.get("code") and draws.happens(0.3):
            # Both forms are understood, whatever is sent.
            cnc.pop("code", None)
    elif protocol == "bridgeport":
        if receives:
            cnc.pop("mode", None)
        if cnc.get("naming") == "off" and not receives:
            # Without a name it is a load, whatever the control would have said.
            cnc["mode"] = "L"
    if host.get("To") == "5":
        # A first DAT of 1950 bytes takes 8.9 s at 2400 baud, and no host knows yet how slow the line is.
        cnc.pop("time_out", None)
    if protocol == "fanuc-a" and int(host.get("Nb", "4000")) <= int(host.get("No", "512")):
        host.pop("No", None)
