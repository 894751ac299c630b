"""Identifies servos with a link on a flexible transmission whose truth is known.

    scripts/study flexible_check [--servos N] [--real N] [--seed S] [--quick]

Takes some 15 s a servo, on the simulated clock: the same seeds give the same figures everywhere.
"""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.experiments.identify.identification import identify
from haptic_wall.controller.experiments.identify.identified_config import identified_model
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.errors import ExplainedError
from scripts.real_servos import ALL, IDEAL, KINDS, drawn_servo
from scripts.study import Found, Option, Part, Study, table
from scripts.trials.rates import lower_bound

HERTZ, RATIO, LOADS = (8.0, 200.0), (0.005, 0.1), (0.05, 2.0)
"""Ranges of frequency, damping ratio and load over motor inertia, drawn in equal ratios"""
BANDS = ((8.0, 20.0), (20.0, 50.0), (50.0, 100.0), (100.0, 150.0), (150.0, 200.0))
NAMES = ("flexible_hz", "flexible_damping_ratio", "inertia", "load_inertia")


class Result(NamedTuple):
    """The identified vibration of a servo."""

    hertz: float
    """True [Hz]"""
    ratio: float
    load: float
    """True load over motor inertia"""
    seen: bool
    low: tuple[float, ...]
    """Bounds over the truth, in the order of ``NAMES``"""
    high: tuple[float, ...]
    failed: str
    """Why there is no result"""

    @property
    def held(self) -> tuple[bool, ...]:
        """Whether each bound holds the truth."""
        return tuple(a <= 1.0 <= b for a, b in zip(self.low, self.high, strict=True))


Case = tuple[str, int]
"""Effect and seed"""


def drawn(effect: str, seed: int) -> tuple[Config, tuple[float, float, float]]:
    """Return a servo with a link, and its frequency, damping ratio and load over motor inertia."""
    random = np.random.default_rng((seed, 20))
    kind = KINDS[seed % len(KINDS)]
    hertz, ratio, load = (
        float(np.exp(random.uniform(*np.log(ends)))) for ends in (HERTZ, RATIO, LOADS)
    )
    raw = drawn_servo(kind, effect, 7000 + seed).model_dump(mode="json")
    inertia = raw["servo"]["inertia"]
    moving, rate = inertia * load / (1.0 + load), math.tau * hertz
    raw["servo"] |= {
        "load_inertia": inertia * load,
        "transmission_stiffness": moving * rate**2,
        "transmission_damping": 2.0 * ratio * moving * rate,
    }
    return Config.model_validate(raw), (hertz, ratio, load)


def found_of(case: Case) -> Result:
    """Identify one servo."""
    config, (hertz, ratio, load) = drawn(*case)
    truth = config.servo
    assert truth.inertia is not None
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = identify(config, Path(folder))
        except (HapticWallError, ExplainedError) as error:
            return Result(hertz, ratio, load, False, (), (), str(error))
    model = identified_model(found, config)
    if found.vibration is None:
        return Result(hertz, ratio, load, False, (), (), "not looked for")
    whole = truth.inertia + truth.load_inertia
    values = (hertz, ratio, whole, truth.load_inertia)
    ends = [
        tuple(model[name][end] / value for name, value in zip(NAMES, values, strict=True))
        for end in ("low", "high")
    ]
    return Result(hertz, ratio, load, found.vibration.seen, ends[0], ends[1], "")


def lines(found: Found[Case, Result]) -> list[str]:
    """The part of the page: by frequency, how often a mode is seen and bounds hold the truth."""
    head = [
        "servo",
        "frequency",
        "servos",
        "a result",
        "seen",
        "frequency held",
        "ratio",
        "inertia",
    ]
    head += ["load", "width of the frequency", "ratio, low", "high"]
    rows = []
    for effect in dict.fromkeys(case[0] for case, _ in found):
        for low, high in BANDS:
            every = [r for c, r in found if c[0] == effect and low <= r.hertz < high]
            if every:
                rows.append([_name(effect), f"{low:g} to {high:g} Hz", *_cells(every)])
    good = [r for _, r in found if not r.failed]
    held = sum(all(r.held) for r in good)
    safe = sum(r.held[0] and r.low[1] <= 1.0 and r.low[2] <= 1.0 for r in good)
    why = Counter(r.failed.split(";")[0].split(",")[0] for _, r in found if r.failed)
    return [
        *table(head, *rows),
        "",
        *(f"No result, {count} of {len(found)}: {text}." for text, count in why.items()),
        *[""] * bool(why),
        f"Of {len(good)} results all bounds hold the truth in {held}: in"
        f" {100 * lower_bound(held, len(good)):.1f} % at least. Those that the ceiling depends on"
        f" (the frequency's, the lower ones of ratio and inertia) hold it in {safe}: in"
        f" {100 * lower_bound(safe, len(good)):.1f} % at least.",
    ]


def _name(effect: str) -> str:
    return "as the model" if effect == IDEAL else "all effects"


def _cells(every: list[Result]) -> list[str]:
    good = [r for r in every if not r.failed]
    seen = [r for r in good if r.seen]
    cells = [str(len(every)), str(len(good)), str(len(seen))]
    cells += [f"{sum(r.held[n] for r in good)} of {len(good)}" for n in range(len(NAMES))]
    if not seen:
        return [*cells, "", "", ""]
    width = np.median([r.high[0] - r.low[0] for r in seen])
    low, high = (float(np.median([ends(r)[1] for r in seen])) for ends in (_low, _high))
    return [*cells, f"{100 * width:.1f} %", f"{low:.2f}", f"{high:.2f}"]


def _low(result: Result) -> tuple[float, ...]:
    return result.low


def _high(result: Result) -> tuple[float, ...]:
    return result.high


STUDY = Study(
    "evidence/flexible-check.md",
    (
        Part(
            "servos",
            lambda given: [
                *((IDEAL, given.seed + n) for n in range(given.servos)),
                *((ALL, given.seed + n) for n in range(given.real)),
            ],
            found_of,
            lines,
            case_s=15.0,
        ),
    ),
    (
        Option("servos", 100, "servos as the model describes them", quick=2),
        Option("real", 20, "servos with all effects", quick=0),
        Option("seed", 0, "first seed"),
    ),
)
