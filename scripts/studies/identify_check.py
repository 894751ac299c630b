"""Identifies simulated servos whose truth is known.

    scripts/study identify_check [--servos N] [--seed N] [--effects NAME ...] [--quick]

Each seed draws a servo: inertia, damping and friction up to 20 % from those of its model, a lag
from 0 to 5 ms, a position between two counts of the encoder, and an effect of real servos, or all.
The belief stays that of the model. The study counts how often the guard's bounds jointly contain
the truth, and how wide they are. On the simulated clock: the same seeds give the same figures on
every machine.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.commission.verdict import ASKED, GuardQuestion
from haptic_wall.controller.experiments.identify.bench import UnidentifiableError
from haptic_wall.controller.experiments.identify.identification import identify
from haptic_wall.controller.experiments.identify.identified_config import identified_model
from haptic_wall.controller.settings.config import Config
from scripts.rates import lower_bound
from scripts.study import Found, Option, Part, Study, table
from tests.support.real_servos import ALL, EFFECTS, IDEAL, KINDS, Kind, drawn_servo, truth_of

FIRST = 7000
"""Seed of the first servo with an effect"""
DRAWN = (IDEAL, *EFFECTS, ALL)
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


Drawn = tuple[Kind, str, int]
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


STUDY = Study(
    "evidence/identify-check.md",
    (
        Part(
            "effects",
            lambda given: [
                (kind, effect, given.seed + n)
                for n in range(given.servos)
                for effect in given.effects
                for kind in KINDS
            ],
            effect_identified,
            effect_lines,
            case_s=4.0,
        ),
    ),
    (
        Option("servos", 38, "servos of each kind with each effect", quick=1),
        Option("seed", FIRST, "seed of the first servo with an effect"),
        Option("effects", DRAWN, "effects that are drawn", choices=DRAWN),
    ),
)
