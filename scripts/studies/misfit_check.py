"""Identifies servos with effects that its model does not have.

    scripts/study misfit_check [--servos N]

On the simulated clock: the same seeds give the same figures on every machine.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from haptic_wall.controller.experiments.identify.bench import UnidentifiableError
from haptic_wall.controller.experiments.identify.identification import identify
from haptic_wall.controller.experiments.identify.identified_config import identified_model
from scripts.ordinary_servos import MISFITS, drawn_misfit
from scripts.studies.identify_check import KINDS, drawn
from scripts.study import Found, Option, Part, Study, table
from scripts.whole_program import middle_and_most

KIND = KINDS[1]
FIRST = 8000
"""Seed of the first servo"""
NAMES = {
    "it sticks": "sticks",
    "it cogs": "cogs",
    "a torque goes": "with the angle",
    "the residual": "residual",
}
"""Beginnings of the warnings, and their names in the table"""


class Bounds(NamedTuple):
    """The bounds of one servo, over its truth."""

    inertia: tuple[float, float]
    damping: tuple[float, float]
    """Over the smaller of the two directions', which decides on stability"""
    warnings: tuple[str, ...]


def identified(case: tuple[str, int]) -> Bounds | None:
    """Identify one servo; None: that failed."""
    misfit, seed = case
    effects = drawn_misfit(misfit, KIND.coulomb, seed)
    config = effects.on(drawn(KIND, seed))
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = identify(config, Path(folder))
        except UnidentifiableError:
            return None
    model = identified_model(found, config.period_s)
    inertia, damping = config.servo.inertia, config.servo.damping
    assert inertia is not None and damping is not None, "the drawn servo has both"
    damping *= min(1.0, effects.backward)

    def over(name: str, truth: float) -> tuple[float, float]:
        return model[name]["low"] / truth, model[name]["high"] / truth

    return Bounds(over("inertia", inertia), over("damping", damping), found.warnings)


def effects(found: Found[tuple[str, int], Bounds | None]) -> list[str]:
    """The table, a line for each effect."""
    rows = []
    for misfit in MISFITS:
        every = [row for case, row in found if case[0] == misfit]
        good = [each for each in every if each is not None]
        cells = [misfit, f"{len(good)} of {len(every)}"]
        for bounds in ([c.inertia for c in good], [c.damping for c in good]):
            cells.append(f"{sum(low <= 1.0 <= high for low, high in bounds)} of {len(every)}")
            widths = [high - low for low, high in bounds]
            cells.append(middle_and_most(widths, ".2f") if good else "–")
        said = Counter(
            name
            for c in good
            for text in c.warnings
            for begin, name in NAMES.items()
            if text.startswith(begin)
        )
        cells.append(", ".join(f"{name} {count}" for name, count in said.most_common()) or "none")
        rows.append(cells)
    head = ["inertia in its bounds", "their width: median, most"]
    head += ["damping in its bounds", "their width: median, most"]
    return table(["effect", "a result", *head, "warnings"], *rows)


STUDY = Study(
    "misfit-check.md",
    (
        Part(
            "effects",
            lambda given: [(m, FIRST + n) for n in range(given.servos) for m in MISFITS],
            identified,
            effects,
            case_s=30.0,
        ),
    ),
    (Option("servos", 20, "simulated servos for each effect"),),
)
