"""`tapewire simulate`: what it prints, its exit status, and how it is interrupted."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import pytest

from tests.cli.helpers import invoke

COMMAND = (sys.executable, "-m", "tapewire", "simulate")


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run((*COMMAND, *words), capture_output=True, text=True, timeout=120, check=False)


def test_a_small_campaign_says_what_it_did() -> None:
    done = run("--protocol", "fanuc-b", "--faults", "no-parity", "--seeds", "1..6", "--jobs", "2")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("6 transfers of ")
    for title in ("Outcomes", "Faults and acts", "bit flip", "simulated hours a second", "No violation."):
        assert title in done.stdout


def test_json_ends_with_the_totals() -> None:
    done = run("--protocol", "fanuc-a", "--faults", "clean", "--seeds", "1..2", "--json")
    assert done.returncode == 0, done.stderr
    end = json.loads(done.stdout.splitlines()[-1])
    assert (end["event"], end["outcome"], end["transfers"], end["failed"]) == ("end", "complete", 2, 0)


def test_one_seed_again_with_its_transcript_is_the_same_twice() -> None:
    words = ("--protocol", "fanuc-b", "--faults", "worn-connector", "--seeds", "2..2", "--transcript")
    first, second = run(*words), run(*words)
    assert "DC1" in first.stdout
    dialogue = first.stdout.split("1 transfers of")[0]
    assert second.stdout.startswith(dialogue)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--protocol", "fanuc-z"), "no protocol"),
        (("--faults", "gremlins"), "no fault preset"),
        (("--seeds", "9..3"), "3..9"),
        (("--seeds", "one"), "A..B"),
        (("--jobs", "0"), "--jobs"),
    ],
)
def test_what_there_is_not_is_refused(words: tuple[str, ...], told: str) -> None:
    finished = invoke("simulate", *words, "--json")
    assert finished.outcome == (2, "failed")
    assert told in finished.stderr


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_ctrl_c_ends_it_with_what_there_is(jobs: str) -> None:
    words = ("--protocol", "fanuc-b", "--faults", "clean", "--seeds", "1..100000", "--json", "--jobs", jobs)
    with subprocess.Popen((*COMMAND, *words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        time.sleep(4)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    end = json.loads(out.splitlines()[-1])
    assert (end["event"], end["outcome"]) == ("end", "cancelled")
    assert "Traceback" not in err
