"""Draws the panels of a run's picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.logs.walls import Walls
from haptic_wall.controller.report.sketch import TIMES, Floats, Sketch
from haptic_wall.controller.report.style import shade
from haptic_wall.controller.runtime.telemetry import (
    FLAG_ALARM,
    FLAG_CONTACT,
    FLAG_OFF,
    FLAG_PROBED,
    FLAG_SATURATED,
    FLAG_WARM_UP,
)
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.servo import Outcome

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_INK, _WALL, _CONTACT, _WARM_UP = "#1f3b57", "#b5652b", "#fbeadb", "#ececec"
_SENT, _ASKED, _ALARM = "#1b7f79", "#9aa5ad", "#c0272d"
_LOST = "#7a6a8f"
_PROBE = "#d9d2ea"
SIDES: tuple[Side, ...] = ("above", "below")
_SMOOTH_S = 0.02
"""Averaging time of the additional smooth velocity [s]: one encoder count within a sample is a
spike that hides the motion."""
_LEAST_US = 1.0
"""Lower end of the logarithmic time axis [µs]; shorter times are drawn at it."""
_SHOWN = 3.0
"""Largest multiple of the commanded stiffness at which the requested one is drawn"""


@dataclass(frozen=True, slots=True)
class DrawnRun:
    """The data of the panels."""

    sketch: Sketch
    on: NDArray[np.bool_]
    """Whether the wall is on: false in the warm-up and while the wall is off"""
    walls: Walls
    torque_limit: float | None
    """Torque limit of the servo, by the report of the run [N·m]; None: unknown"""

    @classmethod
    def of(cls, sketch: Sketch, walls: Walls, report: Mapping[str, Any] | None) -> DrawnRun:
        """Return the data of a run whose log has this report; None: it has none."""
        on = (sketch.rows["flags"] & (FLAG_WARM_UP | FLAG_OFF)) == 0
        facts = (report or {}).get("servo")
        limit = facts.get("torque_limit") if isinstance(facts, dict) else None
        return cls(sketch, on, walls, limit)

    @property
    def config(self) -> Config:
        """Return the configuration at the last row."""
        return self.walls.at(int(self.rows["seq"][-1]))

    def parts(self) -> Iterator[tuple[Config, slice]]:
        """Yield each configuration of the drawn rows, with its rows."""
        seq = self.rows["seq"]
        edges = np.searchsorted(seq, [*self.walls.since, int(seq[-1]) + 1]).tolist()
        for config, start, end in zip(self.walls.configs, edges[:-1], edges[1:], strict=True):
            if end > start:
                yield config, slice(start, end)

    def surface(self, config: Config) -> float:
        """Return the position of a wall's surface [rad]; NaN if it is unknown."""
        position: FloatArray = self.rows["position"]
        known = position[np.isfinite(position)]
        begins = self.rows["seq"][0] == 0 and known.size
        return config.surface(float(known[0]) if begins else math.nan)

    def filled(self, config: Config, side: Side) -> float:
        """Return from where a wall fills a side [rad]; NaN if it does not, or it is unknown."""
        wall = config.wall
        if wall.law == "stops":
            end = wall.high if side == "above" else wall.low
            return self.surface(config) + (math.nan if end is None else end)
        return self.surface(config) if wall.acting_side == side else math.nan

    def over_time(self, value: Callable[[Config], float]) -> tuple[Floats, Floats]:
        """Return a value of the configurations over time [s], in steps."""
        last = len(self.time) - 1
        steps = [
            ((self.time[rows.start], self.time[min(rows.stop, last)]), value(config))
            for config, rows in self.parts()
        ]
        return np.array([each for each, _ in steps]).ravel(), np.repeat([v for _, v in steps], 2)

    @property
    def rows(self) -> NDArray[np.void]:
        """Return the drawn rows."""
        return self.sketch.rows

    @property
    def time(self) -> Floats:
        """Return the time of each row [s]."""
        return self.sketch.time


