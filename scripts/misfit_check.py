"""Identifies servos with effects that its model does not have, and writes docs/misfit-check.md.

    scripts/misfit_check [--servos N] [--out FILE]

On the simulated clock: the same seeds give the same figures on every machine.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from haptic_wall.controller.experiments.identify.identification import UnidentifiableError, identify
from haptic_wall.controller.experiments.identify.identified_config import identified_model
from haptic_wall.controller.experiments.processes import cores, not_from_the_terminal, processes
from scripts.identify_check import KINDS, drawn
from scripts.ordinary_servos import (
    BACKWARD,
    COGGING,
    FEW_PERIODS,
    LOAD_FRICTION,
    MISFITS,
    drawn_misfit,
    ordinary,
)
from scripts.whole_program import middle_and_most, page_options, say_time

KIND = KINDS[1]
SERVOS, SERVO_S = 20, 30.0
FIRST = 8000
"""Seed of the first servo"""
NAMES = {
    "it sticks": "sticks",
    "it cogs": "cogs",
    "a torque goes": "with the angle",
    "the residual": "residual",
}
"""Beginnings of the warnings, and their names in the table"""


class Case(NamedTuple):
    """The bounds of one servo, over its truth."""

    inertia: tuple[float, float]
    damping: tuple[float, float]
    """Over the smaller of the two directions', which decides on stability"""
    warnings: tuple[str, ...]


def case(misfit: str, seed: int, folder: Path) -> Case | None:
    """Identify one servo; None: that failed."""
    config = drawn(KIND, seed)
    effects = drawn_misfit(misfit, KIND.coulomb, seed)
    with ordinary(effects):
        try:
            found = identify(config, Path(tempfile.mkdtemp(dir=folder)))
        except UnidentifiableError:
            return None
    model = identified_model(found, config.period_s)
    damping = config.servo.damping * min(1.0, effects.backward)

    def over(name: str, truth: float) -> tuple[float, float]:
        return model[name]["low"] / truth, model[name]["high"] / truth

    return Case(over("inertia", config.servo.inertia), over("damping", damping), found.warnings)


def row(misfit: str, cases: Sequence[Case | None]) -> str:
    """One line of the table."""
    good = [each for each in cases if each is not None]
    cells = [misfit, f"{len(good)} of {len(cases)}"]
    for bounds in ([c.inertia for c in good], [c.damping for c in good]):
        cells.append(f"{sum(low <= 1.0 <= high for low, high in bounds)} of {len(cases)}")
        cells.append(middle_and_most([high - low for low, high in bounds], ".2f") if good else "–")
    said = Counter(
        name
        for c in good
        for text in c.warnings
        for begin, name in NAMES.items()
        if text.startswith(begin)
    )
    cells.append(", ".join(f"{name} {count}" for name, count in said.most_common()) or "none")
    return f"| {' | '.join(cells)} |"


def page(found: dict[str, list[Case | None]]) -> str:
    """The page."""
    count = len(found[MISFITS[0]])
    lines = [
        "# Identification of servos that its model does not describe",
        "",
        "Written by `scripts/misfit_check`. Simulated XM430-like servos are identified by"
        " [`haptic-wall identify`](identify.md), each with one effect that the fit does not have:",
        "",
        f"- *direction*: viscous damping at negative speeds is {BACKWARD[0]:g} to {BACKWARD[1]:g}"
        " times that at positive speeds;",
        f"- *load*: the gear adds {LOAD_FRICTION[0]:g} to {LOAD_FRICTION[1]:g} of the motor's"
        " torque to the friction;",
        f"- *few periods*: cogging of {COGGING * KIND.coulomb:.2g} N·m with {FEW_PERIODS[0]} to"
        f" {FEW_PERIODS[1]} periods in a turn, less than one of which lies within the motion.",
        "",
        f"Seeds {FIRST} to {FIRST + count - 1} of each; the other parameters are drawn as for"
        " [the check of the identification](identify-check.md). Bounds are those that the guard"
        " works with, over the truth; of two dampings the truth is the smaller one.",
        "",
        "| effect | a result | inertia in its bounds | their width: median, most | damping in its"
        " bounds | their width: median, most | warnings |",
        "|---|---|---|---|---|---|---|",
        *(row(misfit, cases) for misfit, cases in found.items()),
    ]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Identify them all, and write the page."""
    parser = page_options("misfit_check", __doc__, "misfit-check.md")
    parser.add_argument("--servos", type=int, default=SERVOS, help="of each effect")
    options = parser.parse_args(arguments)
    say_time(SERVO_S * options.servos * len(MISFITS) / cores())
    found: dict[str, list[Case | None]] = {misfit: [] for misfit in MISFITS}
    with tempfile.TemporaryDirectory() as name, not_from_the_terminal(), processes(cores()) as pool:
        asked = [
            (misfit, seed, pool.submit(case, misfit, seed, Path(name)))
            for seed in range(FIRST, FIRST + options.servos)
            for misfit in MISFITS
        ]
        for misfit, seed, one in asked:
            found[misfit].append(one.result())
            print(misfit, seed, found[misfit][-1], file=sys.stderr)
    text = page(found)
    options.out.write_text(text, encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
