"""The dialogues of 4.3 and 5.4, to the character and the millisecond.

TAPEWIRE_WRITE_TRANSCRIPTS=1 writes them anew; read the difference before you commit it.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.protocols.fanuc_a.dialogues import DIALOGUES

TRANSCRIPTS = Path(__file__).parents[2] / "transcripts" / "fanuc_a"


@pytest.mark.parametrize("name", DIALOGUES)
def test_golden(name: str) -> None:
    text = str(DIALOGUES[name]().pairs[0].transcript)
    path = TRANSCRIPTS / f"{name}.txt"
    if os.environ.get("TAPEWIRE_WRITE_TRANSCRIPTS"):
        path.write_text(text)
    assert text == path.read_text()


def test_no_transcript_without_its_dialogue() -> None:
    assert {path.stem for path in TRANSCRIPTS.glob("*.txt")} == set(DIALOGUES)


@pytest.mark.parametrize("name", DIALOGUES)
def test_the_manual_shows_every_dialogue(name: str) -> None:
    page = (Path(__file__).parents[3] / "docs" / "protocols" / "fanuc_a.md").read_text()
    assert f"```\n{(TRANSCRIPTS / f'{name}.txt').read_text()}```" in page
