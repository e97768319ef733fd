"""From parameters to the host's command line, and the limits of 2.1 and 2.2."""

from __future__ import annotations

import pytest

from tapewire.errors import UsageError
from tapewire.fanuc.host_settings import HostSettings, control_settings, host_settings, longest_cable_m
from tapewire.fanuc.parameter_check import Weight
from tapewire.fanuc.parameters import Interface, ParameterSet

RS_232_C = {0: 0b100, 5000: 0b10000, 5081: 3, 5082: 1, 5083: 11, 5084: 1}
RS_422 = {0: 0b100, 5000: 0b00001, 5070: 13, 5071: 3, 5072: 1, 5073: 11, 5074: 1}


def derived(values: dict[int, int], **options: float | str | None) -> HostSettings:
    return host_settings(ParameterSet(values), **options)  # type: ignore[arg-type]


def warnings(settings: HostSettings) -> list[str]:
    return [finding.text for finding in settings.findings if finding.weight is Weight.WARNING]


@pytest.mark.parametrize(
    ("values", "command"),
    [
        (RS_232_C, "fanuc-b --baud 9600 --stopbits 1 --set code=iso --set posting=off --set data=ascii"),
        (RS_422, "fanuc-b --baud 9600 --stopbits 1 --set code=iso --set posting=off --set data=ascii"),
        (
            {**RS_422, 5000: 0b01101, 5072: 2, 5073: 15, 5074: 2},
            "fanuc-b-expansion --baud 86400 --stopbits 2 --set code=ascii --set posting=on --set data=ascii",
        ),
        (
            {**RS_232_C, 0: 0, 5000: 0b00000, 5083: 12, 5084: 3},
            "fanuc-a --baud 19200 --stopbits 1 --set code=ascii --set end=cr --set data=iso",
        ),
        (
            {**RS_422, 5000: 0b01101, 5074: 3},
            "fanuc-a-expansion --baud 9600 --stopbits 1 --set code=iso --set end=etx --set data=ascii",
        ),
    ],
)
def test_the_command_that_suits_a_control(values: dict[int, int], command: str) -> None:
    assert derived(values).command("send") == f"tapewire send FILE --line LINE --protocol {command}"


def test_5000_2_means_the_reverse_in_a_and_b() -> None:
    for tcc, a, b in ((0, "ascii", "iso"), (1, "iso", "ascii")):
        values = {**RS_232_C, 5000: tcc << 2}
        assert derived({**values, 5084: 1}).settings["code"] == b
        assert derived({**values, 5084: 3}).settings["code"] == a


@pytest.mark.parametrize(
    ("bit", "echo", "cd"), [(0b00000, "off", "on"), (0b00010, "on", "on"), (0b10000, "off", "off")]
)
def test_5000_1_and_4_are_settings_of_the_simulated_control(bit: int, echo: str, cd: str) -> None:
    control = control_settings(ParameterSet({**RS_232_C, 5000: bit, 5084: 3}), Interface.RS_232_C)
    assert (control.settings["echo"], control.settings["cd"]) == (echo, cd)
    assert control_settings(ParameterSet({**RS_422, 5000: 1}), Interface.RS_422).settings["cd"] == "off"


def test_0000_4_eia_is_the_code_of_punch_outs_and_no_other() -> None:
    settings = derived({**RS_232_C, 0: 0b10000})
    assert "data=iso" in settings.command("send")
    assert "data=eia" in settings.command("receive")


def test_protocol_a_has_no_punch_out_and_leaves_the_expansion_to_the_host() -> None:
    settings = derived({**RS_422, 5074: 3})
    assert not settings.receives
    assert (settings.protocol, settings.alternatives) == ("fanuc-a-expansion", ("fanuc-a",))
    assert derived({**RS_422, 5074: 3}, protocol="fanuc-a").alternatives == ("fanuc-a-expansion",)
    with pytest.raises(UsageError, match="is set to fanuc-b, not to fanuc-a"):
        derived(RS_422, protocol="fanuc-a")


@pytest.mark.parametrize("number", [5082, 5083, 5084])
def test_what_is_needed_and_missing_is_named(number: int) -> None:
    with pytest.raises(UsageError, match=rf"No\. {number} is missing"):
        derived({key: value for key, value in RS_232_C.items() if key != number})


def test_without_5000_the_interface_must_be_told() -> None:
    values = {key: value for key, value in RS_232_C.items() if key != 5000}
    with pytest.raises(UsageError, match=r"No\. 5000 is missing"):
        derived(values)
    settings = host_settings(ParameterSet(values), board=Interface.RS_232_C)
    assert settings.interface is Interface.RS_232_C


def test_without_0000_the_code_of_programs_is_left_open() -> None:
    settings = derived({key: value for key, value in RS_232_C.items() if key})
    assert "data=" not in settings.command("send")
    assert any("0000 was not told" in finding.text for finding in settings.findings)


