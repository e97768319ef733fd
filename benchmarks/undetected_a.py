"""How often protocol A and expansion A take something else than was sent, by their own rules alone.

The line's parity is left out (as with 8N2): what is damaged is judged by sum, command and end code, or by number, sum
and end code, as the readers of the project judge it. Bound: an 8-bit sum lets 1 of 256 through when the damage is
random; two regular errors can do worse, and swaps always pass.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Final

from benchmarks.report import table, write_section
from tapewire.codes import DataCode
from tapewire.engine import Events
from tapewire.protocols.fanuc_a import Params
from tapewire.protocols.fanuc_a.cnc_job import Job
from tapewire.protocols.fanuc_a.cnc_packets import PacketSession, Verdict
from tapewire.protocols.fanuc_a.messages import Coding, Command, Message, MessageReader, encode_message
from tapewire.protocols.fanuc_a.packets import (
    END_NUMBER,
    NUMBERS,
    BadPacket,
    Packet,
    data_bytes,
    encode_packet,
)
from tapewire.protocols.fanuc_a.status import Parameters, Status

PAGE: Final = Path(__file__).parent.parent / "docs" / "protocols" / "fanuc_a.md"
PROGRAM: Final = (Path(__file__).parent.parent / "examples" / "surfacing.nc").read_bytes()
TRIALS: Final = 5000
SEED: Final = 5

Damage = Callable[[bytearray, Random], None]
"""Spoils characters in place."""

Trial = Callable[[Damage, Random], bool | None]
"""Sends something with a damage: whether the damage passed; None when it changed nothing."""


def flip(data: bytearray, at: int, bit: int) -> None:
    data[at] ^= 1 << bit


def one_bit(data: bytearray, random: Random) -> None:
    flip(data, random.randrange(len(data)), random.randrange(8))


def two_bits(data: bytearray, random: Random) -> None:
    for at in random.sample(range(len(data)), 2):
        flip(data, at, random.randrange(8))


def burst(data: bytearray, random: Random) -> None:
    at = random.randrange(len(data) - 3)
    data[at : at + 4] = random.randbytes(4)


def swap(data: bytearray, random: Random) -> None:
    """Two neighbours that differ, neither of them of the frame: behind sum and command, before sum or end code."""
    while True:
        at = random.randrange(5, len(data) - 4)
        if data[at] != data[at + 1]:
            data[at], data[at + 1] = data[at + 1], data[at]
            return


def loss(data: bytearray, random: Random) -> None:
    del data[random.randrange(len(data))]


def gap(data: bytearray, random: Random) -> None:
    """As when nobody fetches the characters of a UART in time; at most what the shortest subject has."""
    length = random.randrange(2, 33)
    at = random.randrange(len(data) - length)
    del data[at : at + length]


def doubling(data: bytearray, random: Random) -> None:
    at = random.randrange(len(data))
    data.insert(at, data[at])


def loss_and_doubling(data: bytearray, random: Random) -> None:
    """The length stays as it was, and what lies between has moved by one."""
    lost, doubled = random.sample(range(len(data) - 1), 2)
    data.insert(doubled, data[doubled])
    del data[lost + (lost > doubled)]


def early_end(data: bytearray, random: Random) -> None:
    """2Dh and 4Dh are one bit away from 0Dh."""
    places = [at for at in range(5, len(data) - 1) if data[at] in b"-M"]
    if places:
        data[random.choice(places)] = 0x0D


DAMAGES: Final[tuple[tuple[str, Damage], ...]] = (
    ("one bit", one_bit),
    ("two bits in different characters", two_bits),
    ("four neighbours replaced at random", burst),
    ("two neighbours swapped", swap),
    ("one character lost", loss),
    ("2 to 32 neighbours lost", gap),
    ("one character doubled", doubling),
    ("one character lost, another doubled", loss_and_doubling),
    ("one bit that makes `-` or `M` a CR", early_end),
)


def piece(random: Random, size: int) -> bytes:
    at = random.randrange(len(PROGRAM) - size)
    return PROGRAM[at : at + size]


# what is sent, and what is taken of it


def accepts_message(message: Message, damage: Damage, random: Random) -> bool | None:
    """Whether a message is taken that nobody sent; None when the damage left it as it was."""
    sent = encode_message(message, Coding())
    wire = bytearray(sent)
    damage(wire, random)
    if wire == sent:
        return None
    reader, position = MessageReader(Coding()), 0
    while position < len(wire):
        position, reading = reader.read(bytes(wire), position)
        if isinstance(reading, Message) and reading != message:
            return True
    return False


def dat(size: int) -> Trial:
    return lambda damage, random: accepts_message(
        Message(command=Command.DAT, data=piece(random, size)), damage, random
    )


def sat(damage: Damage, random: Random) -> bool | None:
    status = Status(stored=random.randrange(8192), parameters=Parameters(tp=random.randrange(5, 99)))
    return accepts_message(Message(command=Command.SAT, data=status.encode()), damage, random)


def packet(n: int) -> Trial:
    """Five packets, the third damaged: the control takes the others, or passes them over when it has noticed."""

    def trial(damage: Damage, random: Random) -> bool | None:
        data = piece(random, 5 * data_bytes(n))
        sent = [
            encode_packet(number, data[at * data_bytes(n) :][: data_bytes(n)], n)
            for at, number in enumerate(NUMBERS[:5])
        ]
        wire = bytearray(sent[2])
        damage(wire, random)
        if wire == sent[2]:
            return None
        return not data.startswith(taken(b"".join([*sent[:2], bytes(wire), *sent[3:]]), n))

    return trial


def taken(wire: bytes, n: int) -> bytes:
    """What a control has of the program when `wire` has come in."""
    job, session = reading_control(n)
    program, position = b"", 0
    while position < len(wire):
        position, reading = session.reader.read(wire, position)
        if reading is not None:
            session.receive(reading)
            program += job.take(data_bytes(n), connected=True)
    return program


def reading_control(n: int) -> tuple[Job, PacketSession]:
    job = Job(Events(), DataCode.ASCII)
    job.begin()
    job.link_up()
    return job, PacketSession(Params(), Parameters(n=n), job, Events())


SUBJECTS: Final[tuple[tuple[str, Trial], ...]] = (
    ("DAT, 1950 bytes", dat(1950)),
    ("DAT, 30 bytes", dat(30)),
    ("SAT", sat),
    ("packet, n = 1", packet(1)),
    ("packet, n = 4", packet(4)),
)


def undetected(trial: Trial, damage: Damage, random: Random) -> str:
    outcomes = [outcome for _ in range(TRIALS) if (outcome := trial(damage, random)) is not None]
    return f"{sum(outcomes) / len(outcomes):.2%}" if outcomes else ""


def share_of_cancelling_bits() -> float:
    """Two flips in different characters cancel when they are of the same bit and in opposite directions; of bit 8,
    worth 128, in any direction."""
    ones = [sum(byte >> bit & 1 for byte in PROGRAM) / len(PROGRAM) for bit in range(7)]
    return (sum(2 * share * (1 - share) for share in ones) + 1) / 64


# whole packets


WHOLE: Final = 30
"""Packets of a transfer: 29 effective ones and the end packet."""


def numbered() -> list[Packet]:
    data = b"G01 X1.5\n" + bytes(247)
    effective = [Packet(number=NUMBERS[count % 10], data=data) for count in range(WHOLE - 1)]
    return [*effective, Packet(number=END_NUMBER, data=data)]


def unnoticed(order: list[Packet]) -> bool:
    """The control gets the end packet and has asked for nothing again."""
    job, session = reading_control(1)
    for each in order:
        verdict = session.receive(each)
        job.take(256, connected=True)
        session.freed()
        if verdict is Verdict.END:
            return session.next_monitor() is None
        if session.next_monitor() is not None:
            return False
    return False


def whole_packets() -> list[list[str]]:
    """Every place at which it can happen, not a sample."""
    sent = numbered()
    effective = range(WHOLE - 1)
    cases = {
        "one lost": [sent[:at] + sent[at + 1 :] for at in effective],
        "two in a row lost": [sent[:at] + sent[at + 2 :] for at in range(WHOLE - 2)],
        "ten in a row lost": [sent[:at] + sent[at + 10 :] for at in range(WHOLE - 10)],
        "one doubled": [sent[: at + 1] + sent[at:] for at in effective],
        "two neighbours swapped": [[*sent[:at], sent[at + 1], sent[at], *sent[at + 2 :]] for at in range(WHOLE - 2)],
    }
    rows = [[name, f"{sum(map(unnoticed, orders))} of {len(orders)}"] for name, orders in cases.items()]
    lost_naks = sum(goes_on_without_nak(sent, at) for at in effective)
    return [*rows, ["one spoilt, and all of its NAK lost", f"{lost_naks} of {len(effective)}"]]


def goes_on_without_nak(sent: list[Packet], spoilt: int) -> bool:
    """The host never hears of it; the control takes the packet of that number ten later for the one it asked for."""
    job, session = reading_control(1)
    for at, each in enumerate(sent):
        verdict = session.receive(BadPacket(number=each.number, why="checksum error") if at == spoilt else each)
        asked = session.next_monitor()
        if verdict is Verdict.END or (asked is not None and at != spoilt):
            return verdict is Verdict.END
        job.take(256, connected=True)
        session.freed()
    return False


def main() -> None:
    random = Random(SEED)
    expected: dict[Damage, str] = {
        one_bit: "0, but for the last row",
        two_bits: f"{share_of_cancelling_bits():.2%} cancel",
        burst: f"1/256 = {1 / 256:.2%}",
        swap: "100 %",
        loss: "0",
        gap: f"1/256 = {1 / 256:.2%} in messages; a packet is too short then",
        loss_and_doubling: "where the two are alike, and 1/256 of the rest",
        doubling: "0; more where packets are looked for at every character",
        early_end: f"1/256 = {1 / 256:.2%}; packets have no end code to look for",
    }
    rows = []
    for name, damage in DAMAGES:
        rows.append([name, *(undetected(trial, damage, random) for _, trial in SUBJECTS), expected[damage]])
        print(rows[-1], flush=True)
    text = (
        f"Share of damaged messages and packets of which something is taken that nobody sent, of {TRIALS} trials each "
        f"(seed {SEED}; program: the example), beside what the 8-bit sum lets one expect. Damage strikes anywhere in "
        "the frame, a swap only in the data. The line's parity is not counted, as with 8N2: with 8E1 it finds every "
        "single bit, and two when they are in different characters.\n\n"
    )
    text += table(["damage", *(name for name, _ in SUBJECTS), "expected"], rows)
    text += (
        f"\n\nWhole packets of a transfer of {WHOLE}, at every place where it can happen: how often the control "
        "gets the end packet and has asked for nothing again.\n\n"
    )
    text += table(["whole packets", "unnoticed"], whole_packets())
    write_section("undetected-a", "How much passes undetected", text, PAGE)


if __name__ == "__main__":
    main()
