"""Regenerates the program's output in README.md and docs/, between their markers.

    scripts/study readme_output             write anew what is the same on every machine
    scripts/study readme_output --measure   and what this machine measures, the tests' result too
    scripts/study readme_output --check     compare what is the same everywhere; write nothing

A part begins with one of these comments and ends with ``<!-- end -->``:

    output: COMMAND | LABELS     the command and what it says, the same on every machine
    measured: COMMAND | LABELS   the same of this machine: times differ, so it is never compared
    table: NAME                  computed by the program; see TABLES

Without COMMAND it is that of the part's ``sh`` block. LABELS, where given, name the lines to show;
log and picture are shown only of measured runs, as their names hold the date.
"""

import argparse
import ast
import contextlib
import csv
import inspect
import io
import itertools
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from haptic_wall.controller.cli.main import COMMANDS
from haptic_wall.controller.cli.main import main as haptic_wall
from haptic_wall.controller.errors import EXIT_STATUSES
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.limits import LIMITS as GUARD_LIMITS
from haptic_wall.controller.guard.types import Decision, Situation
from haptic_wall.controller.runtime.safety import EXPLANATIONS, Trip
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping, one_sided_limit
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_bus
from scripts.whole_program import PROGRAM, emulated_bus
from tests.support.report_keys import REPORT_KEYS

ROOT = Path(__file__).resolve().parent.parent
PART = re.compile(r"(<!-- (output|measured|table): (.*?) -->\n)(.*?)(<!-- end -->)", re.S)
LIMITS = ("linear", "exact", "one_sided", "quantisation")
HORN = 0.1
"""Length of the horn that forces are told for [m]"""
PUBLISHED = ROOT / "docs" / "examples" / "published-friction.csv"
"""Fits of real servos"""
WIDE = {
    r"^-1(e\+12|000000) to 1(e\+12|000000)": "any",
    r"^0 to 1(e\+\d+|000000)": "≥ 0",
    r"^above 0 and at most 1(e\+\d+|000000)": "> 0",
    " or null": ", null",
}
"""How wide ranges are shown"""
WHOLE_DELAYS = (0, 1, 2, 5)
"""Delays of the table of one-sided limits [periods]"""


def pages() -> list[Path]:
    """The pages that hold parts."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def renewed(page: Path, measure: bool) -> str:
    """The text of a page with its parts made anew; measurements only on request."""

    def part(found: re.Match[str]) -> str:
        begin, kind, what, old, end = found.groups()
        subject, _, chosen = (text.strip() for text in what.partition("|"))
        if not subject and (block := re.search(r"```sh\n(.*)\n", old)):
            subject = block[1]
        if kind == "table":
            body = table(*TABLES[subject]())
        elif kind == "output":
            body = shown(subject, kept(said(subject), chosen))
        else:
            body = shown(subject, kept(measured(subject), chosen)) if measure else old
        return f"{begin}{body}{end}"

    return PART.sub(part, page.read_text())


def shown(command: str, text: str) -> str:
    """A command and what it said, as two blocks."""
    lines = "\n".join(line.rstrip() for line in text.strip().splitlines())
    return f"```sh\n{command}\n```\n```text\n{lines}\n```\n"


def kept(text: str, chosen: str) -> str:
    """The lines under the labels chosen, or all."""
    if not chosen:
        return text
    wanted, keep = set(chosen.split(", ")), False
    lines = []
    for line in text.splitlines():
        check = re.match(r"(?:ok|WRONG|-) +(\S.*?)  ", line)  # of doctor
        label = check[1] if check else line[:12].strip()
        keep = label in wanted if label else keep
        if keep:
            lines.append(line)
    return "\n".join(lines)


def said(command: str) -> str:
    """Run a command whose output is the same on every machine, and return the output."""
    words = shlex.split(command)[1:]
    with tempfile.TemporaryDirectory() as folder:
        if words[0] == "run":
            words += ["--log", f"{folder}/run.hwlog", "--plot", f"{folder}/run.png"]
        out, err = io.StringIO(), io.StringIO()
        told = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
        with told[0], told[1], contextlib.suppress(SystemExit):
            haptic_wall(words)
    lines = (out.getvalue() or err.getvalue()).splitlines()
    return "\n".join(line for line in lines if not line.startswith(("log  ", "picture  ")))


def measured(command: str) -> str:
    """Run a command and return its output on this machine; a run's picture goes to docs/."""
    with tempfile.TemporaryDirectory() as folder:
        if command.startswith("haptic-wall"):
            return beside_an_emulated_bus(command, folder)
        if command == "scripts/test":
            tests = [str(ROOT / command)]
            return last_lines(
                subprocess.run(tests, capture_output=True, text=True, check=True).stdout
            )
        words = shlex.split(command)
        words[0] = str(ROOT / words[0])
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=True)
        (picture,) = Path(folder, "runs").glob("*.png")
        shutil.copy(picture, ROOT / "docs" / "pictures" / "run.png")
        return done.stdout