def position(ax: Axes, run: DrawnRun) -> None:
    """Draw the shaft's position and the wall."""
    _line(ax, run.time, run.rows["position"], _INK, "position", 1.3)
    lost = run.time[run.rows["outcome"] != Outcome.OK]
    if lost.size:
        look: dict[str, Any] = {"color": _LOST, "markersize": 6, "markeredgewidth": 0.6}
        heights = np.full(lost.size, 0.02)
        ax.plot(
            lost, heights, "|", transform=ax.get_xaxis_transform(), label="lost readings", **look
        )
    ax.set_ylabel("position [rad]")
    if np.isnan(run.over_time(run.surface)[1]).all():
        return
    laws = {config.wall.law for config, _ in run.parts()}
    if laws != {"stops"}:
        times, zeros = run.over_time(
            lambda config: math.nan if config.wall.law == "stops" else run.surface(config)
        )
        label = "wall's surface" if laws <= {"wall", "stops"} else "wall.position"
        ax.plot(times, zeros, color=_WALL, linewidth=1.2, label=label)
    sides = {side: run.over_time(partial(run.filled, side=side)) for side in SIDES}
    if "stops" in laws:
        ax.plot(*sides["above"], color=_WALL, linewidth=1.2, label="wall.high")
        ax.plot(*sides["below"], color=_WALL, linewidth=1.2, label="wall.low")
    low, high = ax.get_ylim()
    margin = 0.12 * (high - low)
    for side, (times, filled) in sides.items():
        if np.isnan(filled).all():  # a two-sided wall is always in contact: nothing to shade
            continue
        if side == "above":
            end = high = max(high, float(np.nanmax(filled)) + margin)
        else:
            end = low = min(low, float(np.nanmin(filled)) - margin)
        ax.fill_between(
            times,
            filled,
            end,
            facecolor="none",
            edgecolor=_WALL,
            hatch="//",
            alpha=0.35,
            linewidth=0,
            label=f"wall (fills {side})",
        )
    _shade_contact(ax, run)
    ax.set_ylim(low, high)


def torque(ax: Axes, run: DrawnRun) -> None:
    """Draw the wall's torque, the sent torque and the torque limit."""
    rows = run.rows
    _line(ax, run.time, rows["wall_torque"], "#c9d0d5", "wall (before delay and limit)", 3.5)
    _line(ax, run.time, rows["torque"], _SENT, "sent", 1.2)
    ax.set_ylabel("torque [N·m]")
    _shade_contact(ax, run)
    saturated = (rows["flags"] & FLAG_SATURATED) != 0
    limit = _torque_limit(run, saturated)
    if limit is not None:
        torque: FloatArray = rows["torque"]
        largest = float(np.nanmax(np.abs(torque)))
        if largest > 0.4 * limit:
            for sign in (-1, 1):
                if np.any(sign * torque > 0.4 * limit):
                    ax.axhline(sign * limit, color=_ALARM, linestyle="--", linewidth=1.0)
            ax.plot([], [], "--", color=_ALARM, label=f"limit ±{limit:.3g} N·m")
        else:
            ax.plot([], [], " ", label=f"(limit ±{limit:.3g} N·m: off the scale)")
    _shade(ax, run.time, saturated, "#f7d4d5", "cut by the limit")


def _torque_limit(run: DrawnRun, saturated: NDArray[np.bool_]) -> float | None:
    """Return the torque limit that the log shows, or the servo's [N·m]; None if unknown."""
    if saturated.any():
        torque: FloatArray = run.rows["torque"][saturated]
        return float(np.abs(torque).max())
    known = run.torque_limit, run.config.wall.torque_clip
    return min((torque for torque in known if torque is not None), default=None)


def stiffness_or_velocity(ax: Axes, run: DrawnRun) -> None:
    """Draw the commanded stiffness if it changed during the run, else the velocity."""
    stiffness = run.rows["stiffness"][run.on]
    if len(stiffness) and np.ptp(stiffness) > 1e-3 * stiffness.max():
        ax.plot(
            run.time[run.on], stiffness, label="commanded K", drawstyle="steps-post", color=_INK
        )
        most = float(stiffness.max())
        times, requested = run.over_time(lambda config: config.wall.stiffness)
        shown = requested <= _SHOWN * most
        if shown.any():
            drawn = np.where(shown, requested, math.nan)
            ax.plot(times, drawn, color=_ASKED, linestyle="--", linewidth=1, label="requested K")
            most = max(most, float(requested[shown].max()))
        if not shown.all():
            ax.plot([], [], " ", label=f"(requested K {requested.max():.4g}: off the scale)")
        ax.set_ylim(0, 1.15 * most)
        ax.set_ylabel("stiffness\n[N·m/rad]")
        return
    velocity, sketch = run.rows["velocity"], run.sketch
    _line(ax, run.time, velocity, "#cfd6db", "estimated, every tick", 0.6)
    if sketch.mean_time.size:
        over_s = (run.time[-1] - run.time[0]) / sketch.mean_time.size
        means = (sketch.mean_time, sketch.mean_velocity)
    else:
        samples = max(1, min(round(_SMOOTH_S / run.config.period_s), len(velocity)))
        smooth = np.convolve(np.nan_to_num(velocity), np.full(samples, 1.0 / samples), mode="same")
        over_s, means = _SMOOTH_S, (run.time, smooth)
    _line(ax, *means, _INK, f"its mean over {1e3 * over_s:.3g} ms", 1.2)
    ax.set_ylabel("velocity [rad/s]")


