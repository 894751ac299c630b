"""Measures how well `haptic-wall sweep` measures, and writes docs/sweep-check.md.

    scripts/sweep_check [--quick] [--only PART] [--seed N] [--out FILE]

Against the exact boundary of a linear servo, against the onset amplitude that friction's theory
gives, and on an emulated bus in real time against the boundary at the delay that the bus itself
witnessed. The picture of the timed sweep goes beside the page.
"""

import os
import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from haptic_wall.controller.bench.loops import FORGIVING
from haptic_wall.controller.experiments.sweep.critical import PointSearch
from haptic_wall.controller.experiments.sweep.plan import Options, Setting
from haptic_wall.controller.experiments.sweep.result import PointResult
from haptic_wall.controller.experiments.sweep.sweep import experiment_config
from haptic_wall.controller.experiments.testbed import Testbed
from haptic_wall.controller.logs.file import read_log
from haptic_wall.controller.pytest_plugin.record import read_rows
from haptic_wall.controller.runtime.telemetry import FLAG_WARM_UP
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.hw.dynamixel.codec import Instruction
from scripts.whole_program import PROGRAM, measured_on, page_options, say_time

PERIOD = 1e-3
SERVOS = {
    "MX-64": (0.011951, 0.011692, 0.09039, 4.1),
    "MX-106": (0.026609, 0.035202, 0.10352, 8.4),
    "XL330-M288": (0.0018142, 0.0036617, 0.012833, 0.52),
    "XL-320": (0.0011190, 0.0033176, 0.027514, 0.39),
    "Table II": (1.0, 0.1, 0.0, 1e6),
}
"""Inertia, damping and Coulomb friction (Rhoban bam; the paper's plant), and a torque limit"""
LINEAR_LIMIT, FRICTION_LIMIT, BUS_LIMIT, GRID_LIMIT_S = 0.005, 0.05, 0.05, 60.0
KICKS = {"MX-64": (0.03, 0.06, 0.1), "XL330-M288": (0.02, 0.03, 0.04)}
WINDOW, QUIET = 100, 0.03
"""Periods over which a delay is averaged, and the share of them that may be lost or skipped"""
BUS_POINTS = ((0.02, 0), (0.02, 2), (0.1, 1))


@dataclass(frozen=True, slots=True)
class Case:
    """One point to measure on a simulated servo."""

    servo: str
    lag: float
    virtual_damping: float
    delay_steps: int
    kick: float | None
    friction: bool
    counts: int


def measured(case: Case) -> PointResult:
    """Measure one point on the simulated clock."""
    inertia, damping, coulomb, limit = SERVOS[case.servo]
    sets = (
        "loop.clock=simulated",
        "safety.max_speed=1e6",
        "servo.torque_step=0",
        f"servo.inertia={inertia}",
        f"servo.damping={damping}",
        f"servo.coulomb={coulomb if case.friction else 0.0}",
        f"servo.torque_limit={limit}",
        f"servo.counts_per_rev={case.counts}",
        f"servo.delay={case.lag}",
    )
    config = experiment_config(load_config("simulated", sets).config)
    with tempfile.TemporaryDirectory() as folder:
        bed = Testbed(config, Path(folder))
        setting = Setting(case.virtual_damping, case.delay_steps)
        return PointSearch(bed, setting, Options(kick=case.kick)).run()


def side_by_side(cases: list[Case]) -> Iterator[PointResult]:
    """All cases on two cores, in order."""
    with ProcessPoolExecutor(2) as pool:
        yield from pool.map(measured, cases)


def linear_cases(seed: int, count: int) -> list[Case]:
    """Servos without friction and encoder, delays with fractions, B up to 0.8 of the ceiling."""
    draw = random.Random(seed)
    cases = []
    for _ in range(count):
        name = draw.choice(list(SERVOS))
        inertia, damping, *_ = SERVOS[name]
        lag, steps = draw.uniform(0.0, 5e-3), draw.choice([0, 0, 1, 2, 3, 5])
        total = lag + steps * PERIOD
        ceiling = float(max_virtual_damping(inertia, damping, PERIOD, total))
        share = draw.choice([0.0, draw.uniform(0.0, 0.5), draw.uniform(0.0, 0.8)])
        cases.append(Case(name, lag, share * ceiling, steps, None, friction=False, counts=0))
    return cases


def friction_cases(quick: bool) -> list[Case]:
    """Three kicks at each servo, delay and damping; 4096 counts."""
    settings = ((0.02, 2), (0.0, 1)) if not quick else ((0.02, 2),)
    return [
        Case(name, 0.4e-3, share, steps, kick, friction=True, counts=4096)
        for name, kicks in KICKS.items()
        for share, steps in settings
        for kick in kicks
    ]


