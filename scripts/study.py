"""Runs a study: its cases, a row for each, and the parts of a page that are made from them.

    scripts/study                    list what there is
    scripts/study NAME [--help]      run one

A study is a module of scripts/studies that holds a ``STUDY``; other modules of scripts/ with a
``main`` are started in the same way. A part of a page stands between ``<!-- computed: NAME -->``
and ``<!-- end -->``; the text around the parts is written by hand and stays as it is. The first
comment then names the commit that computed it, and the list says which parts are of older code.
"""

from __future__ import annotations

import os

# One thread for each process: the processes take all cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import contextlib
import importlib
import itertools
import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar, get_type_hints

from pydantic import TypeAdapter

from haptic_wall.controller.bench.machine import machine, versions
from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.experiments.processes import cores, not_from_the_terminal, processes

ROOT = Path(__file__).resolve().parent.parent
PART = re.compile(r"(<!-- computed: ([\w-]+)(?: at \w+)? -->\n)(.*?)(<!-- end -->)", re.S)
ROOMS = ("controller", "hw")
"""Whose changes make a part older"""

Given = argparse.Namespace
Case = TypeVar("Case")
Row = TypeVar("Row")
Found = Sequence[tuple[Case, Row]]
"""Each case with its row"""


class NoPlaceError(LookupError):
    """The page of a study, or the two comments of a part, are missing."""


@dataclass(frozen=True, slots=True)
class Option:
    """An option of a study: an amount, a seed, a choice."""

    name: str
    usual: Any
    """Value without the option; its type is that of the values, of a tuple that of its elements"""
    help: str
    quick: Any = None
    """Value with ``--quick``; None: as usual"""
    choices: Sequence[str] | None = None


def _every_row(_found: Found[Any, Any]) -> bool:
    return True


@dataclass(frozen=True, slots=True)
class Part(Generic[Case, Row]):
    """A part of a page, made of one kind of cases."""

    name: str
    """Name of the mark on the page, and for ``--only``"""
    cases: Callable[[Given], Iterable[Case]]
    """From the options; the draws depend on them alone. A case is told from others by its
    ``repr``"""
    row: Callable[[Case], Row]
    """A function of its module, whose annotation says how a row is kept in a file"""
    lines: Callable[[Found[Case, Row]], Iterable[str]]
    """Text of the part"""
    case_s: float = 1.0
    """Time for one case on one core, about [s]"""
    in_turn: bool = False
    """One case after the other in this process: what is measured in real time"""
    wanted: Callable[[Found[Case, Row]], bool] = _every_row
    """Whether what is wanted holds; the exit status is 1 where it does not"""


@dataclass(frozen=True, slots=True)
class Study:
    """Options, and the parts of a page."""

    page: str
    """In docs/"""
    parts: tuple[Part[Any, Any], ...]
    options: tuple[Option, ...] = ()
    everywhere: bool = False
    """The text is the same on every machine, so that none is named"""


class Kept:
    """Rows of earlier calls, in a file to which each new one is added as it comes."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._rows: dict[tuple[str, str], Any] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                part, case, row = json.loads(line)
                self._rows[part, case] = row

    def rows(self, part: Part[Case, Row], cases: Iterable[Case]) -> dict[int, Row]:
        """The rows that are there, by the number of the case."""
        kind = _kind(part)
        found = {}
        for number, case in enumerate(cases):
            if (key := (part.name, repr(case))) in self._rows:
                found[number] = kind.validate_python(self._rows[key])
        return found

    def add(self, part: Part[Case, Row], case: Case, row: Row) -> None:
        """Add a row; without a file nothing happens."""
        if self._path is not None:
            line = [part.name, repr(case), _kind(part).dump_python(row, mode="json")]
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")


def _kind(part: Part[Any, Row]) -> TypeAdapter[Row]:
    return TypeAdapter(get_type_hints(part.row)["return"])


def begun(
    part: Part[Case, Row], given: Given, kept: Kept, pool: Executor | None
) -> Callable[[], list[tuple[Case, Row]]]:
    """Give a part's cases to a pool; return a function that waits for every row."""
    cases = list(part.cases(given))
    rows = kept.rows(part, cases)
    missing = [number for number in range(len(cases)) if number not in rows]
    side_by_side = None if part.in_turn else pool
    workers = 1 if side_by_side is None else cores()
    _say(f"{part.name}: this takes about {length(len(missing) * part.case_s / workers)}")
    asked: dict[Future[Row], int] = {}
    if side_by_side is not None:
        asked = {side_by_side.submit(part.row, cases[number]): number for number in missing}

    def made() -> Iterator[tuple[int, Row]]:
        if side_by_side is None:
            yield from ((number, part.row(cases[number])) for number in missing)
        else:
            yield from ((asked[done], done.result()) for done in as_completed(asked))

    def wait() -> list[tuple[Case, Row]]:
        told = 0.0
        for number, row in made():
            kept.add(part, cases[number], row)
            rows[number] = row
            if time.monotonic() - told >= 1.0 or len(rows) == len(cases):
                told = time.monotonic()
                _say(f"{part.name} {len(rows)}/{len(cases)}: {cases[number]}: {row}")
        return [(case, rows[number]) for number, case in enumerate(cases)]

    return wait


