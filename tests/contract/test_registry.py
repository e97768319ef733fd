"""What a protocol owes the registry."""

from __future__ import annotations

import pytest

from tapewire.errors import UsageError
from tapewire.protocols import PROTOCOLS, ProtocolEntry, protocol
from tapewire.protocols.settings import End, describe_settings

every_protocol = pytest.mark.parametrize("entry", PROTOCOLS.values(), ids=PROTOCOLS)


@every_protocol
def test_every_default_can_be_set(entry: ProtocolEntry) -> None:
    for end in (End.HOST, End.CONTROL):
        defaults = {key: word for key, _, word, whose, _ in describe_settings(entry.record) if whose in ("both", end)}
        assert entry.params(defaults, end) == entry.params({}, end)


@every_protocol
def test_every_setting_says_what_it_means(entry: ProtocolEntry) -> None:
    for key, values, default, _, why in describe_settings(entry.record):
        assert all((values, default, why.endswith("."))), key


@every_protocol
def test_an_unknown_setting_is_refused_with_the_names_there_are(entry: ProtocolEntry) -> None:
    with pytest.raises(UsageError, match=r"no setting 'nonsense'; the settings of the host are .*data"):
        entry.params({"nonsense": "1"}, End.HOST)


@every_protocol
def test_a_wrong_value_is_refused_with_the_values_there_are(entry: ProtocolEntry) -> None:
    with pytest.raises(UsageError, match=r"data=morse: one of .*iso.* is expected"):
        entry.params({"data": "morse"}, End.HOST)


def test_an_unknown_protocol_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(UsageError, match=r"no protocol 'fanuc-c'; the protocols are .*fanuc-b"):
        protocol("fanuc-c")
