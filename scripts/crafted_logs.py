"""Logs whose checksums are right and whose content no run has written."""

from __future__ import annotations

import copy
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np

from haptic_wall.controller.logs.blocks import MAGIC, encoded
from haptic_wall.controller.logs.content import EVENT
from haptic_wall.controller.runtime.telemetry import FLOAT_FIELDS, INT_FIELDS, ROW
from scripts.mutated_logs import Log, block, blocks_of, keys, metadata, rows

ODD: tuple[Any, ...] = (
    None, True, [], {}, "", "text", 0, -1, 99, 5.5, 1e308, 10**30, 10**400, [1, 2], {"a": None},
    "\x1b]0;owned\x07\x1b[2J\x9b31m", "\u202egnp.exe", "\ud800", "a\nended as planned", "$\\frac{$",
    "x" * 5000, [[]] * 1000, {"\x1b[31m": "\x07"}, "../../etc/passwd", "中 é",
)  # fmt: skip
"""Values that may stand anywhere in JSON"""
ODD_WHOLE = (-1, 1, 99, 2**31, 2**53, 2**62, 2**63 - 1, -(2**63), 1 << 61, 1 << 50)
ODD_REAL = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e18, 5e-324, -0.0, 1e15)
Recipe = Callable[[Random], Log]
BY = {"pid": 7, "uid": 0, "user": "me"}
EVENTS: tuple[dict[str, Any], ...] = (
    {"at_s": 0.05, "row": 50, "outcome": "applied", "why": None, "set": ["wall.stiffness=9"],
     "changed": {"wall.stiffness": 9.0}, "waited_s": 0.01,
     "commanded": {"stiffness": 9.0, "damping": 0.02}, "by": BY},
    {"at_s": 0.1, "row": None, "outcome": "refused", "why": "unknown", "set": ["wall.x=1"],
     "changed": None, "waited_s": None, "commanded": None, "by": BY},
    {"at_s": 0.15, "row": 150, "outcome": "applied", "why": None, "set": [], "waited_s": 0.0,
     "changed": {"wall.law": "detents", "wall.count": 24, "delay.steps": 2}, "by": BY},
)  # fmt: skip
"""Changes of the running wall, as a run writes them"""
END: dict[str, Any] = {
    "stop_reason": "trip:overspeed", "message": "too fast", "ticks": 300, "missed": 0, "rows": 300,
    "changes": [EVENTS[0]],
    "servo": {"counts_per_rev": 4096, "torque_step": 0.005, "torque_limit": 4.1, "stall_torque": 4},
}  # fmt: skip
"""The end of a run, as it writes it"""
NAMES = (
    "wall", "stops", "spring", "damper", "detents", "friction", "texture", "profile", "sum",
    "no:Law", "applied", "simulated", "dynamixel", "off", "passive", "both", "start", "notch",
)  # fmt: skip
"""Texts that have a meaning somewhere"""


def _log(contents: list[object], made: list[np.ndarray[Any, Any]], sparse: int = 0) -> Log:
    """A log of these blocks, of which ``made`` hold rows that a run would have written."""
    listed = [key for each in made for key in keys(each)]
    content = b"".join(one if isinstance(one, bytes) else block(one) for one in contents)
    return Log(content, [listed], even=False, sparse=sparse)


def _odd(random: Random, *others: float) -> object:
    return copy.deepcopy(random.choice((*ODD, *others)))


def _mutate(random: Random, tree: Any) -> None:  # noqa: ANN401 - JSON
    """Change the structure of JSON somewhere below its root, in place."""
    parent, key = tree, None
    while isinstance(parent, dict | list) and parent:
        keys = list(parent) if isinstance(parent, dict) else range(len(parent))
        key = random.choice(keys)
        inner = parent[key]
        if not (isinstance(inner, dict | list) and inner) or random.random() < 0.15:
            break
        parent = inner
    held = parent[key]
    match random.choice((0, 1, 2, 3, 4, 5, 5, 5, 6, 6, 6)):
        case 0:
            del parent[key]
        case 1:
            parent[key] = random.choice(([held], {"a": held}, [held] * 3, {key: held}))
        case 2:
            parent[key] = type(held)()
        case 3:
            parent[key] = random.choice(NAMES)
        case 4:
            other = random.choice(list(parent) if isinstance(parent, dict) else range(len(parent)))
            parent[key], parent[other] = parent[other], held
        case 5:
            size = random.choice((10.0 ** random.randint(-12, 12), 5e-324, 1e-300, 1e6, 0.0))
            parent[key] = random.choice((1, 1, 1, -1)) * size
        case _:
            parent[key] = _odd(random)


