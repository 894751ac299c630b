"""The result of one point of a sweep, the reason where it has no figure, and both as text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from haptic_wall.controller.experiments.linear_loop import LinearLoop
from haptic_wall.controller.experiments.sweep.plan import Reach


@dataclass(slots=True)
class PointResult:
    """One measured point; None for unknown values."""

    virtual_damping: float
    delay_steps: int
    delay_s: float
    """Total: inserted, the device's own as believed, and the measured age of the samples"""
    exact: float
    """Without friction, for the believed servo [N·m/rad]; 0: nothing is stable"""
    linear: float
    kick_rad: float | None
    """Amplitude at which growth is zero"""
    measured: float | None = None
    """[N·m/rad]"""
    uncertainty: float | None = None
    """Standard error [N·m/rad]"""
    frequency_hz: float | None = None
    predicted_with_friction: float | None = None
    """Stiffness that sustains the kick's amplitude, with the believed friction and backlash
    [N·m/rad]; with a load or a filter without the backlash"""
    trials: int = 0
    disturbed: int = 0
    """Further trials in which too much was lost to tell growth from decay"""
    reason: str | None = None
    """Why there is no figure, or a remark"""
    trips: list[str] = field(default_factory=list)
    logs: list[str] = field(default_factory=list)


def unstable_text(loop: LinearLoop, virtual_damping: float, delay: float) -> str:
    """Explain why no trial is made where no stiffness is stable in theory."""
    ceiling = loop.ceiling(delay)
    why = (
        f"is above the ceiling {ceiling:.4g} N·m·s/rad at this delay"
        if virtual_damping >= ceiling
        else f"cancels all of the servo's own {loop.damping:g} N·m·s/rad"
    )
    return f"virtual damping {virtual_damping:g} {why}: no stiffness is stable; nothing was tried"


def out_of_reach_text(edge: Reach, seen: str) -> str:
    """Name the limit that prevents a measurement: torque or speed."""
    return (
        f"{edge.bound_by} allows only up to {edge.top:.4g} N·m/rad for a kick of {edge.kick:.4g}"
        f" rad, the limit is expected at {edge.predicted:.4g} N·m/rad; {seen}: use a smaller --kick"
        f" or raise {edge.bound_by}"
    )


def bracket_text(low: float, high: float, *, mixed: bool) -> str:
    """Explain a figure that comes from the nearest outcomes alone.

    Args:
        low: Where motion died [N·m/rad].
        high: Where it grew; with mixed outcomes the stiffest at which it died [N·m/rad].
        mixed: In between some motions grew and some died.
    """
    found = (
        f"between {low:.4g} and {high:.4g} some motions grew and some died"
        if mixed
        else f"between {low:.4g}, where motion died, and {high:.4g}, where it grew"
    )
    return f"{found}: too few undisturbed half-cycles to fit the growth, as with much friction"


def nothing_text(
    edge: Reach, died: Sequence[float], grew: Sequence[float], cap: float, found: PointResult
) -> str:
    """Explain why trials gave no figure.

    Args:
        edge: The limits.
        died: Stiffnesses at which motion decayed [N·m/rad].
        grew: Stiffnesses at which it grew.
        cap: Below the softest that tripped.
        found: Has the trips, and the number of disturbed trials.
    """
    if died and not grew and cap < edge.top:
        text = f"did not grow below the stiffness that tripped: {'; '.join(found.trips)}"
    elif died and not grew:
        text = out_of_reach_text(edge, f"motion still died at {max(died):.4g} N·m/rad")
    elif grew and not died:
        text = (
            f"motion grew at every stiffness down to {min(grew):.4g} N·m/rad: the belief (model.*)"
            " is far from this servo, or a load or a hand moves it"
        )
    elif not died:
        text = "no trial was recorded to its end"
    else:
        text = "too few undisturbed half-cycles to separate growth from decay"
    if found.disturbed:
        text += (
            f"; {found.disturbed} trials lost too many readings or periods: end other programs on"
            " this machine, or see haptic-wall doctor"
        )
    return text


def _cell(value: float | None, digits: int = 4) -> str:
    """Format a number for a table; a dash: it is not known."""
    return "-" if value is None else f"{value:.{digits}g}"


def point_text(point: PointResult) -> str:
    """Return a point in one line."""
    where = f"B {point.virtual_damping:g}, {point.delay_steps} steps"
    if point.measured is None:
        return f"{where}: {point.reason}"
    at = "" if point.frequency_hz is None else f" at {point.frequency_hz:.3g} Hz"
    return (
        f"{where}: {point.measured:.4g} ± {point.uncertainty:.2g} N·m/rad"
        f" (exact {point.exact:.4g}){at}"
    )


def sweep_text(points: list[PointResult]) -> list[str]:
    """Return a table of the points, with what kept some from being measured."""
    lines = [
        f"{'B':>9} {'delay':>8} {'measured':>10} {'±':>8} {'exact':>9} {'linear':>9}"
        f" {'friction':>9} {'f':>7} {'kick':>8}",
        f"{'N·m·s/rad':>9} {'ms':>8} {'N·m/rad':>10} {'':>8} {'':>9} {'':>9} {'':>9} {'Hz':>7}"
        f" {'rad':>8}",
    ]
    for point in points:
        lines.append(
            f"{point.virtual_damping:>9.4g} {1e3 * point.delay_s:>8.3f} {_cell(point.measured):>10}"
            f" {_cell(point.uncertainty, 2):>8} {_cell(point.exact):>9} {_cell(point.linear):>9}"
            f" {_cell(point.predicted_with_friction):>9} {_cell(point.frequency_hz, 3):>7}"
            f" {_cell(point.kick_rad, 3):>8}"
        )
        if point.reason is not None:
            lines.append(f"{'':>9} {point.reason}")
        elif point.trips:
            lines.append(f"{'':>9} trips in between: {'; '.join(point.trips)}")
    return lines
