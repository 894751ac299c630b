"""``haptic-wall identify --record``: fits servo, friction and load to a recorded motion."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.options import answer, reading
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.recorded.estimate import Pendulum

_ABOUT_S = 10.0
"""Usual duration of a fit [s]"""


def identify_record(record: Path, plot: Path | None, pendulum: Pendulum | None) -> None:
    """Fit a recorded motion, and print the result.

    Args:
        record: The CSV.
        plot: Path of the picture; None: none is drawn.
        pendulum: The known weight on the shaft; None: there is none.

    Raises:
        UserError: The file is not usable.
    """
    from haptic_wall.controller.experiments.recorded import estimate
    from haptic_wall.controller.experiments.recorded.record import read_record
    from haptic_wall.controller.experiments.recorded.text import report, text

    with working("fitting the motion", _ABOUT_S):
        with reading("--record", record, "a CSV"):
            motion = read_record(record)
        found = estimate.identify_record(motion, pendulum)
    result = {"name": record.name, **report(found), "plot": None}
    if plot is not None and found.shot is not None:
        from haptic_wall.controller.report.recorded import plot_recorded

        draw = partial(plot_recorded, found, record.name)
        result["plot"] = drawn_or_noted("--plot", plot, draw)
    answer(result, lambda: text(found, result["plot"]))


def refuse_pendulum(mass: float | None, length: float | None) -> None:
    """Raise if a pendulum is given without a record.

    Args:
        mass: Mass as given [kg]; None: not given.
        length: Length as given [m]; None: not given.

    Raises:
        UserError: One was given.
    """
    for name, value in (("mass", mass), ("length", length)):
        if value is not None:
            raise UserError(
                "found without --record",
                field=f"--pendulum-{name}",
                advice="add --record FILE, or leave the option out",
            )


def refuse_needless(found: list[str]) -> None:
    """Raise if an option is given that needs a moving servo."""
    if found:
        raise UserError(
            f"found with {' and '.join(found)}, but a record moves nothing, and no configuration "
            "is read or written",
            field="--record",
            advice=f"leave {' and '.join(found)} out",
        )


def pendulum_of(mass: float | None, length: float | None) -> Pendulum | None:
    """Return the pendulum of the options; None if no pendulum is given.

    Raises:
        UserError: One of the two is missing.
    """
    if mass is None and length is None:
        return None
    if mass is None or length is None:
        given, missing = ("length", "mass") if mass is None else ("mass", "length")
        raise UserError(
            f"missing beside --pendulum-{given}",
            field=f"--pendulum-{missing}",
            advice="give both, or neither",
        )
    from haptic_wall.controller.experiments.recorded.estimate import Pendulum

    return Pendulum(mass, length)
