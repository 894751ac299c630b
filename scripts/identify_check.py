"""Identifies simulated servos whose truth is known, and writes docs/identify-check.md.

    scripts/identify_check [--seeds N] [--ordinary N] [--quick] [--out FILE]

Each seed draws a servo: inertia, damping and friction up to 20 % from those of its model, a lag
from 0 to 5 ms, and a position between two counts of the encoder. The belief stays that of the
model. On the simulated clock: the same seeds give the same figures on every machine.

Then ordinary servos, with friction at rest, cogging, a weight, and all together: what matters is
whether the bounds that the guard works with hold the truth, and how wide they are.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from haptic_wall.controller.bench.machine import machine, versions
from haptic_wall.controller.experiments.commission.verdict import ASKED, Question
from haptic_wall.controller.experiments.identify.identification import (
    Estimated,
    Identified,
    UnidentifiableError,
    identify,
)
from haptic_wall.controller.experiments.identify.identified_config import identified_model
from haptic_wall.controller.experiments.processes import cores, not_from_the_terminal, processes
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from scripts.ordinary_servos import (
    COGGING,
    FADING,
    GRAVITY,
    GROUPS,
    PERIODS,
    STICTION,
    drawn_effects,
    ordinary,
)
from scripts.whole_program import page_options, say_time

Found = TypeVar("Found")

SEEDS, ORDINARY, QUICK = 50, 25, 5
SERVO_S, ORDINARY_S = 3.5, 15.0
"""What one servo takes"""
FIRST = 7000
"""Seed of the first ordinary servo"""
SPREAD = 0.2
LONGEST_S = 5e-3
NAMES = ("inertia", "damping", "coulomb", "delay")
WANTED = 0.05, 0.1, 0.9
"""Share of a value, share of a period, share of the seeds within two standard errors"""
HELD, WIDER = 0.93, 3.0
"""Share of the ordinary servos whose bounds hold the truth; their width beside the ideal ones'"""


class Kind(NamedTuple):
    """A servo as its data say it is."""

    name: str
    like: str
    inertia: float
    damping: float
    coulomb: float
    torque_limit: float


KINDS = (
    Kind("XL330-like", "XL330-M288", 0.0018142, 0.0036617, 0.012833, 0.52),
    Kind("XM430-like", "MX-64, its sister", 0.011951, 0.011692, 0.09039, 4.1),
)


class Case(NamedTuple):
    """One servo and what was found of it, in the order of ``NAMES``."""

    truth: tuple[float, ...]
    found: tuple[float, ...]
    stderr: tuple[float, ...]


def drawn(kind: Kind, seed: int) -> Config:
    """The configuration of a seed's servo, with its model's belief."""
    random = np.random.default_rng(seed)
    inertia, damping, coulomb = random.uniform(1 - SPREAD, 1 + SPREAD, 3).tolist()
    delay = float(random.uniform(0.0, LONGEST_S))
    between = float(random.uniform(0.0, math.tau / 4096))
    sets = [
        "loop.clock=simulated",
        "wall.side=both",
        f"servo.inertia={kind.inertia * inertia}",
        f"servo.damping={kind.damping * damping}",
        f"servo.coulomb={kind.coulomb * coulomb}",
        f"servo.delay={delay}",
        f"servo.kick={between}",
        f"servo.torque_limit={kind.torque_limit}",
        "servo.torque_step=0",
        f"model.delay={{value: {LONGEST_S / 2}, low: 0.0, high: {LONGEST_S}}}",
    ]
    for name in NAMES[:3]:
        value = getattr(kind, name)
        bounds = f"{{value: {value}, low: {(1 - SPREAD) * value}, high: {(1 + SPREAD) * value}}}"
        sets.append(f"model.{name}={bounds}")
    return load_config("simulated", sets).config


def case(kind: Kind, seed: int, folder: Path) -> Case:
    """Identify one servo."""
    config = drawn(kind, seed)
    found: Identified = identify(config, Path(tempfile.mkdtemp(dir=folder)))
    estimates = [getattr(found, name) for name in NAMES]
    return Case(
        tuple(getattr(config.servo, name) for name in NAMES),
        tuple(e.value for e in estimates),
        tuple(e.stderr for e in estimates),
    )


class Bounded(NamedTuple):
    """An ordinary servo: bounds of inertia and damping over the truth, and what they allow."""

    low: tuple[float, float]
    high: tuple[float, float]
    ideal: tuple[float, float]
    """Width of the bounds of the same servo without its effects, if found to the digit"""
    stiffness: float
    """Commanded without virtual damping, beside what those bounds allow"""