def linear_part(cases: list[Case]) -> tuple[list[str], bool]:
    """Against the exact boundary."""
    errors, sure = [], 0
    worst = None
    for case, point in zip(cases, side_by_side(cases), strict=True):
        error = np.inf if point.measured is None else abs(point.measured / point.exact - 1.0)
        errors.append(float(error))
        if worst is None or error >= max(errors):
            worst = case
        if point.measured is not None:
            sure += abs(point.measured - point.exact) <= 2.0 * point.uncertainty
        said(f"{case}: {point.measured} of {point.exact:.5g}, {100 * error:.3f} % {point.reason}")
    good = sum(error <= LINEAR_LIMIT for error in errors)
    return [
        "## A linear servo",
        "",
        f"{len(cases)} settings drawn at random: the servos above without friction and encoder,"
        " servo delays from 0 to 5 ms with fractions of a period, 0 to 5 periods inserted, virtual"
        " damping from 0 to 0.8 of its ceiling; kicks as the sweep chooses them.",
        "",
        f"- within {100 * LINEAR_LIMIT:g} % of the exact boundary: {good} of {len(cases)}",
        f"- error: median {100 * statistics.median(errors):.2g} %, largest"
        f" {100 * max(errors):.2g} % ({worst.servo}, B = {worst.virtual_damping:.3g},"
        f" {1e3 * worst.lag + worst.delay_steps:.2f} ms)",
        f"- boundary within two standard errors: {sure}. What is left is not scatter but the bend"
        " of growth over stiffness, in motions that are otherwise without noise",
        "",
    ], good == len(cases)


def friction_part(cases: list[Case]) -> tuple[list[str], bool]:
    """Against the stiffness whose onset amplitude is the kick."""
    rows, held = [], True
    for case, point in zip(cases, side_by_side(cases), strict=True):
        if point.measured is None:
            held = False
            rows.append([case.servo, case.virtual_damping, case.delay_steps, case.kick, "-", "-"])
            continue
        error = point.measured / point.predicted_with_friction - 1.0
        held = held and abs(error) <= FRICTION_LIMIT
        rows.append(
            [
                case.servo,
                f"{case.virtual_damping:g}",
                f"{1e3 * point.delay_s:.2f}",
                f"{point.kick_rad:g}",
                f"{point.measured:.2f} ± {point.uncertainty:.2f}",
                f"{point.predicted_with_friction:.2f}",
                f"{100 * error:+.2f} %",
                f"{point.exact:.2f}",
            ]
        )
        said(" ".join(map(str, rows[-1])))
    header = ["servo", "B", "delay, ms", "kick, rad", "measured", "A* predicts", "difference"]
    return [
        "## Friction and encoder",
        "",
        "The servos with their Coulomb friction and 4096 counts. A* predicts: the stiffness whose"
        " [onset amplitude](limit-cycles.md) is the kick.",
        "",
        *table([*header, "without friction"], rows),
        "",
        f"Wanted: within {100 * FRICTION_LIMIT:g} %. " + verdict(held),
        "",
    ], held


def bus_part(points: list[tuple[float, int]]) -> tuple[list[str], bool]:
    """On the emulated bus in real time, against its own record."""
    sets = ("servo.coulomb=0", *FORGIVING)
    config = experiment_config(load_config("emulated-xm430", sets).config)
    servo = config.servo
    rows, held = [], True
    for damping, steps in points:
        with tempfile.TemporaryDirectory() as folder:
            bed = Testbed(config, Path(folder), witness=True)
            point = PointSearch(bed, Setting(damping, steps), Options(), said).run()
            if point.measured is None:
                held = False
                rows.append([f"{damping:g}", str(steps), *["-"] * 5, point.reason])
                continue
            delays = [witnessed_delay(bed.folder / log, point.measured) for log in point.logs]
        parts = np.array([part for found in delays for part in found])
        delay = float(np.average(parts[:, 0], weights=parts[:, 1])) + servo.delay
        exact = float(
            critical_stiffness(servo.inertia, servo.damping, damping, config.period_s, delay)
        )
        error = point.measured / exact - 1.0
        held = held and abs(error) <= BUS_LIMIT
        rows.append(
            [
                f"{damping:g}",
                str(steps),
                f"{1e3 * delay:.3f}",
                f"{1e3 * point.delay_s:.3f}",
                f"{point.measured:.2f} ± {point.uncertainty:.2f}",
                f"{exact:.2f}",
                f"{100 * error:+.1f} %",
                point.reason or "",
            ]
        )
        said(" ".join(rows[-1]))
    header = ["B", "inserted", "true delay, ms", "reported, ms", "measured", "boundary there"]
    return [
        "## On the emulated bus, in real time",
        "",
        "`emulated-xm430` without friction, 4096 counts, through the serial driver at 1 kHz. The"
        " true delay is from the arrival of a sample's request at the servo to that of the torque"
        " made from it, averaged over the time each torque acted, both in the bus's own"
        " [record](emulated-bus.md), over the parts of the trials near the limit that were as"
        " little disturbed as what the sweep uses.",
        "",
        *table([*header, "difference", "remark"], rows),
        "",
        f"Wanted: within {100 * BUS_LIMIT:g} %. {verdict(held)} Meanwhile the machine had a load"
        f" of {os.getloadavg()[1]:.1f} (mean of five minutes) on its {os.cpu_count()} cores: what"
        " else runs takes the processor from the loop and from the bus, which is a program too.",
        "",
    ], held


