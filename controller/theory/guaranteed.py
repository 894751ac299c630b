"""Proves limits that hold for every servo in a range, not only at samples of it.

The uncertainty of a servo is a range each of inertia, damping, delay and torque gain. The least
critical stiffness is nearly always at the least safe corner of the range, but not always, and no
sample can tell. The proof is by zero exclusion (module ``exclusion``): no member of the range has a
pole on the unit circle, at any stiffness up to the limit. A limit that cannot be proved is not
returned.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields, replace

from haptic_wall.controller.theory.checks import number, positive, scalar
from haptic_wall.controller.theory.exclusion import Exclusion
from haptic_wall.controller.theory.ranges import Member, Ranges
from haptic_wall.controller.theory.worst_member import WorstSearch, closed_in


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer whether every member of a range is stable."""

    proved: bool
    counterexample: Member | None
    """An unstable member; None when proved, or when neither could be shown"""
    boxes: int
    """Number of boxes evaluated for the proof"""


@dataclass(frozen=True, slots=True)
class GuaranteedLimit:
    """A stiffness proved safe for a whole range, and an upper bound of all such."""

    stiffness: float
    """Proved: every member is stable up to it [N·m/rad]; 0: nothing is proved"""
    upper: float
    """Above it ``worst`` is unstable [N·m/rad]"""
    worst: Member
    boxes: int
    """Number of boxes evaluated for the proof"""


@dataclass(frozen=True, slots=True)
class GuaranteedCeiling:
    """A virtual damping at which every member of a range is stable with some stiffness."""

    virtual_damping: float
    """Proved [N·m·s/rad]; 0: nothing is proved"""
    upper: float
    """Above it ``worst`` is unstable, however small the stiffness [N·m·s/rad]"""
    worst: Member
    boxes: int
    """Number of boxes evaluated for the proof"""


@dataclass(frozen=True, slots=True)
class UnknownCost:
    """Stiffness lost because one parameter is uncertain."""

    name: str
    """A field of ``Ranges``"""
    known_at: float
    limit: GuaranteedLimit
    """The limit if this parameter were known exactly, the others as before"""
    lost: float
    """Fraction of that limit which is lost, 0 to 1"""


@dataclass(frozen=True, slots=True)
class Costs:
    """The limit for the believed ranges, and the loss caused by each uncertain parameter."""

    limit: GuaranteedLimit
    known: float
    """The critical stiffness if every parameter were known exactly [N·m/rad]"""
    lost: float
    """Fraction of ``known`` that all uncertainties together cost, 0 to 1"""
    unknowns: tuple[UnknownCost, ...]
    """In the order of the fields of ``Ranges``"""


def is_stable_over(
    ranges: Ranges,
    stiffness: float,
    virtual_damping: float,
    period: float,
    velocity_samples: int = 1,
) -> Verdict:
    """Decide whether a two-sided wall is stable on every servo of a range.

    A proof covers every lower stiffness too, down to 0, and every lower torque gain.

    Args:
        ranges: The ranges of the servo's values.
        stiffness: K > 0, commanded [N·m/rad].
        virtual_damping: B, commanded [N·m·s/rad].
        period: T > 0 [s].
        velocity_samples: N of the velocity difference, >= 1.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    k = scalar(positive, "stiffness", stiffness)
    search = WorstSearch.of(ranges, virtual_damping, period, velocity_samples)
    least, worst = search.stiffness()
    if least <= k:
        return Verdict(False, worst, 0)
    outcome = search.proof(k)
    if outcome.suspect is not None:
        least, worst = search.stiffness(outcome.suspect)
    return Verdict(outcome.proved, worst if least <= k else None, outcome.boxes)


def guaranteed_limit(
    ranges: Ranges,
    virtual_damping: float,
    period: float,
    velocity_samples: int = 1,
    tolerance: float = 1e-3,
) -> GuaranteedLimit:
    """Return the stiffness up to which a two-sided wall is stable on every servo of a range.

    Args:
        ranges: The ranges of the servo's values.
        virtual_damping: B, commanded [N·m·s/rad].
        period: T > 0 [s].
        velocity_samples: N of the velocity difference, >= 1.
        tolerance: Wanted gap between the proved and the unstable stiffness, as a fraction between 0
            and 1. Where no proof is found this close, the gap is widened until one is.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    search = WorstSearch.of(ranges, virtual_damping, period, velocity_samples)
    return GuaranteedLimit(*closed_in(search.stiffness, search.proof, _share(tolerance)))


def guaranteed_damping_ceiling(
    ranges: Ranges, period: float, velocity_samples: int = 1, tolerance: float = 1e-3
) -> GuaranteedCeiling:
    """Return the virtual damping up to which every servo of a range is stable with some stiffness.

    Args:
        ranges: The ranges of the servo's values.
        period: T > 0 [s].
        velocity_samples: N of the velocity difference, >= 1.
        tolerance: As for ``guaranteed_limit``.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    search = WorstSearch.of(ranges, 0.0, period, velocity_samples)

    def proof(virtual_damping: float) -> Exclusion:
        return replace(search, virtual_damping=virtual_damping).proof(0.0)

    return GuaranteedCeiling(*closed_in(search.ceiling, proof, _share(tolerance)))


def cost_of_each_unknown(
    ranges: Ranges,
    nominal: Member,
    virtual_damping: float,
    period: float,
    velocity_samples: int = 1,
    tolerance: float = 1e-3,
) -> Costs:
    """Return the stiffness lost because parameters are known only as ranges.

    Args:
        ranges: The ranges of the servo's values.
        nominal: Its likely values, each within its range.
        virtual_damping: B, commanded [N·m·s/rad].
        period: T > 0 [s].
        velocity_samples: N of the velocity difference, >= 1.
        tolerance: As for ``guaranteed_limit``.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """

    def limit_of(some: Ranges) -> GuaranteedLimit:
        return guaranteed_limit(some, virtual_damping, period, velocity_samples, tolerance)

    all_unknown = limit_of(ranges)
    unknowns = []
    for field in fields(nominal):
        value = getattr(nominal, field.name)
        known_too = ranges.known(field.name, value)
        limit = all_unknown if known_too == ranges else limit_of(known_too)
        lost = _lost(all_unknown.stiffness, limit.stiffness)
        unknowns.append(UnknownCost(field.name, value, limit, lost))
    known, _ = WorstSearch.of(
        Ranges(*((value, value) for value in astuple(nominal))),
        virtual_damping,
        period,
        velocity_samples,
    ).stiffness()
    return Costs(all_unknown, known, _lost(all_unknown.stiffness, known), tuple(unknowns))


def _lost(limit: float, known: float) -> float:
    return max(1 - limit / known, 0.0) if known > 0 else 0.0


def _share(tolerance: float) -> float:
    value = scalar(number, "tolerance", tolerance)
    if not 0 < value < 1:
        raise ValueError(f"tolerance must be between 0 and 1, got {value:g}")
    return value
