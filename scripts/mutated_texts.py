"""Configurations and CSVs that were changed at random, or made to be as hard as possible."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from random import Random

import numpy as np

from haptic_wall.controller.settings.load import preset_names

NUMBER = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")
_NASTY = (
    "\x00", "\x1b[31m", "\u202e", "\t", "\r", "\ufeff", "'", '"', "{", "}", "[", "]", "&a ", "*a",
    "<<: *a", "!!", "!!bool ", "!!python/object:os.system ", "- ", ": ", "#", "|", ">", "%", "@",
    "9" * 400, "1e400", "-1e400", ".nan", ".inf", "0x10", "1_000", "010", "1:30", "~", "true",
    "off",
)  # fmt: skip


def _special(random: Random, path: Path) -> str:
    """Something that is no file, or one without end, where a file is wanted."""
    kind = random.choice(("pipe", "socket", "device", "folder", "loop", "sparse", "nothing"))
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "socket":
            here = Path.cwd()
            os.chdir(path.parent)  # the name of a socket must be short
            try:
                with socket.socket(socket.AF_UNIX) as bound:
                    bound.bind(path.name)
            finally:
                os.chdir(here)
        case "device":
            path.symlink_to(random.choice(("/dev/zero", "/dev/full", "/dev/tty", "/dev/ptmx")))
        case "folder":
            path.mkdir()
        case "loop":
            path.symlink_to(path)
        case "sparse":
            path.touch()
            os.truncate(path, 1 << 41)
        case _:
            pass
    return kind


def _edited(random: Random, text: str) -> str:
    """A text with lines, words and characters changed."""
    for _ in range(random.choice((1, 1, 2, 5))):
        lines = text.splitlines(keepends=True) or [""]
        at, other = random.randrange(len(lines)), random.randrange(len(lines))
        place = random.randrange(len(text) + 1)
        match random.randrange(8):
            case 0:
                del lines[at]
            case 1:
                lines.insert(other, lines[at])
            case 2:
                lines[at], lines[other] = lines[other], lines[at]
            case 3:
                lines[at] = random.choice((" ", "  ", "\t", "- ", "#")) + lines[at]
            case 4:
                lines[at] = lines[at].rstrip("\n")
            case 5:
                lines = [text[:place], random.choice(_NASTY), text[place:]]
            case 6:
                lines = [text[:place], text[place + random.choice((1, 5, 50)) :]]
            case _:
                found = random.choice([*NUMBER.finditer(text), None])
                odd = random.choice((*_NASTY, "5", "-3", "1e-300", "1e9", "nan"))
                if found is not None:
                    lines = [text[: found.start()], odd, text[found.end() :]]
        text = "".join(lines)
    return text


def _aliases(random: Random) -> str:
    """Few bytes that stand for very many values."""
    width, depth = random.choice(((9, 9), (2, 30), (50, 4), (3, 20)))
    names = [f"n{level}" for level in range(depth)]
    leaf, join = random.choice((("[x, x]", "[{}]"), ("{k: 1}", "{{<<: [{}]}}")))
    text = f"{names[0]}: &{names[0]} {leaf}\n"
    for level in range(1, depth):
        inner = ", ".join([f"*{names[level - 1]}"] * width)
        text += f"{names[level]}: &{names[level]} {join.format(inner)}\n"
    return text + random.choice(("", f"wall: *{names[-1]}\n", f"wall: {{<<: *{names[-1]}}}\n"))


def _many(random: Random) -> str:
    """Very much of one thing."""
    count = random.choice((100, 2000, 8000, 20_000))
    match random.randrange(9):
        case 0:
            return "".join(f"k{number}: 1\n" for number in range(count))
        case 1:
            return "wall:\n" + "".join(f"  k{number}: 1\n" for number in range(count))
        case 2:
            return "servo: {faults: [" + "drop, " * count + "]}\n"
        case 3:
            return random.choice(("[", "{a: ", "- ", "? ", "'", '"', "#", " ", "\n")) * count
        case 4:
            return "wall: {side: " + "k" * count + "}\n"
        case 5:
            return "a: &a [*a, *a]\n" * random.choice((1, 5))
        case 6:
            return "wall: {stiffness: " + "9" * count + "}\n"
        case 7:
            return "".join(f"model: {{inertia: {number}}}\n---\n" for number in range(count))
        case _:
            return "".join(f"&a{number} k{number}: *a{number}\n" for number in range(count))


def configuration(random: Random, path: Path) -> str:
    """Write a configuration that is odd in some way; in which."""
    name = random.choice(preset_names())
    text = (
        resources.files("haptic_wall.controller")
        .joinpath(f"presets/{name}.yaml")
        .read_text("utf-8")
    )
    draw = random.random()
    if draw < 0.05:
        return _special(random, path)
    if draw < 0.1:
        data = bytearray(text.encode())
        for _ in range(random.choice((1, 10, 100))):
            data[random.randrange(len(data))] = random.randrange(256)
        path.write_bytes(data)
        return "bytes"
    if draw < 0.15:
        path.write_text(text, random.choice(("utf-16", "utf-32", "utf-8-sig", "utf-7")))
        return "encoding"
    how: Callable[[Random], str] = random.choice((_aliases, _many))
    made = how(random) if draw < 0.4 else _edited(random, text)
    path.write_text(made, "utf-8", errors="replace", newline="")
    return how.__name__ if draw < 0.4 else "edited"


@dataclass(frozen=True, slots=True)
class Table:
    """Content of a CSV."""

    rows: int
    """That have a time and a position, each with a time of its own"""
    periods: tuple[float, ...]
    """Periods of the recordings in it [s]"""


def _recordings(random: Random) -> tuple[list[list[str]], Table]:
    """One to three recordings, some time apart; the cells of their rows."""
    cells: list[list[str]] = []
    periods = []
    times_from = random.choice((0.0, 0.0, 5.0, 1.7e9, -3e5))
    jitter = random.choice((0.0, 0.0, 0.05, 0.4))
    count = 0
    for _ in range(random.choice((1, 1, 1, 2, 2, 3))):
        period = random.choice((1e-3, 1e-3, 2e-3, 2e-2, 1e-4))
        samples = random.choice((40, 500, 2000))
        steps = np.arange(samples) + jitter * np.array([random.random() for _ in range(samples)])
        times = times_from + period * steps
        swing = 0.05 * np.cos(31.0 * (times - times[0]))
        cells += [[f"{t:.7f}", f"{x:.6f}", f"{-x:.6f}"] for t, x in zip(times, swing, strict=True)]
        times_from = float(times[-1]) + random.choice((0.5, 60.0, 86_400.0, 30 * 86_400.0))
        periods.append(period)
        count += samples
    return cells, Table(count, tuple(periods))


_CELLS = (
    "", " ", "nan", "NaN", "inf", "-inf", "1e400", "abc", "1,5", "1_0", "٣", "0x1", "1e300", "-",
    "\x1b[31m", '"', '""', "=1+1", "true", " 1.0 ",
)  # fmt: skip


def csv(random: Random, path: Path) -> tuple[str, Table | None]:
    """Write a CSV that is odd in some way; in which, and what it holds if that is known."""
    draw = random.random()
    if draw < 0.04:
        return _special(random, path), None
    cells, table = _recordings(random)
    names = ["time_s", "position_rad", "torque_nm"]
    if draw < 0.3:  # as of a user, and all in order
        _write(path, names, cells, random)
        return "recordings", table
    if draw < 0.6:
        for _ in range(random.choice((1, 1, 5, 100))):
            row = random.choice(cells)
            row[random.randrange(len(row))] = random.choice((*_CELLS, random.choice(cells)[0]))
        _write(path, names, cells, random)
        return "cells", None
    if draw < 0.75:
        at, other = sorted(random.randrange(len(cells)) for _ in range(2))
        change = random.choice(("turned", "again", "without", "shuffled", "still"))
        match change:
            case "turned":
                cells[at:other] = reversed(cells[at:other])
            case "again":
                cells += cells[at:other]
            case "without":
                del cells[at:other]
            case "shuffled":
                random.shuffle(cells)
            case _:
                cells[at:other] = [cells[at]] * (other - at)
        _write(path, names, cells, random)
        return change, None
    if draw < 0.9:
        _write(path, names, cells, random)
        text = path.read_text("utf-8")
        path.write_text(_edited(random, text), "utf-8", errors="replace", newline="")
        return "edited", None
    path.write_bytes(_hard(random))
    return "hard", None


def _write(path: Path, names: list[str], cells: list[list[str]], random: Random) -> None:
    end = random.choice(("\n", "\n", "\r\n", "\r"))
    lines = [",".join(names), *(",".join(row) for row in cells)]
    path.write_text(end.join(lines) + end, "utf-8", newline="")


def _hard(random: Random) -> bytes:
    """Bytes that are no table, or one that costs as much as possible."""
    head = b"time_s,position_rad\n"
    size = random.choice((100, 10_000, 5_000_000))
    match random.randrange(10):
        case 0:
            return random.randbytes(min(size, 100_000))
        case 1:
            return head + random.randbytes(min(size, 100_000))
        case 2:
            return head.strip() + b",1" * size
        case 3:
            return head + b'"' + b"1\n" * size
        case 4:
            return head + b'"\n",' * size
        case 5:
            return head + b"\n" * size
        case 6:
            return head + b"," * size
        case 7:  # each sample so far from the next that nothing is usual
            times = np.cumsum(np.exp(np.linspace(-9, random.choice((9, 25)), min(size, 20_000))))
            return head + b"".join(b"%.9g,0\n" % t for t in times)
        case 8:  # bursts
            times = np.arange(min(size, 20_000)) * 1e-4
            times += np.floor(np.arange(times.size) / random.choice((3, 9, 12))) * 10.0
            return head + b"".join(b"%.9g,%d\n" % (t, k % 7) for k, t in enumerate(times))
        case _:
            return bytes([random.randrange(256)]) * size