def found(part: Part[Case, Row], given: Given) -> list[tuple[Case, Row]]:
    """Return every case of a part with its row, computed in this process."""
    return begun(part, given, Kept(None), None)()


def table(*rows: Sequence[object]) -> list[str]:
    """A table as a page wants it; the first row is its head."""
    lines = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
    return [f"|{'|'.join(map(str, line))}|" for line in lines]


def table_of(head: str) -> Callable[[Found[Any, list[str]]], list[str]]:
    """Text of a part whose rows are the cells of a table's rows; ``|`` parts the head's cells."""
    return lambda found: table(head.split("|"), *(row for _, row in found))


def renewed(page: str, parts: dict[str, Iterable[str]], commit: str = "") -> str:
    """The page with some of its parts made anew, by the code of a commit where it is known.

    Raises:
        NoPlaceError: The page has no place for one of them.
    """
    lacking = parts.keys() - {mark[2] for mark in PART.finditer(page)}
    if lacking:
        names = ", ".join(sorted(lacking))
        raise NoPlaceError(
            f"the page has no place for {names}: add the lines <!-- computed: NAME --> and"
            " <!-- end -->"
        )

    def part(mark: re.Match[str]) -> str:
        _, name, _, end = mark.groups()
        if name not in parts:
            return mark[0]
        at = f" at {commit}" if commit else ""
        new = "".join(f"{line}\n" for line in parts[name])
        return f"<!-- computed: {name}{at} -->\n{new}{end}"

    return PART.sub(part, page)


def this_machine() -> str:
    """Name the machine, as a page does."""
    here = machine()
    return (
        f"{here['cores']} cores of {here['processor']}, {here['system']}, Python"
        f" {versions()['python']}"
    )


def length(seconds: float) -> str:
    """A duration in words."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def _say(text: str) -> None:
    print(text[:200], file=sys.stderr, flush=True)


def usual(study: Study, *, quick: bool = False, **others: object) -> Given:
    """The default options of a study, but for some."""
    values = {
        each.name: each.quick if quick and each.quick is not None else each.usual
        for each in study.options
    }
    return Given(**{"quick": quick} | values | others)


def _parser(study: Study, name: str, doc: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"scripts/study {name}", description=doc.splitlines()[0])
    for each in study.options:
        flag = f"--{each.name.replace('_', '-')}"
        if isinstance(each.usual, bool):
            parser.add_argument(flag, action="store_true", default=None, help=each.help)
            continue
        many = isinstance(each.usual, tuple)
        kind = type(each.usual[0] if many else each.usual)
        default = " ".join(map(str, each.usual)) if many else str(each.usual)
        about = f"{each.help} (default: {default})" if default else each.help
        parser.add_argument(
            flag, type=kind, nargs="+" if many else None, choices=each.choices, help=about
        )
    if any(each.quick is not None for each in study.options):
        parser.add_argument("--quick", action="store_true", help="small amounts, to try the study")
    names = [part.name for part in study.parts]
    if len(names) > 1:
        parser.add_argument(
            "--only",
            nargs="+",
            choices=names,
            metavar="PART",
            help=f"compute only these: {', '.join(names)}",
        )
    parser.add_argument(
        "--rows",
        type=Path,
        metavar="FILE",
        help="store each row when it is computed; a later call continues with these",
    )
    parser.add_argument(
        "--workers", type=int, default=cores(), help="parallel processes (default: one per core)"
    )
    page = ROOT / "docs" / study.page
    about = f"page to write (default: docs/{study.page})"
    parser.add_argument("--out", type=Path, default=page, metavar="FILE", help=about)
    return parser


def run(study: Study, name: str, doc: str, arguments: Sequence[str]) -> int:
    """Make a study's parts, and write its page; 1 where something that is wanted does not hold."""
    parser = _parser(study, name, doc)
    options = parser.parse_args(arguments)
    chosen = {key: value for key, value in vars(options).items() if value is not None}
    given = usual(study, quick=getattr(options, "quick", False))
    given = Given(**vars(given) | chosen)
    command = _command(study, name, options)
    parts = [part for part in study.parts if part.name in (chosen.get("only") or part.name)]
    source = options.out if options.out.exists() else ROOT / "docs" / study.page
    if not source.exists():
        raise NoPlaceError(
            f"docs/{study.page} does not exist: write it first, with a place for each part"
        )
    text, holds = source.read_text(encoding="utf-8"), True
    renewed(text, dict.fromkeys((part.name for part in parts), ()))  # before the work
    kept, began = Kept(options.rows), time.monotonic()
    with contextlib.ExitStack() as stack:
        pool: Executor | None = None
        if any(not part.in_turn for part in parts):
            with not_from_the_terminal():
                pool = stack.enter_context(processes(options.workers))
        # What is measured in real time comes last, when nothing else computes.
        waits = [(part, begun(part, given, kept, pool)) for part in parts if not part.in_turn]
        turns = ((part, begun(part, given, kept, None)) for part in parts if part.in_turn)
        for part, wait in itertools.chain(waits, turns):
            rows = wait()
            took = length(time.monotonic() - began)
            lines = [f"By `{command}`, {took} on {this_machine()}.", ""]
            made = [*([] if study.everywhere else lines), *part.lines(rows)]
            holds = part.wanted(rows) and holds
            text = renewed(text, {part.name: made}, git("rev-parse", "--short=8", "HEAD"))
            options.out.write_text(text, encoding="utf-8")
            print("\n".join(made), flush=True)
    return 0 if holds else 1


