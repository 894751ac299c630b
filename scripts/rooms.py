"""Counts lines, modules and importers room by room, in this tree or at revisions of it.

    scripts/study rooms [REVISION ...]

A room is a folder below ``controller`` or ``hw``; modules outside of any are a room together. Lines
count without blank ones. ``one importer``: modules that a single other module imports, tests not
counted.
"""

from __future__ import annotations

import argparse
import io
import subprocess
import tarfile
import tempfile
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scripts.imported import imported

ROOT = Path(__file__).resolve().parent.parent
_PARTS = ("controller", "hw")


@dataclass(slots=True)
class Room:
    """Sizes of a room."""

    lines: int = 0
    modules: int = 0
    one_importer: int = 0


def counted(root: Path) -> dict[str, Room]:
    """The rooms of a tree, by name.

    Args:
        root: The folder that holds ``controller`` and ``hw``.

    Raises:
        FileNotFoundError: It holds neither.
    """
    files = [path for part in _PARTS for path in sorted((root / part).rglob("*.py"))]
    if not files:
        raise FileNotFoundError(f"{root} holds no {' and no '.join(_PARTS)}: give another tree")
    names = {_name(path.relative_to(root)): path for path in files}
    importers: Counter[str] = Counter()
    for path in [*files, *sorted((root / "scripts").rglob("*.py"))]:
        own = _name(path.relative_to(root))
        importers.update(names.keys() & imported(path) - {own})
    rooms: defaultdict[str, Room] = defaultdict(Room)
    for name, path in names.items():
        room = rooms["/".join(path.relative_to(root).parts[:-1][:2])]
        room.lines += sum(bool(line.strip()) for line in path.read_text("utf-8").splitlines())
        room.modules += 1
        room.one_importer += importers[name] == 1
    return dict(sorted(rooms.items()))


def _name(path: Path) -> str:
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def at_revision(revision: str) -> dict[str, Room]:
    """The rooms of the project at a revision.

    Raises:
        SystemExit: There is no such revision.
    """
    packed = subprocess.run(
        ["git", "-C", ROOT, "archive", revision, *_PARTS, "scripts"],
        capture_output=True,
        check=False,
    )
    if packed.returncode:
        raise SystemExit(f"rooms: {packed.stderr.decode().strip()}: give a revision of this tree")
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
            archive.extractall(folder, filter="data")
        return counted(Path(folder))


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


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table for each revision, or for this tree."""
    parser = argparse.ArgumentParser(
        "rooms", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("revisions", nargs="*", help="as git names them; none: this tree")
    given = parser.parse_args(arguments)
    if not given.revisions:
        print(told(counted(ROOT)))
    for revision in given.revisions:
        print(f"{revision}\n\n{told(at_revision(revision))}\n")


if __name__ == "__main__":
    main()