def story(random: Random) -> dict[str, Any]:
    """Return ``metadata``, ``events`` and ``end`` of a log, with a few changes of structure."""
    preset = random.choice(("simulated", "simulated", "xm430-w350", "emulated-ideal", "lwr3"))
    told: dict[str, Any] = copy.deepcopy(
        {"metadata": metadata(preset), "events": [*EVENTS], "end": END}
    )
    root = random.choice((told["metadata"]["config"], told["events"], told["end"]))
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        if root:
            _mutate(random, root)
    return told


def changed_story(random: Random) -> Log:
    """Anything for a part of the configuration, of the events and of the end."""
    told = story(random)
    made = rows(300)
    events = [{EVENT: each} for each in told["events"]]
    return _log([told["metadata"], made, *events, told["end"]], [made])


def changed_head(random: Random) -> Log:
    """Anything for a part of the metadata."""
    names = ("name", "program", "config", "cut", "phases", "checksum", "version", "format", "more")
    head = metadata()
    for _ in range(random.choice((1, 1, 3))):
        head[random.choice(names)] = _odd(random)
    made = rows(300)
    return _log([head, made], [made])


def changed_config(random: Random) -> Log:
    """Anything for a part of the configuration."""
    head = metadata()
    config: Any = head["config"]
    for _ in range(random.choice((1, 1, 3))):
        section = random.choice(list(config))
        held = config[section]
        if random.random() < 0.2 or not isinstance(held, dict) or not held:
            config[section] = _odd(random)
        else:
            held[random.choice(list(held))] = _odd(random, 1e-9, 50, 10_000, 1e6)
    made = rows(300)
    return _log([head, made], [made])


def changed_end(random: Random) -> Log:
    """Anything for how the run ended, and ends where none belongs."""
    made = rows(300)
    end: dict[str, Any] = {"stop_reason": "duration", "message": "", "rows": 300}
    for _ in range(random.choice((1, 2))):
        end[random.choice(list(end))] = _odd(random)
    contents: list[object] = [metadata(), made[:100], made[100:]]
    contents.insert(random.choice((1, 2, 3)), random.choice((end, _odd(random), [end])))
    return _log(contents, [made])


def changed_text(random: Random) -> Log:
    """JSON that is none, or is more than a program wants to read."""
    made = rows(300)
    text = random.choice((
        b"", b"{", b'{"rows": NaN}', b'{"rows": 1e400}', b'{"a":' * 3000, b"[" * 200_000,
        b'{"a": "' + b"x" * (1 << 22) + b'"}', b"{}" * 1000, b"\xff\xfe{}",
        b'{"rows": 1' + b"0" * 5000 + b"}",
        b'{"stop_reason": "\\ud800"}', b'{"a": [' + b"[]," * 300_000 + b"1]}",
    ))  # fmt: skip
    odd = np.frombuffer(text, np.uint8)
    contents: list[object] = [metadata(), made[:100], made[100:]]
    contents.insert(random.choice((0, 1, 2, 3)), odd)
    return _log(contents, [made])


def changed_columns(random: Random) -> Log:
    """Columns of another name or type, missing ones, more of them."""
    fields: list[Any] = [(name, ROW[name].str) for name in ROW.names or ()]
    at = random.randrange(len(fields))
    name = fields[at][0]
    kinds = (
        "<f4",
        ">i8",
        ">f8",
        "<u8",
        "<i4",
        "|V8",
        "<U4",
        "|S8",
        "<M8[ns]",
        "|b1",
        "<c16",
        "<f2",
    )
    match random.randrange(6):
        case 0:
            fields[at] = (name, random.choice(kinds))
        case 1:
            fields[at] = (name, "<f8", random.choice(((2,), (0,), (3, 3))))
        case 2:
            del fields[at : at + random.choice((1, 5))]
        case 3:
            fields.insert(at, (random.choice(("more", "\x1b[31m", "a" * 300, "%s")), "<f8"))
        case 4:
            fields[at] = (name, [("a", "<f8"), ("b", "<i8")])
        case _:
            random.shuffle(fields)
    made = rows(300)
    odd = np.zeros(random.choice((0, 1, 300)), np.dtype(fields))
    for field in odd.dtype.names or ():
        if field in (ROW.names or ()) and odd.dtype[field] == ROW[field]:
            odd[field] = made[field][: len(odd)]
    contents: list[object] = [metadata(), odd]
    if random.random() < 0.3:
        contents.insert(random.choice((1, 2)), made)
    return _log(contents, [made])


def changed_rows(random: Random) -> Log:
    """Numbers in some rows that no loop writes, or that only a defect would."""
    made = rows(400)
    parts = [made[at : at + 100].copy() for at in range(0, 400, 100)]
    for _ in range(random.choice((1, 1, 2, 4))):
        part = random.choice(parts)
        name = random.choice((*INT_FIELDS, *FLOAT_FIELDS))
        start = random.randrange(100)
        where = random.choice((slice(None), slice(start, start + 1), slice(start, None)))
        part[name][where] = random.choice(ODD_WHOLE if name in INT_FIELDS else ODD_REAL)
    return _log([metadata(), *parts, {"stop_reason": "duration", "rows": 400}], parts)