def ordinary_case(kind: Kind, group: str, seed: int, folder: Path) -> Bounded | str:
    """Identify an ordinary servo; a text says why that failed."""
    config = drawn(kind, seed)
    with ordinary(drawn_effects(group, kind.coulomb, seed)):
        try:
            found = identify(config, Path(tempfile.mkdtemp(dir=folder)))
        except UnidentifiableError as error:
            return str(error)
    truth = {name: getattr(config.servo, name) for name in NAMES}
    exact = replace(found, **{name: Estimated(value, 0.0) for name, value in truth.items()})
    models = [identified_model(each, config.period_s) for each in (found, exact)]
    ends = {
        end: tuple(models[0][name][end] / truth[name] for name in NAMES[:2])
        for end in ("low", "high")
    }
    ideal = tuple((models[1][n]["high"] - models[1][n]["low"]) / truth[n] for n in NAMES[:2])
    mine, best = (_commanded(config, model) for model in models)
    return Bounded(ends["low"], ends["high"], ideal, mine / best)


def _commanded(config: Config, model: dict[str, dict[str, float]]) -> float:
    """The largest stiffness without virtual damping of a belief [N·m/rad]."""
    raw = config.model_dump(mode="json")
    raw["model"] = model
    decided = Question.of(Config.model_validate(raw), None).decide(ASKED, 0.0)
    return decided.stiffness


def ordinary_rows(kind: Kind, group: str, cases: list[Bounded | str]) -> str:
    """A row: how often the bounds hold the truth, how wide they are, what they allow."""
    good = [c for c in cases if isinstance(c, Bounded)]
    cells = [f"{len(good)} of {len(cases)}"]
    for n in range(2):
        held = sum(c.low[n] <= 1.0 <= c.high[n] for c in good)
        cells.append(f"{held} of {len(cases)}")
    for n in range(2):
        cells.append(f"{np.median([(c.high[n] - c.low[n]) / c.ideal[n] for c in good]):.2f}")
    cells.append(f"{np.median([c.stiffness for c in good]):.2f}")
    cells.append(f"{min(c.stiffness for c in good):.2f}")
    return f"| {kind.name} | {group} | {' | '.join(cells)} |"


def ordinary_hold(cases: list[Bounded | str]) -> bool:
    """Whether all that is wanted of ordinary servos was met."""
    good = [c for c in cases if isinstance(c, Bounded)]
    for n in range(2):
        held = sum(c.low[n] <= 1.0 <= c.high[n] for c in good)
        wider = np.median([(c.high[n] - c.low[n]) / c.ideal[n] for c in good])
        if held < HELD * len(cases) or wider > WIDER:
            return False
    return True


def ordinary_section(found: list[tuple[Kind, str, list[Bounded | str]]]) -> list[str]:
    """The part of the page on ordinary servos."""
    count = len(found[0][2])
    everything = [case for _, _, cases in found for case in cases]
    coulomb = KINDS[1].coulomb
    return [
        "",
        "## Ordinary servos",
        "",
        f"The same servos with what a real one has besides: friction at rest {STICTION[0]:g} to"
        f" {STICTION[1]:g} times that in motion (of half of them it fades over {FADING[0]:g} to"
        f" {FADING[1]:g} rad/s), cogging of up to {COGGING * coulomb:.2g} N·m with {PERIODS[0]} to"
        f" {PERIODS[1]} periods in a turn, a weight of up to {GRAVITY * coulomb:.2g} N·m that hangs"
        " anywhere, and all of it together; the torques are those of the XM430-like servo, on the"
        " other one they are smaller as its friction is. Seeds"
        f" {FIRST} to {FIRST + count - 1} of each.",
        "",
        "Bounds are those that `--out` writes, and that the guard works with. Their width stands"
        " beside that of the same servo without these effects, found to the digit; so does the"
        " stiffness that the guard commands without virtual damping.",
        "",
        "| servo | with | a result | inertia in its bounds | damping | width, inertia, median |"
        " damping | stiffness, median | least |",
        "|---|---|---|---|---|---|---|---|---|",
        *(ordinary_rows(kind, group, cases) for kind, group, cases in found),
        "",
        f"Wanted: of all {len(everything)} the truth of inertia and of damping in the bounds in"
        f" {100 * HELD:g} % or more, and a median width of {WIDER:g} times the ideal one's at most."
        f" {'It holds.' if ordinary_hold(everything) else 'It does not hold.'}",
    ]


