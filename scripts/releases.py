"""Compares releases by ratios that were measured at each of them: docs/evidence/releases.md.

    scripts/study releases                      make the page from docs/evidence/releases/
    scripts/study releases --measure            add an entry for this commit, and make the page
    scripts/study releases --measure --tests    run all tests too, for their time

An entry is one JSON file with the version, the commit, the machine, and figures with the quartiles
of their rounds.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from haptic_wall import __version__
from haptic_wall.controller.bench import words
from haptic_wall.controller.bench.machine import load_average, versions
from scripts.release_figures import BENCH, Figure, kept, own_figures, suite_figures
from scripts.study import this_machine
from scripts.whole_program import PROGRAM, ROOT

FOLDER, PAGE = ROOT / "docs" / "evidence" / "releases", ROOT / "docs" / "evidence" / "releases.md"
PART = re.compile(r"(<!-- releases -->\n)(.*?)(<!-- end -->)", re.S)
ROUNDS = 5
NOTABLE = 1.1
"""Factor by which a figure must be worse, with quartiles apart, to be called so"""
SHOWN = 6
"""Entries on the page, the newest ones"""


@dataclass(frozen=True, slots=True)
class Entry:
    """What was measured at one commit."""

    version: str
    commit: str
    committed: str
    """Date and time of the commit"""
    machine: str
    load: float | None
    """Processes that ran or waited when it began; what is measured alone has below 0.5"""
    rounds: int
    packages: str
    figures: dict[str, Figure]

    @property
    def name(self) -> str:
        """Return the version, and the commit's date and number."""
        return f"{self.version}, {self.committed[:10]}, {self.commit}"


def read(path: Path) -> Entry:
    """Return an entry from its file.

    Raises:
        ValueError: The file is not an entry.
    """
    try:
        told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        figures = {name: Figure(**each) for name, each in told.pop("figures").items()}
        return Entry(**told, figures=figures)
    except (TypeError, KeyError, AttributeError, ValueError) as error:
        raise ValueError(
            f"{path}: found no entry of a release ({error}); wanted what scripts/study releases"
            " --measure writes: remove the file, or measure again"
        ) from error


def entries(folder: Path) -> list[Entry]:
    """Return all entries, the oldest commit first."""
    found = [read(path) for path in folder.glob("*.json")]
    return sorted(found, key=lambda one: (one.committed, one.commit))


def worse(now: Figure, before: Figure) -> bool:
    """Whether a figure is notably worse than it was, and the rounds of both lie apart."""
    if now.less_is_better is None or min(now.value, before.value) <= 0.0:
        return False
    factor = now.value / before.value
    if not now.less_is_better:
        factor = 1.0 / factor
    if factor < NOTABLE:
        return False
    ends = (now.low, now.high, before.low, before.high)
    if any(end is None for end in ends):
        return True
    low, high, low_before, high_before = (end or 0.0 for end in ends)
    return low > high_before if now.less_is_better else high < low_before


def page_lines(found: Sequence[Entry]) -> list[str]:
    """Return the table of the newest entries, and what became worse."""
    shown = found[-SHOWN:]
    titles = {key: figure.title for one in shown for key, figure in one.figures.items()}
    head = ["figure", "better", *(one.name for one in shown)]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for key, title in titles.items():
        cells = [_cell(shown, i, key) for i in range(len(shown))]
        less = next(one.figures[key].less_is_better for one in shown if key in one.figures)
        wanted = "" if less is None else "less" if less else "more"
        lines.append(f"| {title} | {wanted} | {' | '.join(cells)} |")
    lines.append("")
    for one in shown:
        load = "" if one.load is None else f", load {one.load:g} when it began"
        lines.append(f"- {one.name}: {one.machine}; {one.packages}; {one.rounds} rounds{load}")
    return lines


def _cell(shown: Sequence[Entry], i: int, key: str) -> str:
    figure = shown[i].figures.get(key)
    if figure is None:
        return ""
    text = words.figure(figure.value)
    if figure.low is not None and figure.high is not None:
        text += f" ({words.figure(figure.low)} to {words.figure(figure.high)})"
    before = next((one.figures[key] for one in shown[:i][::-1] if key in one.figures), None)
    return f"**worse:** {text}" if before is not None and worse(figure, before) else text


def renewed(text: str, lines: Sequence[str]) -> str:
    """Return the page with its part made anew."""
    body = "\n".join(["", *lines, "", ""])
    return PART.sub(lambda part: part[1] + body + part[3], text)


def measured(*, tests: bool) -> Entry:
    """Measure everything at the present commit."""
    loads = load_average()
    figures = suite_figures(run=tests, say=_say) | own_figures(ROUNDS, _say)
    for section in BENCH:
        _say(f"haptic-wall bench --section {section}")
        done = subprocess.run(
            [*PROGRAM, "bench", "--json", "--section", section],
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        if done.returncode:
            sys.exit(f"haptic-wall bench --section {section} ended with {done.returncode}")
        figures |= kept(json.loads(done.stdout)["sections"][section]["rows"], section)
    there = versions()
    packages = ", ".join(f"{name} {there[name] or 'missing'}" for name in ("numpy", "numba"))
    return Entry(
        __version__,
        _git("rev-parse", "--short=8", "HEAD"),
        _git("show", "-s", "--format=%cd", "--date=format:%Y-%m-%dT%H:%M", "HEAD"),
        this_machine(),
        loads[0] if loads else None,
        ROUNDS,
        packages,
        figures,
    )


def _git(*words_: str) -> str:
    done = subprocess.run(["git", *words_], check=False, capture_output=True, text=True, cwd=ROOT)
    if done.returncode:
        sys.exit(f"git {' '.join(words_)}: {done.stderr.strip()}; run this in a clone")
    return done.stdout.strip()


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    """Make the page, and before that an entry where it is wanted."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--measure", action="store_true", help="add an entry for this commit")
    parser.add_argument("--tests", action="store_true", help="with --measure: time scripts/test")
    parser.add_argument("--entries", type=Path, default=FOLDER, metavar="FOLDER", help="entries")
    parser.add_argument("--out", type=Path, default=PAGE, metavar="FILE", help="the page")
    wanted = parser.parse_args()
    if wanted.tests and not wanted.measure:
        parser.error("--tests: only with --measure")
    if wanted.measure:
        entry = measured(tests=wanted.tests)
        wanted.entries.mkdir(exist_ok=True)
        file = wanted.entries / f"{entry.version}-{entry.committed[:10]}-{entry.commit}.json"
        file.write_text(json.dumps(asdict(entry), indent=1) + "\n", encoding="utf-8")
    try:
        text = wanted.out.read_text(encoding="utf-8")
        lines = page_lines(entries(wanted.entries))
    except (OSError, ValueError) as error:
        sys.exit(f"scripts/study releases: {error}")
    wanted.out.write_text(renewed(text, lines), encoding="utf-8")


if __name__ == "__main__":
    main()
