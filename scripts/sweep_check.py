"""Measures how well `haptic-wall sweep` measures, and writes docs/sweep-check.md.

    scripts/sweep_check [--quick] [--seed N] [--out FILE]

Against the exact boundary of a linear servo, against the onset amplitude that friction's theory
gives, and on an emulated bus in real time against the boundary at the delay that the bus itself
witnessed: the one with which the torque that acted follows the true position. The picture of the
timed sweep goes beside the page.
"""

import random
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from haptic_wall_pytest.record import read_rows
from scipy.optimize import minimize_scalar

from controller.config_load import load_config
from controller.experiments.critical import PointSearch
from controller.experiments.sweep import experiment_config
from controller.experiments.sweep_plan import Options, Setting
from controller.experiments.sweep_result import PointResult
from controller.experiments.testbed import Testbed
from controller.logfile import read_log
from controller.telemetry import FLAG_WARM_UP
from controller.theory import critical_stiffness, max_virtual_damping
from scripts.whole_program import FORGIVING, PROGRAM, measured_on, page_options, say_time

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
KICKS = {"MX-64": (0.03, 0.06, 0.1), "XL330-M288": (0.02, 0.04, 0.08)}
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


def linear_part(cases: list[Case], pool: ProcessPoolExecutor) -> tuple[list[str], bool]:
    """Against the exact boundary."""
    errors, sure = [], 0
    worst = None
    for case, point in zip(cases, pool.map(measured, cases), strict=True):
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


def friction_part(cases: list[Case], pool: ProcessPoolExecutor) -> tuple[list[str], bool]:
    """Against the stiffness whose onset amplitude is the kick."""
    rows, held = [], True
    for case, point in zip(cases, pool.map(measured, cases), strict=True):
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
        delay = float(np.mean([each for found in delays for each in found]))
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
        " true delay is the one with which the torque that acted follows the true position, both"
        " in the bus's own [record](emulated-bus.md), over the trials near the limit.",
        "",
        *table([*header, "difference", "remark"], rows),
        "",
        f"Wanted: within {100 * BUS_LIMIT:g} %. " + verdict(held),
        "",
    ], held


def witnessed_delay(log: Path, limit: float) -> list[float]:
    """True total delays [s] of the trials within a quarter of the limit, one for each."""
    metadata, rows = read_log(log)
    rows = rows[(rows["flags"] & FLAG_WARM_UP) == 0]
    states = [row for row in read_rows(log.with_suffix(".witness.csv")) if row.event == "state"]
    time_s = np.array([row.time_s for row in states])
    position = np.array([row.position_rad for row in states])
    torque = np.array([row.torque_nm for row in states])
    found = []
    for number, phase in enumerate(metadata["phases"]):
        own = rows[rows["phase"] == number]
        near = phase["reach"] is not None and 0.8 < phase["stiffness"] / limit < 1.25
        if not near or own.size < 200:
            continue
        first, last = own["sampled_ns"][0] * 1e-9 + 0.03, own["sampled_ns"][-1] * 1e-9
        inside = (time_s > first) & (time_s < last)
        motion = Motion(time_s, position, time_s[inside], torque[inside])
        damping = phase["damping"]
        best = minimize_scalar(
            motion.misfit, bounds=(0.0, 0.02), args=(phase["stiffness"], damping), method="bounded"
        )
        found.append(float(best.x) - 0.5 * PERIOD)  # a held torque is half a period old
    return found


@dataclass(frozen=True, slots=True)
class Motion:
    """What the bus itself recorded, and the part of it that is looked at."""

    time_s: np.ndarray
    position: np.ndarray
    at: np.ndarray
    torque: np.ndarray

    def misfit(self, lag: float, stiffness: float, damping: float) -> float:
        """How badly the torque is the wall's own on the position a lag before."""
        x = np.interp(self.at - lag, self.time_s, self.position)
        before = np.interp(self.at - lag - PERIOD, self.time_s, self.position)
        return float(np.var(self.torque + stiffness * x + damping * (x - before) / PERIOD))


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
    wanted = parser.parse_args()
    say_time(150 if wanted.quick else 500)
    count = 8 if wanted.quick else 40
    parts = [grid_part(wanted.out.with_name("sweep.png"))]
    with ProcessPoolExecutor(2) as pool:
        parts.append(linear_part(linear_cases(wanted.seed, count), pool))
        parts.append(friction_part(friction_cases(wanted.quick), pool))
    parts.append(bus_part(list(BUS_POINTS[:1] if wanted.quick else BUS_POINTS)))
    page = [
        "# How well a sweep measures",
        "",
        f"Written by `scripts/sweep_check{' --quick' if wanted.quick else ''}`, seed"
        f" {wanted.seed}; run it to see the figures of your machine.",
        measured_on(),
        "",
        *(line for lines, _ in [*parts[1:], parts[0]] for line in lines),
    ]
    wanted.out.write_text("\n".join(page))
    print("\n".join(page))
    sys.exit(not all(held for _, held in parts))


if __name__ == "__main__":
    main()
