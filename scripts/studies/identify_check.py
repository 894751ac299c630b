"""Identifies simulated servos whose truth is known.

    scripts/study identify_check [--seeds N] [--servos N] [--seed N] [--effects NAME ...] [--quick]

Each seed draws a servo: inertia, damping and friction up to 20 % from those of its model, a lag
from 0 to 5 ms, and a position between two counts of the encoder. The belief stays that of the
model. On the simulated clock: the same seeds give the same figures on every machine.

Then servos with the effects of real ones, each alone and all together. The study counts how often
the guard's bounds jointly contain the truth, and how wide they are.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.commission.verdict import ASKED, GuardQuestion
from haptic_wall.controller.experiments.identify.bench import UnidentifiableError
from haptic_wall.controller.experiments.identify.identification import Identified, identify
from haptic_wall.controller.experiments.identify.identified_config import identified_model
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from scripts.rates import lower_bound
from scripts.study import Found, Option, Part, Study, table
from tests.support.real_servos import ALL, EFFECTS, IDEAL, drawn_servo, truth_of
from tests.support.real_servos import KINDS as REAL_KINDS
from tests.support.real_servos import Kind as RealKind

SEEDS = 50
FIRST = 7000
"""Seed of the first servo with an effect"""
DRAWN = (IDEAL, *EFFECTS, ALL)
SPREAD = 0.2
LONGEST_S = 5e-3
NAMES = ("inertia", "damping", "coulomb", "delay")
WANTED = 0.05, 0.1, 0.9
"""Share of a value, share of a period, share of the seeds within two standard errors"""
BOUNDED = ("inertia", "damping", "delay")
"""Quantities whose bounds the guard uses"""
IDEAL_WIDTHS = (0.04, 0.1, 0.1)
"""Of the bounds of an ideal servo: of inertia and damping over the value, of the delay [ms]"""
NAMED = {
    "sticks": "the shaft sticks",
    "fades": "friction fades",
    "drag": "square of the speed",
    "gear": "the gear adds",
    "direction": "the smaller value is used",
    "dead band": "less than commanded",
    "cogs": "cogging: an amplitude",
    "with the angle": "depends on the angle",
    "residual": "the residual",
}
"""Names of the warnings, and words in them"""


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


class Result(NamedTuple):
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


def identified(case: tuple[Kind, int]) -> Result:
    """Identify one servo."""
    config = drawn(*case)
    with tempfile.TemporaryDirectory() as folder:
        found: Identified = identify(config, Path(folder))
    estimates = [getattr(found, name) for name in NAMES]
    return Result(
        tuple(getattr(config.servo, name) for name in NAMES),
        tuple(e.value for e in estimates),
        tuple(e.stderr for e in estimates),
    )


class Bounded(NamedTuple):
    """A servo with an effect: the bounds that the guard works with, and what they hold."""

    low: tuple[float, ...]
    """Of ``BOUNDED``, over the truth; that of the delay in milliseconds from it"""
    high: tuple[float, ...]
    stiffness: float
    """Commanded without virtual damping, over what exact bounds would allow"""
    named: tuple[str, ...]
    """Names of the warnings"""

    @property
    def held(self) -> bool:
        """Whether all bounds hold the truth."""
        middle = (1.0, 1.0, 0.0)
        return all(a <= m <= b for a, m, b in zip(self.low, middle, self.high, strict=True))

    @property
    def safe(self) -> bool:
        """Whether the bounds that limit the guard hold: more damping or less delay are harmless."""
        return self.low[0] <= 1.0 <= self.high[0] and self.low[1] <= 1.0 and self.high[2] >= 0.0


Drawn = tuple[RealKind, str, int]
"""Servo, effect and seed"""


def effect_identified(case: Drawn) -> Bounded | str:
    """Identify a servo with an effect; a text says why that failed."""
    kind, effect, seed = case
    config = drawn_servo(kind, effect, seed)
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = identify(config, Path(folder))
        except UnidentifiableError as error:
            return str(error)
    truth = truth_of(kind, config)
    model = identified_model(found, config)
    exact = dict(model)
    for name, value, width in zip(BOUNDED, truth, (0.02, 0.05, 0.0), strict=True):
        away = width * value or 0.05 * config.period_s
        exact[name] = {"value": value, "low": max(value - away, 0.0), "high": value + away}
    ends = {
        end: (
            *(model[name][end] / value for name, value in zip(BOUNDED[:2], truth, strict=False)),
            1e3 * (model["delay"][end] - truth[2]),
        )
        for end in ("low", "high")
    }
    stiffness = _commanded(config, model) / _commanded(config, exact)
    named = tuple(
        name for name, begin in NAMED.items() if any(begin in text for text in found.warnings)
    )
    return Bounded(ends["low"], ends["high"], stiffness, named)


def _commanded(config: Config, model: dict[str, dict[str, float]]) -> float:
    """The largest stiffness without virtual damping of a belief [N·m/rad]."""
    raw = config.model_dump(mode="json")
    raw["model"] = model
    decided = GuardQuestion.of(Config.model_validate(raw), None).decide(ASKED, 0.0)
    return decided.stiffness


def effect_cells(effect: str, rows: list[Bounded | str]) -> list[str]:
    """How often the bounds hold the truth, how wide they are, and what they allow."""
    good = [each for each in rows if isinstance(each, Bounded)]
    widths = [
        float(np.median([each.high[n] - each.low[n] for each in good])) / IDEAL_WIDTHS[n]
        for n in (1, 2)
    ]
    stiffness = [each.stiffness for each in good]
    values = (*widths, float(np.median(stiffness)), min(stiffness))
    held = f"{sum(each.held for each in good)} of {len(rows)}"
    return [effect, held, *(f"{value:.2f}" for value in values)]


def effect_lines(found: Found[Drawn, Bounded | str]) -> list[str]:
    """The part of the page on servos with effects."""
    head = ["effect", "bounds hold the truth", "width, damping", "delay"]
    head += ["stiffness, median", "least"]
    every = [(effect, [row for case, row in found if case[1] == effect]) for effect in DRAWN]
    cells = [effect_cells(effect, rows) for effect, rows in every if rows]
    good = [row for _, row in found if isinstance(row, Bounded)]
    return [
        *table(head, *cells),
        "",
        f"Of all {len(found)} servos, {len(good)} gave a result. Of these the bounds hold the truth"
        f" jointly in {_rate(sum(row.held for row in good), len(good))}. Both ends of the inertia,"
        " the lower bound of the damping and the upper bound of the delay, which limit the guard,"
        f" hold in {_rate(sum(row.safe for row in good), len(good))}.",
    ]


def _rate(held: int, number: int) -> str:
    share, least = 100 * held / number, 100 * lower_bound(held, number)
    return f"{held} ({share:.1f} %, at least {least:.1f} %)"


def cells(kind: Kind, results: list[Result]) -> list[list[str]]:
    """For each value: how far off, how often within two standard errors."""
    rows = []
    for n, name in enumerate(NAMES):
        off = np.array([abs(c.found[n] - c.truth[n]) for c in results])
        error = np.array([c.stderr[n] for c in results])
        if name == "delay":
            off, error, unit = 1e3 * off, 1e3 * error, "ms"
        else:
            scale = 100 / np.array([c.truth[n] for c in results])
            off, error, unit = off * scale, error * scale, "%"
        within = int(np.count_nonzero(off <= 2 * error))
        rows.append(
            [
                *(kind.name, name, f"{np.median(off):.3f} {unit}", f"{np.max(off):.3f} {unit}"),
                f"{within} of {len(results)}",
            ]
        )
    return rows


def holds(results: list[Result]) -> bool:
    """Whether all that is wanted was met."""
    off = np.array([np.abs(np.subtract(c.found, c.truth)) for c in results])
    truth, stderr = (np.array([getattr(c, name) for c in results]) for name in ("truth", "stderr"))
    near = np.all(off[:, :3] <= WANTED[0] * truth[:, :3]) and np.all(off[:, 3] <= WANTED[1] * 1e-3)
    within = np.mean(off <= 2 * stderr, axis=0)
    return bool(near and np.all(within >= WANTED[2]))


def _of(found: Found[tuple[Kind, int], Result]) -> dict[Kind, list[Result]]:
    return {kind: [row for case, row in found if case[0] == kind] for kind in KINDS}


def all_hold(found: Found[tuple[Kind, int], Result]) -> bool:
    """Whether what is wanted holds for each kind."""
    return all(map(holds, _of(found).values()))


def lines(found: Found[tuple[Kind, int], Result]) -> list[str]:
    """The part of the page on servos as the model describes them."""
    head = ["servo", "value", "off, median", "off, worst"]
    rows = [row for kind, results in _of(found).items() for row in cells(kind, results)]
    return [
        *table([*head, "truth within two"], *rows),
        "",
        f"Wanted: inertia, damping and friction within {100 * WANTED[0]:g} %, the delay within"
        f" {WANTED[1]:g} ms, and the truth within two standard errors at least"
        f" {100 * WANTED[2]:g} % of the time."
        f" {'It holds.' if all_hold(found) else 'It does not hold.'}",
    ]


STUDY = Study(
    "evidence/identify-check.md",
    (
        Part(
            "model",
            lambda given: [(kind, seed) for kind in KINDS for seed in range(given.seeds)],
            identified,
            lines,
            case_s=3.5,
            wanted=all_hold,
        ),
        Part(
            "effects",
            lambda given: [
                (kind, effect, given.seed + n)
                for n in range(given.servos)
                for effect in given.effects
                for kind in REAL_KINDS
            ],
            effect_identified,
            effect_lines,
            case_s=4.0,
        ),
    ),
    (
        Option("seeds", SEEDS, "simulated servos of each kind", quick=5),
        Option("servos", 38, "servos of each kind with each effect", quick=1),
        Option("seed", FIRST, "seed of the first servo with an effect"),
        Option("effects", DRAWN, "effects that are drawn", choices=DRAWN),
    ),
)
