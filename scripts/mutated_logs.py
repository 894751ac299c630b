"""Damaged logs, and logs with right checksums that no run wrote.

Every row of a log that is made here is unlike all others in what a CSV shows of it, so that rows
which are read can be told from rows which were never written.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.logs.blocks import MAGIC, encoded
from haptic_wall.controller.logs.columns import COLUMNS, values
from haptic_wall.controller.logs.content import FORMAT
from haptic_wall.controller.runtime.telemetry import FLAG_CONTACT, ROW
from haptic_wall.controller.settings.load import load_config

BLOCK = 100
"""Rows in a block"""
Key = tuple[float | None, ...]


@dataclass(slots=True)
class Log:
    """A file's bytes, and what is in it."""

    content: bytes
    written: list[list[Key]]
    """Rows of a CSV, without the time, for each log that it was made of; of the first log all
    are expected"""
    even: bool
    """Rows are a millisecond apart"""
    sparse: int = 0
    """Length that the file is given [bytes]; 0: its own"""


def rows(count: int, start: int = 0, hand: float = 0.0) -> NDArray[np.void]:
    """A hand that goes in and out of a wall; no two rows are alike."""
    made = np.zeros(count, ROW)
    seq = np.arange(start, start + count)
    made["seq"], made["deadline_ns"] = seq, 3 * 10**9 + 10**6 * seq
    swing = 0.1 * np.sin(seq / 40.0 + hand)
    made["position"] = np.round(swing * 4096 / np.pi) * np.pi / 4096
    made["flags"] = np.where(made["position"] > 0.0, FLAG_CONTACT, 0)
    made["torque"] = made["wall_torque"] = np.where(swing > 0.0, -8.0 * swing, 0.0)
    made["stiffness"], made["damping"], made["delay_s"] = 8.0, 0.02, 3e-4
    made["lateness_ns"] = 1000 + seq + round(1e7 * hand)
    made["measured_torque"] = np.nan
    return made


def metadata(preset: str = "simulated", **changed: object) -> dict[str, object]:
    """Metadata that a log begins with."""
    config = load_config(preset).config.model_dump(mode="json")
    head = {**FORMAT, "program": "haptic-wall", "name": preset, "config": config}
    return {**head, **changed}


def block(content: object) -> bytes:
    """The bytes of an array, or of what is JSON, with right checksums."""
    if not isinstance(content, np.ndarray):
        content = np.frombuffer(json.dumps(content).encode(), np.uint8)
    head, data = encoded(content)
    return head + bytes(data)


def keys(made: NDArray[np.void]) -> list[Key]:
    """Rows of a CSV without the time."""
    columns = [values(made, name, 0).tolist() for name in COLUMNS if name != "time_s"]
    table = zip(*columns, strict=True)
    return [tuple(None if math.isnan(x) else float(x) for x in row) for row in table]


def blocks_of(made: NDArray[np.void], head: dict[str, object]) -> list[bytes]:
    """A whole log, block by block: metadata, rows, end."""
    parts = [made[at : at + BLOCK] for at in range(0, len(made), BLOCK)]
    end = {"stop_reason": "duration", "message": "", "ticks": len(made), "rows": len(made)}
    return [block(head), *map(block, parts), block(end)]


def spans(random: Random, size: int) -> tuple[int, int]:
    """Some stretch of so many bytes."""
    start = random.randrange(size)
    length = random.choice((1, 8, 64, 4096, random.randrange(1, 60_000)))
    return start, min(size, start + length)


def _flipped(random: Random, content: bytes) -> bytes:
    data = bytearray(content)
    for _ in range(random.choice((1, 1, 1, 2, 5, 50))):
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)
    return bytes(data)


def _spoilt(random: Random, content: bytes) -> bytes:
    start, end = spans(random, len(content))
    size = end - start
    other = random.choice((bytes(size), random.randbytes(size), b"\xff" * size))
    return content[:start] + other + content[end:]


def _cut(random: Random, content: bytes) -> bytes:
    start = random.randrange(len(content))
    tail = random.choice((b"", bytes(len(content) - start), random.randbytes(100)))
    return content[:start] + tail


def _without(random: Random, content: bytes) -> bytes:
    start, end = spans(random, len(content))
    return content[:start] + content[end:]


def _grown(random: Random, content: bytes) -> bytes:
    at = random.randrange(len(content) + 1)
    start, end = spans(random, len(content))
    more = random.choice((random.randbytes(end - start), content[start:end], MAGIC * 20))
    return content[:at] + more + content[at:]


def _exchanged(random: Random, content: bytes) -> bytes:
    a, b, c = sorted(random.randrange(len(content) + 1) for _ in range(3))
    return content[:a] + content[b:c] + content[a:b] + content[c:]


BYTES: Sequence[Callable[[Random, bytes], bytes]] = (
    _flipped,
    _flipped,
    _spoilt,
    _spoilt,
    _cut,
    _without,
    _grown,
    _exchanged,
)
"""Damage to bytes by a failing disk, a power cut or a slip of the hand"""


def _moved(random: Random, parts: list[bytes], _other: list[bytes]) -> None:
    parts.insert(random.randrange(1, len(parts)), parts.pop(random.randrange(1, len(parts))))


def _twice(random: Random, parts: list[bytes], _other: list[bytes]) -> None:
    parts.insert(random.randrange(1, len(parts) + 1), random.choice(parts))


def _lacking(random: Random, parts: list[bytes], _other: list[bytes]) -> None:
    del parts[random.randrange(1, len(parts))]


def _turned(_random: Random, parts: list[bytes], _other: list[bytes]) -> None:
    parts[1:-1] = reversed(parts[1:-1])


def _shuffled(random: Random, parts: list[bytes], _other: list[bytes]) -> None:
    order = parts[1:]
    random.shuffle(order)
    parts[1:] = order


def _joined(random: Random, parts: list[bytes], other: list[bytes]) -> None:
    parts += other[: random.randrange(1, len(other) + 1)]


def _joined_to_itself(_random: Random, parts: list[bytes], _other: list[bytes]) -> None:
    parts += parts


def _foreign(random: Random, parts: list[bytes], other: list[bytes]) -> None:
    """A block of another log in the midst, so that it is out of its place."""
    at = random.randrange(2, len(parts))
    parts.insert(at, other[random.randrange(1, min(at, len(other)))])


BLOCKS: Sequence[Callable[[Random, list[bytes], list[bytes]], None]] = (
    _moved,
    _twice,
    _lacking,
    _turned,
    _shuffled,
    _joined,
    _joined_to_itself,
    _foreign,
)
"""Changes of whole blocks, whose checksums stay right"""


def mutated(random: Random) -> tuple[str, Log]:
    """Return the names of random changes, and a log of the current format with these changes."""
    made, other = rows(random.choice((150, 400, 900))), rows(400, hand=0.7)
    parts = blocks_of(made, metadata())
    others = blocks_of(other, metadata("emulated-ideal"))
    done = []
    for _ in range(random.choice((0, 1, 1, 2))):
        change = random.choice(BLOCKS)
        change(random, parts, others)
        done.append(change.__name__)
    content = b"".join(parts)
    for _ in range(random.choice((0, 1, 1, 3)) if done else random.choice((1, 1, 2, 4))):
        change_bytes = random.choice(BYTES)
        content = change_bytes(random, content) or b"\0"
        done.append(change_bytes.__name__)
    return " ".join(done), Log(content, [keys(made), keys(other)], even=True)
