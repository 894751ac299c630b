"""A law of the user's own, in Python: tabulated once, and rendered from the table.

The class gives ``torque(position)`` over the range that it declares. It is asked at every encoder
count before the torque is switched on, and never while the loop runs. The loop thus renders
the table: its steepest slope is measured, it depends on position alone, and it takes no time.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Protocol

from haptic_wall.controller.laws.profile import Profile
from haptic_wall.controller.laws.shape import Grid, LawError

GROUP = "haptic_wall.laws"
"""Entry points of other distributions"""
USUAL_STEP = math.tau / 4096.0
"""Distance of the table's rows where the position is not quantised [rad]"""
MOST_COUNTS = 2**17
"""Most rows of a table"""
SAME = 1e-9
"""Two answers for one position differ by less than this fraction of the largest torque"""


class OwnLaw(Protocol):
    """The interface of a class of the user's; ``wall.options`` are its arguments, by name.

    Attributes:
        low: Lower end of its range, counted from ``wall.position`` [rad].
        high: Upper end [rad].
    """

    low: float
    high: float

    def torque(self, position: float) -> float:
        """Return the torque at a position [N·m]: of the position alone, always the same."""
        ...


def registered() -> dict[str, EntryPoint]:
    """Return the laws that other distributions bring, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def own_law(name: str, options: Mapping[str, Any]) -> OwnLaw:
    """Make the user's law.

    Args:
        name: ``module:Class``, or the name of an entry point.
        options: Arguments of the class.

    Raises:
        LawError: It cannot be loaded or made.
    """
    wanted = "module:Class, importable from here, with low, high and torque(position)"
    try:
        law: OwnLaw = _loaded(name)(**options)
        missing = [each for each in ("low", "high", "torque") if not hasattr(law, each)]
        if not missing:
            float(law.low), float(law.high)
    except LawError:
        raise
    except (Exception, SystemExit) as error:
        raise LawError(
            "law", f"found {name}, which fails ({type(error).__name__}: {error})", wanted
        ) from error
    if missing:
        raise LawError("law", f"found {name} without {' and '.join(missing)}", wanted)
    return law


def _loaded(name: str) -> Any:  # noqa: ANN401 - a class of the user's
    if ":" not in name:
        return registered()[name].load()
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    added = here not in sys.path
    if added:
        sys.path.insert(0, here)
    try:
        return getattr(import_module(module), attribute)
    finally:
        if added:
            sys.path.remove(here)


@dataclass(frozen=True, slots=True)
class _Asked:
    """The question whose answer is a table."""

    name: str
    shown: str
    """The options as text: they cannot be hashed"""
    grid: Grid
    options: Mapping[str, Any] = field(compare=False)


def own_table(name: str, options: Mapping[str, Any], grid: Grid) -> Profile:
    """Return the table of the user's law; what was tabulated once is not asked again.

    Guard, loop and picture in one process thus have the same table. Text that the law prints goes
    to the standard error.

    Args:
        name: ``module:Class``, or the name of an entry point.
        options: Arguments of the class.
        grid: Gives the encoder step.

    Raises:
        LawError: As for ``own_law`` and ``tabulated``.
    """
    return _table(_Asked(name, repr(dict(options)), grid, options))


@lru_cache(maxsize=8)
def _table(asked: _Asked) -> Profile:
    with redirect_stdout(sys.stderr):
        first, second = (own_law(asked.name, asked.options) for _ in range(2))
        return tabulated(asked.name, first, second, asked.grid)


def tabulated(name: str, law: OwnLaw, second: OwnLaw, grid: Grid) -> Profile:
    """Ask the law for its torque at every encoder count of its range.

    Args:
        name: Of the law, for messages.
        law: To be asked.
        second: The same law, made once more: it must answer the same.
        grid: Gives the encoder step.

    Raises:
        LawError: Its range or a torque is no number, it answers differently when asked again, or
            the table makes no law.
    """
    step = grid.step or USUAL_STEP
    low, high = float(law.low), float(law.high)
    if (low, high) != (float(second.low), float(second.high)) and math.isfinite(high - low):
        raise LawError(
            "law",
            f"found {name}, whose range is {low:.4g} to {high:.4g} rad once and "
            f"{second.low:.4g} to {second.high:.4g} rad another time",
            "the same law whenever it is made",
        )
    rows = (high - low) / step if math.isfinite(low) and math.isfinite(high) else math.nan
    if not 1.0 <= rows < MOST_COUNTS:
        raise LawError(
            "law",
            f"found {name} from {low!r} to {high!r} rad",
            f"a range of 1 to {MOST_COUNTS} encoder counts",
        )
    count = math.ceil(rows)
    positions = [low + i * step for i in range(count)] + [high]
    if positions[-1] - positions[-2] < 0.5 * step and count > 1:
        del positions[-2]  # a very short last interval would look steep
    torques = [_torque(name, law, position) for position in positions]
    most = max(map(abs, torques))
    for position, torque in zip(reversed(positions), reversed(torques), strict=True):
        again = _torque(name, second, position)
        if abs(again - torque) > SAME * most:
            raise LawError(
                "law",
                f"found {name}, whose torque at {position:.4g} rad is {torque:.4g} N·m once and "
                f"{again:.4g} N·m another time",
                "a torque that depends on the position alone: a law that depends on time or on the "
                "past may give energy without end, and is not rendered",
            )
    try:
        return Profile(positions, torques)
    except LawError as error:
        raise LawError("law", f"{name}: {error.found}", error.wanted) from None


def _torque(name: str, law: OwnLaw, position: float) -> float:
    try:
        torque = float(law.torque(position))
    except (Exception, SystemExit) as error:
        raise LawError(
            "law",
            f"found {name}, which fails at {position:.4g} rad ({type(error).__name__}: {error})",
            "a torque [N·m] at every position of its range",
        ) from error
    if not math.isfinite(torque):
        raise LawError(
            "law",
            f"found {name}, which gives {torque} at {position:.4g} rad",
            "a torque [N·m] at every position of its range",
        )
    return torque