def last_lines(text: str) -> str:
    """One line of each check that scripts/test makes."""
    lines = [line for line in text.splitlines() if line.strip()]
    passed = [line.strip("= ") for line in lines if re.match(r"=* ?\d+ passed", line)]
    return "\n".join([*lines[:2], *passed, lines[-1]])


def beside_an_emulated_bus(command: str, folder: str) -> str:
    """Return the output of a run beside an emulated bus at its port, pushed by a hand."""
    words = [*PROGRAM, *shlex.split(command)[1:]]
    link = str(load_config("emulated-port").config.servo.port)
    with emulated_bus("--link", link, "--set", "servo.hand=push"):
        done = subprocess.run(
            words,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode not in (0, 1):  # doctor found something wrong
        raise RuntimeError(done.stderr)
    return done.stdout


# Tables


def table(head: list[str], rows: list[list[object]]) -> str:
    """A Markdown table; numbers in four digits, what does not apply as a dash."""

    def cell(value: object) -> str:
        if value is None:
            return "–"
        return f"{value:.4g}" if isinstance(value, float) else str(value)

    lines = [head, ["---"] * len(head), *([cell(value) for value in row] for row in rows)]
    return "\n".join(["", *(f"|{'|'.join(line)}|" for line in lines), "", ""])


def situation(config: Config) -> Situation:
    """Situation that the guard decides in; for a real servo that of an emulated one."""
    preset = "emulated-ideal" if config.servo.kind == "hardware" else ""
    seen = load_config(preset).config if preset else config
    (facts,) = open_bus(
        seen.model_copy(
            update={"loop": seen.loop.model_copy(update={"clock": "simulated"})}
        ).servos(),
        SimulatedClock(),
    ).facts
    return Situation(
        belief=config.belief(),
        period=config.period_s,
        torque_limit=facts.torque_limit,
        position_step=2 * math.pi / facts.counts_per_rev,
    )


def decided(preset: str, ages: list[float], **asked: float) -> list[Decision]:
    """Decisions of the guard on a preset's wall, for sample ages [s], with changes."""
    config = load_config(preset).config
    changes: dict[str, Any] = dict(asked)
    request = replace(config.request(), **changes)
    return decide(request, config.guard_settings(), situation(config), ages)


def stiffness() -> tuple[list[str], list[list[object]]]:
    """Table of stiffnesses: the force in the hand, and the commanded stiffness."""
    head = ["K [N·m/rad]", "torque per degree [N·m]", "at the tip of a 10 cm horn [N/mm]"]
    head += ["K commanded, `simulated`", "K commanded, `xm430-w350`"]
    rows: list[list[object]] = []
    for asked in (1.0, 8.0, 40.0, 400.0):
        commanded = [
            decided(preset, [2e-4], stiffness=asked)[0].stiffness
            for preset in ("simulated", "xm430-w350")
        ]
        rows.append([asked, math.radians(asked), asked / HORN**2 * 1e-3, *commanded])
    return head, rows


def dampings() -> tuple[list[str], list[list[object]]]:
    """The limits over the virtual damping."""
    rows: list[list[object]] = []
    for asked in (-0.005, 0.02, 0.1, 0.2, 20.0):
        d = decided("emulated-ideal", [0.25e-3], stiffness=1e6, damping=asked)[0]
        rows.append([asked, d.damping, *(d.limits[name] for name in LIMITS)])
        rows[-1] += [d.stiffness, d.binding]
    return ["B asked", "B commanded", *LIMITS, "K commanded", "binds"], rows


def limits() -> tuple[list[str], list[list[object]]]:
    """Return the guard's limits, with their meaning and source."""
    rows: list[list[object]] = [[each.name, each.meaning, each.source] for each in GUARD_LIMITS]
    return ["limit", "meaning", "source"], rows


def one_sided_shares() -> tuple[list[str], list[list[object]]]:
    """Return the table of one-sided limits of a device without friction, over the exact limit."""
    rows: list[list[object]] = []
    for of_ceiling in (0.1, 0.3, 0.5, 0.7):
        ratios = []
        for delay in map(float, WHOLE_DELAYS):
            virtual = of_ceiling * float(max_virtual_damping(1.0, 0.0, 1.0, delay))
            exact = float(critical_stiffness(1.0, 0.0, virtual, 1.0, delay))
            limit = float(one_sided_limit(1.0, 0.0, virtual, 1.0, delay))
            ratios.append(f"{limit / exact:.2f}")
        rows.append([of_ceiling, *ratios])
    return ["B / ceiling", *(f"d = {d}" for d in WHOLE_DELAYS)], rows


def published() -> tuple[list[str], list[list[object]]]:
    """Return the ranges of the published fits of each servo."""
    columns = ("inertia_kgm2", "viscous_nms_per_rad", "coulomb_nm", "excess_at_rest_nm")
    fits: dict[str, list[dict[str, str]]] = {}
    with PUBLISHED.open(encoding="utf-8", newline="") as file:
        for fit in csv.DictReader(file):
            fits.setdefault(fit["servo"].partition(",")[0], []).append(fit)
    rows: list[list[object]] = []
    for servo, found in fits.items():
        row: list[object] = [servo]
        for column in columns:
            values = [float(fit[column]) for fit in found if fit[column]]
            row.append(f"{min(values):g} to {max(values):g}")
        rows.append(row)
    head = ["inertia [kg·m²]", "viscous [N·m·s/rad]", "Coulomb [N·m]", "excess [N·m]"]
    return ["servo", *head], rows


def commands() -> tuple[list[str], list[list[object]]]:
    """Return the commands with their lines in the help."""
    rows: list[list[object]] = [[f"`{name}`", line.rstrip(".")] for name, line in COMMANDS.items()]
    return ["command", "does"], rows


def settings() -> tuple[list[str], list[list[object]]]:
    """Return every setting with its values and the beginning of its meaning."""
    rows: list[list[object]] = []
    for path, field in fields().items():
        values = re.sub(r"^(a number|a whole number|one of)( from)? |, or {.*}", "", field.wanted)
        for wide, short in WIDE.items():
            values = re.sub(wide, short, values)
        values = re.sub(r"([\d.+e-]+) to ", r"\1…", values)
        meaning = field.meaning.partition(". ")[0]
        told = tuple(f"{of}{name}:" for name in field.choices for of in ("", "Of wall: "))
        if not meaning.startswith(told):
            ends = "[;(]" if meaning.startswith("Of ") else "[;:(]|, e.g"
            meaning = re.split(ends, meaning)[0].rstrip()
        rows.append([f"`{path}`", f"{values} {field.unit}".rstrip(), meaning])
    return ["setting", "values", "meaning"], rows


def exit_statuses() -> tuple[list[str], list[list[object]]]:
    """Return the exit statuses of the commands."""
    return ["status", "meaning"], [[status, text] for status, text in EXIT_STATUSES.items()]


def report_keys() -> tuple[list[str], list[list[object]]]:
    """Return the keys of a run's report."""
    return ["key", "meaning"], [[f"`{key}`", text] for key, text in REPORT_KEYS.items()]


def trips() -> tuple[list[str], list[list[object]]]:
    """Return the trips, with the remedies that an explanation names."""
    meanings = documented(Trip)
    rows: list[list[object]] = [
        [f"`{trip.label}`", meanings[trip.name].rstrip("."), EXPLANATIONS[trip].advice or None]
        for trip in Trip
    ]
    return ["trip", "meaning", "remedy"], rows


def documented(kind: type) -> dict[str, str]:
    """Return the docstring below each member of a class."""
    (of,) = ast.parse(inspect.getsource(kind)).body
    assert isinstance(of, ast.ClassDef)
    return {
        member.targets[0].id: inspect.cleandoc(doc.value.value)
        .replace("\n", " ")
        .replace("``", "`")
        for member, doc in itertools.pairwise(of.body)
        if isinstance(member, ast.Assign)
        and isinstance(member.targets[0], ast.Name)
        and isinstance(doc, ast.Expr)
        and isinstance(doc.value, ast.Constant)
        and isinstance(doc.value.value, str)
    }


TABLES = {
    "commands": commands,
    "exit_statuses": exit_statuses,
    "report_keys": report_keys,
    "trips": trips,
    "settings": settings,
    "limits": limits,
    "stiffness": stiffness,
    "dampings": dampings,
    "one_sided_shares": one_sided_shares,
    "published": published,
}


def main() -> int:
    """Write the parts, or say which are out of date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="only compare; 1 if a part differs")
    parser.add_argument("--measure", action="store_true", help="repeat the measurements")
    wanted = parser.parse_args()
    check, status = wanted.check, 0
    for page in pages():
        text = renewed(page, measure=wanted.measure and not check)
        if text == page.read_text():
            continue
        status = 1 if check else 0
        print(f"{page.relative_to(ROOT)} {'is out of date' if check else 'is written anew'}")
        if not check:
            page.write_text(text)
    if status:
        print("run scripts/study readme_output to bring them up to date", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