def witnessed_delay(log: Path, limit: float) -> list[tuple[float, float]]:
    """Mean total delay [s] of each quiet part of the trials near the limit, and its length [s].

    Torque and sample are where the bus had them: from the arrival of the request to that of the
    torque, as long as that torque acted. The log says only which sample a torque was made from.
    """
    metadata, rows = read_log(log)
    rows = rows[(rows["flags"] & FLAG_WARM_UP) == 0]
    arrived = [row for row in read_rows(log.with_suffix(".witness.csv")) if row.event == "rx"]
    asked = np.array([row.time_s for row in arrived if row.instruction == Instruction.READ])
    sent = np.array([row.time_s for row in arrived if row.instruction == Instruction.SYNC_WRITE])
    inserted = metadata["config"]["delay"]["steps"] * PERIOD
    found = []
    for number, phase in enumerate(metadata["phases"]):
        own = rows[rows["phase"] == number]
        near = phase["reach"] is not None and 0.8 < phase["stiffness"] / limit < 1.25
        if not near or own.size < 2 * WINDOW:
            continue
        parts = np.array_split(own[:-1], own.size // WINDOW)
        spoilt = [float(np.mean((part["outcome"] != 0) + part["missed"])) for part in parts]
        for part, share in zip(parts, spoilt, strict=True):
            if share > max(QUIET, float(np.median(spoilt))):
                continue  # the sweep leaves out what was disturbed too
            sampled = part["sampled_ns"] * 1e-9
            torque = np.searchsorted(sent, sampled + part["age_ns"] * 1e-9)
            sample = np.searchsorted(asked, sampled)
            whole = (torque + 1 < sent.size) & (sample < asked.size)
            begins, ends = sent[torque[whole]], sent[torque[whole] + 1]
            held = ends - begins
            old = begins - asked[sample[whole]] + 0.5 * held
            mean = float(np.sum(held * old) / np.sum(held)) - 0.5 * PERIOD
            found.append((mean + inserted, float(np.sum(held))))
    return found


def table(header: list[str], rows: list[list[str]]) -> list[str]:
    """As a page wants it."""
    lines = [header, ["---"] * len(header), *rows]
    return [f"| {' | '.join(map(str, line))} |" for line in lines]


def grid_part(picture: Path) -> tuple[list[str], bool]:
    """6 x 3 settings through the command itself, timed; its picture is kept."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        subprocess.run(
            [
                *PROGRAM,
                "sweep",
                "simulated",
                "--set",
                "loop.clock=simulated",
                "--virtual-damping=-0.005,0,0.02,0.05,0.1,0.2",
                "--delay-steps=1,2,4",
                "--out",
                folder,
                "--json",
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        took = time.monotonic() - began
        shutil.copy(Path(folder) / "sweep.png", picture)
    held = took < GRID_LIMIT_S
    return [
        "## Time",
        "",
        f"6 x 3 settings of `simulated` on the simulated clock, with logs and picture:"
        f" {took:.0f} s. Wanted: under {GRID_LIMIT_S:g} s. {verdict(held)}",
        "",
    ], held


def verdict(held: bool) -> str:
    """In words."""
    return "It holds." if held else "It does not hold on this machine as it was."


def said(text: str) -> None:
    """Tell whoever waits."""
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    """Measure, write the page."""
    parser = page_options("sweep_check", __doc__, "sweep-check.md")
    parser.add_argument("--quick", action="store_true", help="a few of each")
    parser.add_argument("--seed", type=int, default=1, help="of the linear settings")
    parser.add_argument(
        "--only",
        choices=("linear", "friction", "bus", "time"),
        help="measure one part anew, the others stay as the page has them",
    )
    wanted = parser.parse_args()
    say_time(150 if wanted.quick else 600)
    count = 8 if wanted.quick else 40
    quick, picture = wanted.quick, wanted.out.with_name("sweep.png")
    parts = {
        "linear": lambda: linear_part(linear_cases(wanted.seed, count)),
        "friction": lambda: friction_part(friction_cases(quick)),
        "bus": lambda: bus_part(list(BUS_POINTS[:1] if quick else BUS_POINTS)),
        "time": lambda: grid_part(picture),
    }
    chosen = [wanted.only] if wanted.only else list(parts)
    sections = dict(zip(parts, kept(wanted.out), strict=True)) if wanted.only else {}
    held = True
    for name in chosen:
        lines, good = parts[name]()
        sections[name] = "\n".join([*lines, measured_on(), ""])
        held = held and good
    page = "\n".join(
        [
            "# How well a sweep measures",
            "",
            f"Written by `scripts/sweep_check{' --quick' if quick else ''}`, seed {wanted.seed};"
            " run it to see the figures of your machine.",
            "",
            *(sections[name] for name in parts),
        ]
    )
    wanted.out.write_text(page)
    print(page)
    sys.exit(not held)


def kept(page: Path) -> list[str]:
    """The sections of a page that was written before."""
    _, *sections = page.read_text().split("\n## ")
    return [f"## {section.rstrip()}\n" for section in sections]


if __name__ == "__main__":
    main()
