"""Commissioning folders that were edited: figures, pictures, links, what is no JSON at all."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from random import Random
from typing import Any

SECRET = b"nobody else may read this\n"
"""In a file beside the folder, which must not come into the report"""
_ODD: tuple[Any, ...] = (
    None, True, [], {}, "", "text", 0, -1, 99, 5.5, 1e308, 10**30, 10**400, [1, 2], {"a": None},
    "\x1b]0;owned\x07", "\u202e", "\ud800", "$\\frac{$", "<script>alert(1)</script>", "x" * 5000,
    "../secret", "/etc/passwd", "secret", float("nan"), float("inf"), "servo: 7", "{{ 7 * 7 }}",
)  # fmt: skip
_TEXTS = ("", "[", "[" * 100_000, "null", '{"step": 1e999}', "\0", "{}", "x" * 100)


def edited(random: Random, base: Path, folder: Path) -> str:
    """Copy the folder of a finished commissioning, and edit the copy; return the changes."""
    shutil.copytree(base, folder)
    (folder.parent / "secret").write_bytes(SECRET)
    done = []
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        path = random.choice(sorted(folder.iterdir()))
        if path.suffix == ".json" and random.random() < 0.8:
            done.append(f"{path.name} {_edited_json(random, path)}")
        elif path.is_file():
            done.append(f"{path.name} {_replaced(random, path)}")
    return ", ".join(done)


def _edited_json(random: Random, path: Path) -> str:
    try:
        held = json.loads(path.read_text("utf-8"))
    except ValueError:
        return "as it is"
    place: Any = held
    while isinstance(place, dict | list) and place:
        key = random.choice(list(place) if isinstance(place, dict) else range(len(place)))
        if isinstance(place[key], dict | list) and place[key] and random.random() < 0.8:
            place = place[key]
            continue
        match random.randrange(3):
            case 0:
                del place[key]
            case 1 if isinstance(place, dict):
                place["more"] = random.choice(_ODD)
            case _:
                place[key] = random.choice(_ODD)
        break
    path.write_text(json.dumps(held), "utf-8")
    return f"at {key}" if held else "emptied"


def _replaced(random: Random, path: Path) -> str:
    kind = random.choice(("bytes", "text", "gone", "pipe", "link", "device", "folder", "sparse"))
    if kind == "bytes":
        data = bytearray(path.read_bytes()) or bytearray(b"\0")
        for _ in range(random.choice((1, 10))):
            data[random.randrange(len(data))] = random.randrange(256)
        path.write_bytes(data)
        return kind
    path.unlink()
    match kind:
        case "text":
            path.write_text(random.choice(_TEXTS), "utf-8")
        case "pipe":
            os.mkfifo(path)
        case "link":
            path.symlink_to(path.parent.parent / "secret")
        case "device":
            path.symlink_to("/dev/zero")
        case "folder":
            path.mkdir()
        case "sparse":
            path.touch()
            os.truncate(path, 1 << 40)
        case _:
            pass
    return kind