def has_timing(run: DrawnRun) -> bool:
    """Whether the log has timing data; on the simulated clock all times are zero."""
    rows = run.rows
    return any(bool((rows[field] > 0).any()) for field in (*TIMES, "missed"))


def timing(ax: Axes, run: DrawnRun) -> None:
    """Draw lateness, work and waiting time of each tick, a line at one period, and missed ticks."""
    rows = run.rows
    ax.set_yscale("log")
    for field, color, label in (
        ("bus_ns", _WALL, "waiting for the bus"),
        ("work_ns", _SENT, "work"),
        ("lateness_ns", _INK, "lateness"),
    ):
        times = rows[field] * 1e-3
        if (times > 0).any():
            ax.plot(
                run.time,
                np.maximum(times, _LEAST_US),
                ".",
                markersize=1.6,
                color=color,
            )
            # A separate dot for the legend, large enough to see.
            ax.plot([], [], ".", color=color, label=label)
    period_us = 1e-3 * run.config.period_ns
    missed = np.flatnonzero(rows["missed"] > 0)
    ax.axhline(
        period_us, color=_ALARM, linewidth=0.8, linestyle=":", label=f"period {period_us:g} µs"
    )
    ax.set_ylim(_LEAST_US, max(3 * period_us, 2e-3 * float(rows["lateness_ns"].max())))
    if len(missed):
        ax.plot(
            run.time[missed],
            np.full(len(missed), 1.6 * period_us),
            "v",
            color=_ALARM,
            markersize=5,
            label="missed ticks",
        )
    ax.set_ylabel("time per tick [µs]")


def _shade_contact(ax: Axes, run: DrawnRun) -> None:
    """Shade the contacts with a one-sided wall; a two-sided wall always acts."""
    contact = ((run.rows["flags"] & FLAG_CONTACT) != 0) & run.on
    for config, rows in run.parts():
        if config.wall.acting_side == "both" and config.wall.law != "stops":
            contact[rows] = False
    _shade(ax, run.time, contact, _CONTACT, "in contact" if _is_first(ax) else "")


def shade_warm_up(ax: Axes, run: DrawnRun) -> None:
    """Shade the warm-up, and the time in which the wall is off."""
    label = "warm-up: the wall is off" if _is_first(ax) else ""
    warm_up = (run.rows["flags"] & FLAG_WARM_UP) != 0
    _shade(ax, run.time, warm_up, _WARM_UP, label)
    label = "the wall is off: released, or loaded" if _is_first(ax) else ""
    _shade(ax, run.time, ~run.on & ~warm_up, _WARM_UP, label)


def mark_oscillation(ax: Axes, run: DrawnRun) -> None:
    """Shade the probes of the wall, and draw a line at the first alarm."""
    flags = run.rows["flags"]
    label = "probe for an oscillation" if _is_first(ax) else ""
    _shade(ax, run.time, (flags & FLAG_PROBED) != 0, _PROBE, label)
    alarms = np.flatnonzero(flags & FLAG_ALARM)
    if alarms.size:
        label = "first alarm: oscillation" if _is_first(ax) else "_"
        ax.axvline(run.time[alarms[0]], color=_ALARM, linewidth=0.9, linestyle="--", label=label)


def _is_first(ax: Axes) -> bool:
    """Whether this is the first panel: only its legend explains the shades."""
    return ax is ax.figure.axes[0]


def _shade(ax: Axes, time: Floats, where: NDArray[np.bool_], color: str, label: str) -> None:
    """Shade the times at which ``where`` is true."""
    if not where.any():
        return
    shade(ax, time, where, color=color, zorder=0, label=label or "_")


def _line(ax: Axes, time: Floats, values: Floats, color: str, label: str, width: float) -> None:
    ax.plot(time, values, color=color, linewidth=width, label=label)
