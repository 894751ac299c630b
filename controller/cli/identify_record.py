"""``haptic-wall identify --record``: fits servo, friction and load to a recorded motion."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_wall.controller.cli.drawing import drawn_or_noted
from haptic_wall.controller.cli.experiment import REACH
from haptic_wall.controller.cli.options import (
    answer,
    as_json,
    reading,
    refuse_other_pictures,
    refuse_same_file,
)
from haptic_wall.controller.cli.places import take_file
from haptic_wall.controller.cli.working import working
from haptic_wall.controller.errors import UserError

if TYPE_CHECKING:
    from haptic_wall.controller.experiments.recorded.estimate import Pendulum

_ABOUT_S = 10.0
"""Usual duration of a fit [s]"""


def identify_record(
    record: Path,
    *,
    plot_path: Path | None,
    pendulum_mass: float | None,
    pendulum_length: float | None,
    force: bool,
    as_json_wanted: bool,
    **needless: object,
) -> None:
    """Fit a recorded motion, and print the result.

    Args:
        record: The CSV.
        plot_path: Path of the picture; None: none is drawn.
        pendulum_mass: [kg]; None: nothing known hangs on the shaft.
        pendulum_length: [m]
        force: Replace a file.
        as_json_wanted: Answer as JSON.
        **needless: Options that need a moving servo, as given; refused.

    Raises:
        UserError: An option or the file is not usable.
    """
    _refuse(needless)
    pendulum = _pendulum(pendulum_mass, pendulum_length)
    refuse_same_file({"--record": record, "--plot": plot_path})
    if plot_path is not None:
        refuse_other_pictures("--plot", plot_path)
        take_file("--plot", plot_path, force=force, make=True)
    from haptic_wall.controller.experiments.recorded import estimate
    from haptic_wall.controller.experiments.recorded.record import read_record
    from haptic_wall.controller.experiments.recorded.text import report, text

    with working("fitting the motion", _ABOUT_S):
        with reading("--record", record, "a CSV"):
            motion = read_record(record)
        found = estimate.identify_record(motion, pendulum)
    result = {"name": record.name, **report(found), "plot": None}
    if plot_path is not None and found.shot is not None:
        from haptic_wall.controller.report.recorded import plot_recorded

        draw = partial(plot_recorded, found, record.name)
        result["plot"] = drawn_or_noted("--plot", plot_path, draw)
    answer(as_json(result) if as_json_wanted else text(found, result["plot"]))


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


def _refuse(given: dict[str, object]) -> None:
    """Raise if an option is given that needs a moving servo."""
    names = {
        "config": "CONFIG",
        "sets": "--set",
        "out": "--out",
        "logs": "--logs",
        "yes": "--yes",
    }
    found = [text for name, text in names.items() if given.get(name)]
    if given.get("reach", REACH) != REACH:
        found.append("--reach")
    if found:
        raise UserError(
            f"found with {' and '.join(found)}, but a record moves nothing, and no configuration "
            "is read or written",
            field="--record",
            advice=f"leave {' and '.join(found)} out",
        )


def _pendulum(mass: float | None, length: float | None) -> Pendulum | None:
    """Return the pendulum of the options; None if no pendulum is given."""
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
