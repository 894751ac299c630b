"""The options of scripts whose pages have sections that are measured one by one."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from scripts.trials.sections import QUICK, Amount, Made, renewed


def add_options(parser: argparse.ArgumentParser, names: Sequence[str]) -> None:
    """Add what says which sections are made, and from how much."""
    usual = Amount()
    parser.add_argument(
        "--only", nargs="+", choices=names, metavar="SECTION", help=f"of {', '.join(names)}"
    )
    parser.add_argument(
        "--hours", type=float, default=usual.hours, help="of each operator and servo"
    )
    parser.add_argument(
        "--walls", type=int, default=usual.walls, help="in each row with a believed lag"
    )
    parser.add_argument(
        "--generations", type=int, default=usual.generations, help="of each worst-case search"
    )
    parser.add_argument(
        "--examples", type=Path, metavar="FILE", help="where counter-examples are written"
    )


def amount_of(given: argparse.Namespace) -> Amount:
    """How much is tried."""
    if given.quick:
        return replace(QUICK, seed=given.seed)
    return Amount(given.seed, given.walls, given.hours, generations=given.generations)


def command_of(script: str, given: argparse.Namespace) -> str:
    """The command that makes the same figures again."""
    if given.quick:
        return f"scripts/study {script} --quick --seed {given.seed}"
    usual, words = Amount(), [f"scripts/study {script}", f"--seed {given.seed}"]
    for name in ("walls", "hours", "generations"):
        if getattr(given, name) != getattr(usual, name):
            words.append(f"--{name} {getattr(given, name):g}")
    return " ".join(words)


def write(
    given: argparse.Namespace, head: str | None, order: Sequence[str], made: dict[str, Made]
) -> None:
    """Write the page, and the counter-examples where they are wanted.

    Args:
        given: The options.
        head: What is above the sections; None: as it is on the page.
        order: Names of all sections.
        made: Those that were measured.
    """
    page = given.out.read_text(encoding="utf-8") if given.out.exists() else ""
    given.out.write_text(renewed(page, head, order, made), encoding="utf-8")
    if given.examples is not None:
        lines = [
            f"# {name}: {what}\n{case!r}\n"
            for name, one in made.items()
            for what, case in one.wrong
        ]
        given.examples.write_text("".join(lines), encoding="utf-8")
