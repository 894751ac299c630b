"""Identifies simulated servos whose truth is known.

    scripts/study identify_check [--seeds N] [--ordinary N] [--quick]

Each seed draws a servo: inertia, damping and friction up to 20 % from those of its model, a lag
from 0 to 5 ms, and a position between two counts of the encoder. The belief stays that of the
model. On the simulated clock: the same seeds give the same figures on every machine.

Then ordinary servos, with friction at rest, cogging, a weight, and all together: what matters is
whether the bounds that the guard works with hold the truth, and how wide they are.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_wall.controller.experiments.commission.verdict import ASKED, GuardQuestion
from haptic_wall.controller.experiments.identify.bench import UnidentifiableError
from haptic_wall.controller.experiments.identify.identification import (
    Estimated,
    Identified,
    identify,
)
from haptic_wall.controller.experiments.identify.identified_config import identified_model
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from scripts.ordinary_servos import GROUPS, drawn_effects
from scripts.study import Found, Option, Part, Study, table

SEEDS = 50
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
    """An ordinary servo: bounds of inertia and damping over the truth, and what they allow."""

    low: tuple[float, float]
    high: tuple[float, float]
    ideal: tuple[float, float]
    """Width of the bounds of the same servo without its effects, if found to the digit"""
    stiffness: float
    """Commanded without virtual damping, beside what those bounds allow"""


Ordinary = tuple[Kind, str, int]
"""Servo, effect and seed"""


def ordinary_identified(case: Ordinary) -> Bounded | str:
    """Identify an ordinary servo; a text says why that failed."""
    kind, group, seed = case
    config = drawn_effects(group, kind.coulomb, seed).on(drawn(kind, seed))
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = identify(config, Path(folder))
        except UnidentifiableError as error:
            return str(error)
    truth = {name: getattr(config.servo, name) for name in NAMES}
    sure: dict[str, Any] = {name: Estimated(value, 0.0) for name, value in truth.items()}
    exact = replace(found, **sure)
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
    decided = GuardQuestion.of(Config.model_validate(raw), None).decide(ASKED, 0.0)
    return decided.stiffness


def _good(rows: list[Bounded | str]) -> list[Bounded]:
    return [each for each in rows if isinstance(each, Bounded)]


def _held(rows: list[Bounded | str], n: int) -> int:
    return sum(each.low[n] <= 1.0 <= each.high[n] for each in _good(rows))


def _wider(rows: list[Bounded | str], n: int) -> float:
    """Median width of the bounds, over the ideal one's."""
    return float(np.median([(c.high[n] - c.low[n]) / c.ideal[n] for c in _good(rows)]))


def ordinary_cells(kind: Kind, group: str, rows: list[Bounded | str]) -> list[str]:
    """How often the bounds hold the truth, how wide they are, what they allow."""
    stiffness = [each.stiffness for each in _good(rows)]
    return [
        *(kind.name, group, f"{len(stiffness)} of {len(rows)}"),
        *(f"{_held(rows, n)} of {len(rows)}" for n in range(2)),
        *(f"{_wider(rows, n):.2f}" for n in range(2)),
        *(f"{np.median(stiffness):.2f}", f"{min(stiffness):.2f}"),
    ]


def ordinary_hold(found: Found[Ordinary, Bounded | str]) -> bool:
    """Whether all that is wanted of ordinary servos was met."""
    rows = [row for _, row in found]
    return all(_held(rows, n) >= HELD * len(rows) and _wider(rows, n) <= WIDER for n in range(2))


def ordinary_lines(found: Found[Ordinary, Bounded | str]) -> list[str]:
    """The part of the page on ordinary servos."""
    head = ["servo", "with", "a result", "inertia in its bounds", "damping"]
    head += ["width, inertia, median", "damping", "stiffness, median", "least"]
    cells = [
        ordinary_cells(kind, group, [row for case, row in found if case[:2] == (kind, group)])
        for kind in KINDS
        for group in GROUPS
    ]
    return [
        *table(head, *cells),
        "",
        f"Wanted: of all {len(found)} the truth of inertia and of damping in the bounds in"
        f" {100 * HELD:g} % or more, and a median width of {WIDER:g} times the ideal one's at most."
        f" {'It holds.' if ordinary_hold(found) else 'It does not hold.'}",
    ]


def cells(kind: Kind, results: list[Result]) -> list[list[str]]:
    """For each value: how far off, how uncertain, how often within two standard errors."""
    rows = []
    for n, name in enumerate(NAMES):
        off = np.array([abs(c.found[n] - c.truth[n]) for c in results])
        error = np.array([c.stderr[n] for c in results])
        if name == "delay":
            off, error, unit, wanted = 1e3 * off, 1e3 * error, "ms", f"{WANTED[1]:g} ms"
        else:
            scale = 100 / np.array([c.truth[n] for c in results])
            off, error, unit, wanted = off * scale, error * scale, "%", f"{100 * WANTED[0]:g} %"
        within = int(np.count_nonzero(off <= 2 * error))
        rows.append(
            [
                *(kind.name, name, f"{np.median(off):.3f} {unit}", f"{np.max(off):.3f} {unit}"),
                *(wanted, f"{np.median(error):.3f} {unit}", f"{within} of {len(results)}"),
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
    head = ["servo", "value", "off, median", "off, worst", "wanted", "standard error, median"]
    rows = [row for kind, results in _of(found).items() for row in cells(kind, results)]
    return [
        *table([*head, "truth within two"], *rows),
        "",
        f"Wanted besides: the truth within two standard errors at least {100 * WANTED[2]:g} % of"
        f" the time. {'It holds.' if all_hold(found) else 'It does not hold.'}",
    ]


STUDY = Study(
    "identify-check.md",
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
            "ordinary",
            lambda given: [
                (kind, group, FIRST + n)
                for kind in KINDS
                for group in GROUPS
                for n in range(given.ordinary)
            ],
            ordinary_identified,
            ordinary_lines,
            case_s=15.0,
            wanted=ordinary_hold,
        ),
    ),
    (
        Option("seeds", SEEDS, "simulated servos of each kind", quick=5),
        Option("ordinary", 25, "ordinary servos of each kind and effect", quick=1),
    ),
)
