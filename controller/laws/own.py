"""Renders a user's law, a Python class: tabulates it once, and renders the table.

The class gives ``torque(position)`` over the range that it declares. It is called for every encoder
count before the torque is switched on, and never while the loop runs. The loop renders the table,
so the steepest slope is known, the torque depends on the position alone, and the user's code costs
no time in the tick.

Importing a module runs it. So ``module:Class`` is imported only where a run has called ``allow``: a
log, a message, or a configuration that is only read can name any module and any function. A law
that a distribution registers is code that somebody has installed, and always allowed.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import redirect_stdout
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final, Protocol

from haptic_wall.controller.laws.profile import Profile
from haptic_wall.controller.laws.shape import Grid, LawError

GROUP = "haptic_wall.laws"
"""Entry points of other distributions"""
USUAL_STEP = math.tau / 4096.0
"""Distance of the table's rows where the position is not quantised [rad]"""
MOST_COUNTS = 2**17
"""Most rows of a table"""
_WANTED: Final = "module:Class, importable from here, with low, high and torque(position)"
_allowed: Final[set[str]] = set()
_tables: Final[dict[tuple[str, str, Grid], Profile]] = {}
"""By the law's name, its options as text, and the grid; the oldest first"""
_MOST_TABLES: Final = 8
"""Most tables that are kept: each change of the options makes another"""


class OwnLaw(Protocol):
    """The interface of a class of the user's; ``wall.options`` are its arguments, by name.

    Attributes:
        low: Lower end of its range, counted from ``wall.position`` [rad].
        high: Upper end [rad].
    """

    low: float
    high: float

    def torque(self, position: float) -> float:
        """Return the torque [N·m] at a position [rad], which it depends on alone."""
        ...


def registered() -> dict[str, EntryPoint]:
    """Return the laws that other distributions bring, by name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def allow(names: Iterable[str]) -> None:
    """Allow this process to import laws: those of a configuration that it runs."""
    _allowed.update(names)


def is_closed(name: str) -> bool:
    """Whether this law is in a module that this process may not import."""
    return ":" in name and name not in _allowed


def own_law(name: str, options: Mapping[str, Any]) -> OwnLaw:
    """Make the user's law, if it is a class with a ``torque``; its range may be made with it.

    Args:
        name: ``module:Class``, or the name of an entry point.
        options: Arguments of the class.

    Raises:
        LawError: It may not be imported, cannot be loaded or made, or is no such class.
    """
    try:
        law: OwnLaw = _class_of(name)(**options)
        missing = [end for end in ("low", "high") if not hasattr(law, end)]
        if not missing:
            float(law.low), float(law.high)
    except LawError:
        raise
    except (Exception, SystemExit) as error:
        raise LawError(
            "law", f"found {name}, which fails ({type(error).__name__}: {error})", _WANTED
        ) from error
    if missing:
        raise LawError("law", f"found {name} without {' and '.join(missing)}", _WANTED)
    return law


def _class_of(name: str) -> Callable[..., OwnLaw]:
    """Return the class of a law, known to be one before it is called."""
    if is_closed(name):
        raise LawError(
            "law",
            f"found {name}, whose module is imported only by a run that begins with it",
            "an installed law, by its name",
        )
    found = _loaded(name)
    if not isinstance(found, type):
        raise LawError("law", f"found {name}, of type {type(found).__name__}", _WANTED)
    if not hasattr(found, "torque"):
        raise LawError("law", f"found {name} without torque", _WANTED)
    return found


def _loaded(name: str) -> Any:  # noqa: ANN401 - a class of the user's
    if ":" not in name:
        return registered()[name].load()
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    added = here not in sys.path
    if added:
        sys.path.insert(0, here)
    try:
        found = import_module(module)
        if not hasattr(found, attribute):
            path = getattr(found, "__file__", None) or "built into Python"
            raise LawError(
                "law",
                f"found {name}: the imported module {module} ({path}) has no {attribute}",
                f"{_WANTED}; give your file a name that no other module has",
            )
        return getattr(found, attribute)
    finally:
        if added:
            sys.path.remove(here)


def own_table(name: str, options: Mapping[str, Any], grid: Grid) -> Profile:
    """Return the table of the user's law; a law is tabulated only once.

    Guard, loop and picture in one process thus have the same table. Text that the law prints goes
    to the standard error.

    Args:
        name: ``module:Class``, or the name of an entry point.
        options: Arguments of the class.
        grid: Gives the encoder step.

    Raises:
        LawError: As for ``own_law`` and ``tabulated``.
    """
    asked = name, repr(dict(options)), grid
    if asked not in _tables:
        if len(_tables) == _MOST_TABLES:
            del _tables[next(iter(_tables))]
        with redirect_stdout(sys.stderr):
            _tables[asked] = tabulated(name, own_law(name, options), grid)
    return _tables[asked]


def tabulated(name: str, law: OwnLaw, grid: Grid) -> Profile:
    """Ask the law for its torque at every encoder count of its range.

    Args:
        name: Name of the law, for messages.
        law: The law to tabulate.
        grid: Gives the encoder step.

    Raises:
        LawError: Its range or a torque is no number, or the table makes no law.
    """
    positions = _positions(name, law, grid)
    torques = [_torque(name, law, position) for position in positions]
    try:
        return Profile(positions, torques)
    except LawError as error:
        raise LawError("law", f"{name}: {error.found}", error.wanted) from None


def _positions(name: str, law: OwnLaw, grid: Grid) -> list[float]:
    """Return every encoder count of the law's range [rad]."""
    step = grid.step or USUAL_STEP
    low, high = float(law.low), float(law.high)
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
    return positions


def _torque(name: str, law: OwnLaw, position: float) -> float:
    where, wanted = f"at {position:.4g} rad", "a torque [N·m] at every position of its range"
    try:
        torque = float(law.torque(position))
    except (Exception, SystemExit) as error:
        found = f"found {name}, which fails {where} ({type(error).__name__}: {error})"
        raise LawError("law", found, wanted) from error
    if not math.isfinite(torque):
        raise LawError("law", f"found {name}, which gives {torque} {where}", wanted)
    return torque
