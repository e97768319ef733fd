"""The parameters of binary input operation as `--set g05=` takes them, the same for every protocol (chapter 9)."""

from __future__ import annotations

from typing import Any, Final

from tapewire.g05.layout import BinaryInput
from tapewire.protocols.settings import Form, setting

__all__ = ["binary_input"]

_FORM: Final = Form(values="auto, or AXES[,special|general][,no-aux|aux][,UNITms]", parse=BinaryInput.parse, word=str)


def binary_input() -> Any:
    """A field of the parameters of a protocol that carries programs with G05 sections."""
    return setting(
        BinaryInput(),
        "The records of a G05 section: axes (7635), format and auxiliary functions (7609), unit time (7618); "
        "auto: the host finds their length by the check bytes.",
        form=_FORM,
        control=BinaryInput.parse("3"),
    )