def changed_order(random: Random) -> Log:
    """Rows out of order within a block, in time or in number, or far ahead."""
    made = rows(300)
    middle = made[100:200].copy()
    match random.randrange(5):
        case 0:
            middle = middle[::-1].copy()
        case 1:
            middle["deadline_ns"] = random.choice((0, 2**60, 5))
        case 2:
            middle["seq"] = random.choice((0, 2**50))
        case 3:
            middle["deadline_ns"] += random.choice((-(10**9), 10**9, 10**15, 10**18))
        case _:
            middle["seq"] += random.choice((-50, 1000, 2**40))
    parts = [made[:100], middle, made[200:]]
    return _log([metadata(), *parts], parts)


def many(random: Random) -> Log:
    """Very many small blocks, ends, or whole logs in one file."""
    made = rows(2000)
    parts: list[Any]
    match random.randrange(4):
        case 0:
            parts = [made[at : at + 1] for at in range(len(made))]
            return _log([metadata(), *parts], [made])
        case 1:
            end = block({"stop_reason": "duration", "rows": 2000})
            return _log([metadata(), made, *[end] * 5000], [made])
        case 2:
            short = b"".join(blocks_of(made[:20], metadata()))
            return _log([short * random.choice((2, 50, 150))], [made[:20]])
        case _:
            empty = block(made[:0])
            return _log([metadata(), made[:1000], *[empty] * 5000, made[1000:]], [made])


def false_blocks(random: Random) -> Log:
    """Twenty megabytes that look like the beginning of blocks, behind an intact one."""
    made = rows(300)
    head = bytes(encoded(np.zeros(random.choice((1, 2**20, 2**24)), np.uint8))[0])
    wrong = head.replace(b"crc32 ", b"crc32 f", 1)
    piece = random.choice((
        MAGIC, MAGIC + b"\xff\xff", MAGIC + b"\x10\x00{'descr': ", head, wrong,
        MAGIC + b"\xf6\x0f{'descr': " + b"[" * 4000, MAGIC + b"\x76\x00{'descr': '|V1000000000'",
        head.replace(b"'|u1'", b"'|O8'"), head[:-1], b"\x93NUMPY",
    ))  # fmt: skip
    contents: list[object] = [metadata(), made[:150], piece * (20_000_000 // len(piece))]
    if random.random() < 0.5:
        contents.append(made[150:])
    return _log(contents, [made])


def sparse(random: Random) -> Log:
    """A file of terabytes in which hardly anything is written."""
    made = rows(300)
    head = bytes(encoded(np.zeros(0, np.uint8))[0]).replace(b"(0,)", b"(1099511627776,)")
    begin = random.choice((head.replace(b"  # crc32", b"# none  "), block(metadata()), b"", MAGIC))
    return _log([begin, *random.choice(([], [made]))], [made], sparse=1 << random.choice((32, 41)))


def dense(random: Random) -> Log:
    """Deadlines next to each other, or days apart: as many rows in ten seconds as there are."""
    made = rows(5000)
    made["deadline_ns"] = 10**9 + made["seq"] * random.choice((1, 10**3, 10**8, 10**14))
    return _log([metadata(), made[:2000], made[2000:]], [made])


def other_preset(random: Random) -> Log:
    """A configuration that is right, and not of these rows."""
    preset = random.choice(("xm430-w350", "xl330-m288", "emulated-ideal", "simulated"))
    head = metadata(preset)
    config: Any = head["config"]
    config["loop"]["rate_hz"] = random.choice((50.0, 1000.0, 10_000.0))
    config["model"]["delay"] = random.choice((0.0, 1.0, {"value": 0.5, "low": 0.0, "high": 1.0}))
    config["wall"]["reference"] = random.choice(("absolute", "start"))
    config["guard"]["mode"] = random.choice(("off", "passive", "stable"))
    made = rows(600)
    made["age_ns"] = random.choice((0, 10**6, 10**12))
    return _log([head, made], [made])


RECIPES: tuple[Recipe, ...] = (
    changed_story, changed_story, changed_story,
    changed_head, changed_head, changed_config, changed_config, changed_end, changed_text,
    changed_columns, changed_rows, changed_rows, changed_order, many, dense, other_preset,
)  # fmt: skip
RARE: tuple[Recipe, ...] = (false_blocks, sparse)
"""Recipes of large files, one in twenty"""


def crafted(random: Random) -> tuple[str, Log]:
    """Return the name of a recipe, and a log with right checksums that no run wrote."""
    recipe = random.choice(RARE if random.random() < 0.05 else RECIPES)
    return recipe.__name__, recipe(random)