def rows(kind: Kind, cases: list[Case]) -> list[str]:
    """A row for each value: how far off, how uncertain, how often within two standard errors."""
    lines = []
    for n, name in enumerate(NAMES):
        off = np.array([abs(c.found[n] - c.truth[n]) for c in cases])
        error = np.array([c.stderr[n] for c in cases])
        if name == "delay":
            off, error, unit, wanted = 1e3 * off, 1e3 * error, "ms", f"{WANTED[1]:g} ms"
        else:
            truth = np.array([c.truth[n] for c in cases])
            off, error, unit, wanted = (
                100 * off / truth,
                100 * error / truth,
                "%",
                f"{100 * WANTED[0]:g} %",
            )
        within = int(np.count_nonzero(off <= 2 * error))
        lines.append(
            f"| {kind.name} | {name} | {np.median(off):.3f} {unit} | {np.max(off):.3f} {unit} |"
            f" {wanted} | {np.median(error):.3f} {unit} | {within} of {len(cases)} |"
        )
    return lines


def holds(cases: list[Case]) -> bool:
    """Whether all that is wanted was met."""
    off = np.array([np.abs(np.subtract(c.found, c.truth)) for c in cases])
    truth, stderr = (np.array([getattr(c, name) for c in cases]) for name in ("truth", "stderr"))
    near = np.all(off[:, :3] <= WANTED[0] * truth[:, :3]) and np.all(off[:, 3] <= WANTED[1] * 1e-3)
    within = np.mean(off <= 2 * stderr, axis=0)
    return bool(near and np.all(within >= WANTED[2]))


def page(
    found: list[tuple[Kind, list[Case]]],
    seconds: float,
    others: list[tuple[Kind, str, list[Bounded | str]]],
) -> str:
    """The page."""
    count = len(found[0][1])
    about = machine()
    lines = [
        "# Identification, checked",
        "",
        "Written by `scripts/identify_check`. Simulated servos whose truth is known are identified"
        " by [`haptic-wall identify`](identify.md): encoder of 4096 counts, 1 kHz, inertia, damping"
        f" and friction up to {100 * SPREAD:g} % from what is believed, a lag from 0 to"
        f" {1e3 * LONGEST_S:g} ms with all its fractions, and a start anywhere between two counts.",
        "",
        f"Seeds 0 to {count - 1} of each servo, {seconds / (count * len(found)):.1f} s each on"
        f" {about['processor']}, {about['cores']} cores, {about['system']}, Python"
        f" {versions()['python']}, NumPy {versions()['numpy']}. The figures themselves depend on"
        " the seeds alone.",
        "",
        "| servo | value | off, median | off, worst | wanted | standard error, median |"
        " truth within two |",
        "|---|---|---|---|---|---|---|",
        *(row for kind, cases in found for row in rows(kind, cases)),
        "",
        *(f"{kind.name}: {kind.like} as identified by Rhoban's *bam*." for kind in KINDS),
        "",
        f"Wanted besides: the truth within two standard errors at least {100 * WANTED[2]:g} % of"
        f" the time. {'It holds.' if all(holds(c) for _, c in found) else 'It does not hold.'}",
        *ordinary_section(others),
    ]
    return "\n".join(lines) + "\n"


def _told(what: str, asked: list[Future[Found]]) -> Iterator[Found]:
    """Yield the results in order, and print a line about each."""
    for done, one in enumerate(asked, 1):
        result = one.result()
        print(f"{what} {done}/{len(asked)}", file=sys.stderr)
        yield result


def main(arguments: Sequence[str] | None = None) -> int:
    """Identify them all, and write the page."""
    parser = page_options("identify_check", __doc__, "identify-check.md")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="servos of each kind")
    parser.add_argument(
        "--ordinary", type=int, default=ORDINARY, help="ordinary servos of each kind and effect"
    )
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} seeds, one ordinary servo")
    options = parser.parse_args(arguments)
    seeds, count = (QUICK, 1) if options.quick else (options.seeds, options.ordinary)
    say_time(SERVO_S * seeds * len(KINDS) + ORDINARY_S * count * len(KINDS) * len(GROUPS))
    with tempfile.TemporaryDirectory() as name, not_from_the_terminal(), processes(cores()) as pool:
        folder = Path(name)
        began = time.monotonic()
        ideal = {
            kind: [pool.submit(case, kind, seed, folder) for seed in range(seeds)] for kind in KINDS
        }
        ordinary = {
            (kind, group): [
                pool.submit(ordinary_case, kind, group, FIRST + n, folder) for n in range(count)
            ]
            for kind in KINDS
            for group in GROUPS
        }
        found = [(kind, list(_told(kind.name, ideal[kind]))) for kind in KINDS]
        seconds = time.monotonic() - began
        others = [
            (kind, group, list(_told(f"{kind.name} {group}", asked)))
            for (kind, group), asked in ordinary.items()
        ]
    text = page(found, seconds, others)
    options.out.write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
