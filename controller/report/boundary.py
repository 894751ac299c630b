"""Draws the K-B plane of a wall, the field's Z-width plot: the limits over virtual damping."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_wall.controller.guard.boundary import Curve, Question, WallSide, curve
from haptic_wall.controller.guard.decision_report import filter_report
from haptic_wall.controller.guard.limits import BY_NAME
from haptic_wall.controller.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHARES = np.append(np.linspace(1e-3, 1 - 1e-3, 160), 1 - 1e-6)
"""Points of a curve, as fractions of the range without its very ends, where all limits are 0."""
_FAR = 10.0
"""Multiple of the highest exact limit above which another limit is not drawn"""
_ONE_SIDED_FILL, _ALLOWED_FILL = "#dcebdf", "#9cc7a5"
_LOOKS = {
    "linear": (style.GREY, "--"),
    "exact": (style.BLUE, "-"),
    "one_sided": (style.GREEN, "-"),
    "quantisation": ("#a5004f", ":"),
    "passive": (style.ORANGE, "-"),
    "backlash": ("#7a4b00", "-."),
    "flexible": ("#5a3fa0", "--"),
}


def plot_boundary(question: Question, found: Mapping[str, Any], path: Path) -> None:
    """Draw the limits over the virtual damping, with the oscillation's frequency below.

    Args:
        question: The servo and its loop.
        found: Its ``report``: the peak, and the marked points.
        path: Path of the PNG.

    Raises:
        OSError: The file cannot be written.
    """
    top = found["max_virtual_damping"]
    plants = question.plants(1)
    lowest = 0.0 if question.load else -float((plants.damping / plants.gain)[0])
    root, square = style.ROOTS
    low, high = root(np.array([lowest, top]))
    across = curve(question, square(low + (high - low) * _SHARES))
    with style.picture(path, style.PAGE, 4.6) as figure:
        ax, below = figure.subplots(2, 1, sharex=True, height_ratios=[3.4, 1.0])
        _plane(ax, across, question.side)
        _marks(ax, question, found)
        peak = found["peak"]["stiffness"]
        ax.set_xlim(min(1.02 * lowest, -0.01 * top), 1.02 * top)
        ax.set_ylim(0.0, 1.25 * peak)
        ax.set_xscale("function", functions=style.ROOTS)
        ax.set_yscale("function", functions=style.ROOTS)
        ax.set_ylabel(f"{style.STIFFNESS}, square-root scale")
        ax.set_title(_title(question), fontsize=8.5, loc="left")
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
        stable = across.frequency > 0
        below.plot(across.virtual_damping[stable], across.frequency[stable], color=style.INK)
        below.set_ylim(bottom=0.0)
        below.set_ylabel("oscillation at\nthe exact limit [Hz]")
        below.set_xlabel(f"{style.VIRTUAL_DAMPING}, square-root scale")
        for each in (ax, below):
            style.grid(each)


def _plane(ax: Axes, across: Curve, side: WallSide) -> None:
    """Draw the limits as curves, and shade the stable area, and the area below all limits."""
    damping, limits = across.virtual_damping, across.limits
    exact = np.minimum(limits["exact"], limits.get("flexible", np.inf))
    ax.fill_between(damping, 0.0, exact, color=style.FAINT, linewidth=0, label="stable, two-sided")
    if "one_sided" in limits:
        ax.fill_between(
            damping,
            0.0,
            np.minimum(limits["one_sided"], exact),
            color=_ONE_SIDED_FILL,
            linewidth=0,
            label="stable, one-sided too",
        )
    allowed = across.smallest(side)
    ax.fill_between(
        damping, 0.0, allowed, color=_ALLOWED_FILL, linewidth=0, label="below the guard's limits"
    )
    passive = {} if np.isnan(across.passive).any() else {"passive": across.passive}
    most = _FAR * float(np.max(exact))
    for name, values in {**limits, **passive}.items():
        color, line = _LOOKS.get(name, (style.INK, ":"))
        where = np.flatnonzero(values > 0)
        if where.size:
            shown = slice(max(where[0] - 1, 0), where[-1] + 2)
            within = np.where(values <= most, values, np.nan)[shown]
            ax.plot(damping[shown], within, line, color=color, label=BY_NAME[name].label)


def _marks(ax: Axes, question: Question, found: Mapping[str, Any]) -> None:
    """Mark the peak, and the requested points, at their smallest limit."""
    peak = found["peak"]
    ax.plot(
        peak["virtual_damping"],
        peak["stiffness"],
        "*",
        color=style.BLUE,
        markersize=9,
        label=f"peak: {_digits(peak['stiffness'])} at {_digits(peak['virtual_damping'])}",
    )
    points = curve(question, [point["virtual_damping"] for point in found["points"]])
    ax.plot(
        points.virtual_damping,
        points.smallest(question.side),
        "o",
        color=style.INK,
        markersize=3.5,
        clip_on=False,
        label=f"smallest limit, {'one' if question.side == 'one' else 'two'}-sided",
    )


def _title(question: Question) -> str:
    p = question.plants(1)
    period = question.situation.period
    delay = float(p.delay[0])
    load = question.load
    behind = (
        f"\nload {load.inertia:.4g} kg·m² behind {load.stiffness:.4g} N·m/rad with"
        f" {load.damping:.4g} N·m·s/rad, encoder on the {load.encoder}"
        if load
        else ""
    )
    if filtered := filter_report(question.velocity_filter, period):
        behind += f",  velocity through a {filtered['kind']} at {filtered['frequency_hz']:.4g} Hz"
    return (
        f"$m$ = {float(p.inertia[0]):.4g} kg·m²,  $b$ = {float(p.damping[0]):.4g} N·m·s/rad,  "
        f"$T$ = {1e3 * period:.4g} ms,  $t_d$ = {1e3 * delay:.4g} ms ({delay / period:.3g} $T$)"
        f"{behind}"
    )


def _digits(value: float) -> str:
    """Format three digits, without an exponent."""
    return f"{float(f'{value:.3g}'):g}"