def _command(study: Study, name: str, options: Given) -> str:
    words = ["scripts/study", name, *(["--quick"] if getattr(options, "quick", False) else [])]
    for each in study.options:
        value = getattr(options, each.name)
        if value is not None and value != each.usual:
            values = value if isinstance(value, (list, tuple)) else [value]
            words += [f"--{each.name.replace('_', '-')}", *map(str, values)]
    return " ".join(word for word in words if word != "True")


def listed() -> Iterator[tuple[str, str]]:
    """Names of the studies and of what else can be started, and the first lines of their texts."""
    for place in ("scripts/studies", "scripts"):
        for path in sorted((ROOT / place).glob("*.py")):
            text = path.read_text(encoding="utf-8")
            if re.search(r"^(STUDY = |def main\()", text, re.M) and path.name != "study.py":
                yield path.stem, text.partition('"""')[2].partition("\n")[0]


def git(*words: str) -> str:
    """Return what git says; empty: there is no repository, or no such commit."""
    said = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return said.stdout.strip() if said.returncode == 0 else ""


def older() -> Iterator[str]:
    """Name the parts of pages that older code computed, and how many changes of it came since."""
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for mark in PART.finditer(page.read_text(encoding="utf-8")):
            at = re.search(r" at (\w+) ", mark[1])
            since = at and git("rev-list", "--count", f"{at[1]}..HEAD", "--", *ROOMS)
            if since != "0":
                where = f"{page.relative_to(ROOT)}, {mark[2]}"
                yield f"{where}: {since} commits" if since else f"{where}: of an unknown commit"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study that is named, or list them."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    there = dict(listed())
    if not words or words[0] in ("-h", "--help"):
        width = max(map(len, there))
        print(*(f"{name:{width}}  {line}" for name, line in there.items()), sep="\n")
        if parts := list(older()):
            print(f"\nOlder than {' and '.join(ROOMS)}:", *parts, sep="\n")
        return 0
    name, *rest = words
    if name not in there:
        _say(f"scripts/study: found no study {name}; `scripts/study` lists all")
        return 2
    place = "scripts.studies" if (ROOT / "scripts/studies" / f"{name}.py").exists() else "scripts"
    module = importlib.import_module(f"{place}.{name}")
    if hasattr(module, "STUDY"):
        try:
            return run(module.STUDY, name, module.__doc__ or "", rest)
        except NoPlaceError as error:
            _say(f"scripts/study {name}: {error}")
            return 2
        except HapticWallError as error:
            _say(f"scripts/study {name}: {error}")
            return error.exit_status
    sys.argv = [f"scripts/study {name}", *rest]
    return module.main() or 0


if __name__ == "__main__":
    sys.exit(main())
