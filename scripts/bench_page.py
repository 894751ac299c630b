"""Renews the figures of docs/evidence/bench.md by ``haptic-wall bench`` on this machine.

    scripts/study bench_page [--report FILE] [--out FILE]

A part of the page begins with ``<!-- bench: machine -->`` or ``<!-- bench: SECTION -->`` and ends
with ``<!-- end -->``. Peers that are not installed are named there: .venv/bin/pip install -e
'.[bench]' and the package rt-tests add them. FILE is what ``haptic-wall bench --json`` printed;
without it everything is measured now, on a machine that does nothing else.
"""

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from haptic_wall.controller.bench import words
from haptic_wall.controller.cli.bench import SECTIONS
from scripts.whole_program import PROGRAM, ROOT

PART = re.compile(r"(<!-- bench: (\S+) -->\n)(.*?)(<!-- end -->)", re.S)


def renewed(text: str, report: Mapping[str, Any]) -> str:
    """Return the page with the measured parts renewed; the other parts stay.

    A note on other load of the machine stands at the head of the page for a whole run, else beside
    each part.

    Args:
        text: The page.
        report: Output of ``haptic-wall bench --json``.
    """
    whole = set(SECTIONS) <= report["sections"].keys()
    apart = "" if whole else f"Measured apart from the rest: {words.meanwhile(report)}. "

    def part(found: re.Match[str]) -> str:
        begin, name, old, end = found.groups()
        if name == "machine":
            body = on_machine(report) if whole else old
        elif name in report["sections"]:
            body = figures(report["sections"][name], apart)
        else:
            body = old
        return f"{begin}{body}{end}"

    return PART.sub(part, text)


def on_machine(report: Mapping[str, Any]) -> str:
    """List the machine that the figures were measured on."""
    lines = [words.hardware(report), words.installed(report), words.meanwhile(report)]
    return "\n".join(["", *(f"- {line}" for line in (*lines, *words.rights(report))), "", ""])


def figures(section: Mapping[str, Any], apart: str = "") -> str:
    """The table of a section, and its notes; ``apart`` says if it is of another run."""
    took = f"{apart}{section['seconds']:.0f} s, {words.stolen(section['steal_percent'])}."
    table = ["| what | figure | unit | quartiles of the rounds |", "|---|---|---|---|"]
    for row in section["rows"]:
        cells = (row["name"], words.figure(row["value"]), words.unit(row), words.quartiles(row))
        table.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    notes = [f"- {note}" for note in section["notes"]]
    return "\n".join(["", took, "", *table, "", *notes, *([""] if notes else []), ""])


def main() -> None:
    """Measure, or take what was measured, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    page = ROOT / "docs" / "evidence" / "bench.md"
    parser.add_argument("--out", type=Path, default=page, metavar="FILE", help="the page")
    parser.add_argument("--report", type=Path, metavar="FILE", help="take the figures from it")
    wanted = parser.parse_args()
    try:
        text = wanted.out.read_text(encoding="utf-8")
    except OSError as error:
        sys.exit(
            f"--out {wanted.out}: wanted a page to renew, a copy of docs/evidence/bench.md: {error}"
        )
    missing = [name for name in SECTIONS if f"<!-- bench: {name} -->" not in text]
    if missing:
        sys.exit(f"{wanted.out} has no part for {', '.join(missing)}: add its two comments")
    if wanted.report is None:
        done = subprocess.run(
            [*PROGRAM, "bench", "--json"], check=False, stdout=subprocess.PIPE, text=True
        )
        if done.returncode:
            sys.exit(f"haptic-wall bench ended with {done.returncode}; the page stays as it is")
        told = done.stdout
    else:
        try:
            told = wanted.report.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            sys.exit(f"--report {wanted.report}: cannot be read: {error}")
    try:
        report = json.loads(told)
    except ValueError:
        report = None
    if not isinstance(report, dict) or not {"machine", "versions", "sections"} <= report.keys():
        sys.exit(f"--report {wanted.report}: wanted the output of `haptic-wall bench --json`")
    wanted.out.write_text(renewed(text, report), encoding="utf-8")


if __name__ == "__main__":
    main()