# -- 2.1 and 2.2 ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("interface", "baud", "metres"),
    [
        (Interface.RS_232_C, 50, 100),
        (Interface.RS_232_C, 4800, 100),
        (Interface.RS_232_C, 9600, 50),
        (Interface.RS_232_C, 19200, 15),
        (Interface.RS_422, 100, 800),
        (Interface.RS_422, 9600, 800),
        (Interface.RS_422, 19200, 50),
        (Interface.RS_422, 86400, 50),
        (Interface.RS_232_C, 38400, None),
    ],
)
def test_2_1_cable_lengths(interface: Interface, baud: int, metres: int | None) -> None:
    assert longest_cable_m(interface, baud) == metres


@pytest.mark.parametrize(("metres", "advice"), [(50, None), (51, "at 4800 baud or less"), (101, "use RS-422")])
def test_2_1_a_cable_that_is_too_long(metres: float, advice: str | None) -> None:
    found = warnings(derived(RS_232_C, cable_length_m=metres))
    assert ([advice in text for text in found] == [True]) if advice else (found == [])


def test_2_1_a_cable_too_long_for_rs_422_at_any_rate() -> None:
    (warning,) = warnings(derived(RS_422, cable_length_m=801))
    assert "no rate allows so long a cable" in warning


def test_2_1_note_2_19200_on_rs_232_c_is_noted() -> None:
    assert any("2.1 note 2" in finding.text for finding in derived({**RS_232_C, 5083: 12}).findings)


def test_2_2_expansion_b_is_for_rs_422_alone() -> None:
    (warning,) = warnings(derived({**RS_232_C, 5084: 2}))
    assert "2.2 gives it for RS-422 alone" in warning


def test_2_2_expansion_a_is_for_rs_422_alone() -> None:
    assert derived({**RS_232_C, 5084: 3}).protocol == "fanuc-a"
    assert derived({**RS_232_C, 5084: 3}).alternatives == ()
    (warning,) = warnings(derived({**RS_232_C, 5084: 3}, protocol="fanuc-a-expansion"))
    assert "RS-422 alone" in warning


@pytest.mark.parametrize(("lowest", "rate", "clocked"), [(13, 12, False), (12, 12, True), (0, 2, True), (13, 13, True)])
def test_5070_the_hosts_clock_is_taken_from_there_on(lowest: int, rate: int, clocked: bool) -> None:
    found = warnings(derived({**RS_422, 5070: lowest, 5073: rate}))
    assert [("TT and RT" in text, "set No. 5070 above" in text) for text in found] == ([(True, rate < 13)] * clocked)


@pytest.mark.parametrize(("rate", "clocked"), [(12, 0), (13, 1), (14, 1), (15, 1)])
def test_5070_note_1_from_38400_on_the_clock_is_always_taken(rate: int, clocked: int) -> None:
    """Though 5070 was not told."""
    values = {number: value for number, value in RS_422.items() if number != 5070}
    assert len(warnings(derived({**values, 5073: rate}))) == clocked


# -- devices -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("specification", [2, 4])
def test_5081_without_control_codes_protocol_b_never_starts(specification: int) -> None:
    with pytest.raises(UsageError, match="the control sends no DC1"):
        derived({**RS_232_C, 5081: specification})


@pytest.mark.parametrize("specification", [0, 5, 6, 7, 8])
def test_5081_another_device_is_no_host_computer(specification: int) -> None:
    with pytest.raises(UsageError, match="that is no host computer"):
        derived({**RS_232_C, 5081: specification})


def test_5081_says_nothing_of_protocol_a() -> None:
    for specification in range(9):
        assert derived({**RS_232_C, 5081: specification, 5084: 3}).protocol == "fanuc-a"


def test_10_1_an_input_device_that_is_not_the_remote_buffer() -> None:
    assert warnings(derived({**RS_232_C, 20: 10})) == []
    (warning,) = warnings(derived({**RS_232_C, 20: 4}))
    assert warning.startswith("No. 0020 is 4")


# -- 10.3: binary input operation ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bits", "time", "word"),
    [
        (0b0000, 0b000, "3,special,no-aux,8ms"),
        (0b0100, 0b001, "3,general,no-aux,2ms"),
        (0b1000, 0b010, "3,special,aux,4ms"),
        (0b1100, 0b011, "3,general,aux,16ms"),
    ],
)
def test_10_3_the_records_are_those_of_7609_7618_and_7635(bits: int, time: int, word: str) -> None:
    values = {**RS_422, 5073: 15, 7609: bits, 7618: time, 7635: 3}
    assert derived(values).settings["g05"] == word
    assert control_settings(ParameterSet(values), Interface.RS_422).settings["g05"] == word
    assert "g05" not in derived({**values, 7635: 0}).settings


@pytest.mark.parametrize(("baud", "enough"), [(11, False), (12, True)])
def test_9_2_a_rate_that_is_too_low_for_the_records(baud: int, enough: bool) -> None:
    found = warnings(derived({**RS_422, 5073: baud, 7635: 4}))
    assert ["needs 12375 baud (9.2)" in text for text in found] == ([] if enough else [True])


def test_9_1_5_note_protocol_a_has_the_special_format_alone() -> None:
    values = {**RS_422, 5073: 12, 5074: 3, 7609: 0b100, 7635: 1}
    (warning,) = warnings(derived(values, protocol="fanuc-a"))
    assert "special format alone" in warning
    assert warnings(derived(values, protocol="fanuc-a-expansion")) == []
