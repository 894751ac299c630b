"""Counts lines, modules and importers room by room.

    scripts/study rooms

A room is a folder below ``controller`` or ``hw``; modules outside of any are a room together. Lines
count without blank ones. ``one importer``: modules that a single other module imports, tests not
counted.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass
from pathlib import Path

from scripts.imported import imported

ROOT = Path(__file__).resolve().parent.parent


@dataclass(slots=True)
class Room:
    """Sizes of a room."""

    lines: int = 0
    modules: int = 0
    one_importer: int = 0


def counted() -> dict[str, Room]:
    """The rooms of this tree, by name."""
    files = [path for part in ("controller", "hw") for path in sorted((ROOT / part).rglob("*.py"))]
    names = {_name(path.relative_to(ROOT)): path for path in files}
    importers: Counter[str] = Counter()
    for path in [*files, *sorted((ROOT / "scripts").rglob("*.py"))]:
        own = _name(path.relative_to(ROOT))
        importers.update(names.keys() & imported(path) - {own})
    rooms: defaultdict[str, Room] = defaultdict(Room)
    for name, path in names.items():
        room = rooms["/".join(path.relative_to(ROOT).parts[:-1][:2])]
        room.lines += sum(bool(line.strip()) for line in path.read_text("utf-8").splitlines())
        room.modules += 1
        room.one_importer += importers[name] == 1
    return dict(sorted(rooms.items()))


def _name(path: Path) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def told(rooms: dict[str, Room]) -> str:
    """A table in Markdown."""
    lines = ["| room | lines | modules | one importer |", "|---|---|---|---|"]
    total = Room()
    for name, room in rooms.items():
        lines.append(f"| {name} | {room.lines} | {room.modules} | {room.one_importer} |")
        total.lines += room.lines
        total.modules += room.modules
        total.one_importer += room.one_importer
    lines.append(f"| **all** | {total.lines} | {total.modules} | {total.one_importer} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table of this tree."""
    print(told(counted()))


if __name__ == "__main__":
    main()
