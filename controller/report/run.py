"""Draws a run as PNG: panels of position and wall, torque, stiffness or velocity, timing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.file import ONE_AXIS
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.walls import walls_of
from haptic_wall.controller.report import run_panels
from haptic_wall.controller.report.run_panels import DrawnRun
from haptic_wall.controller.report.sketch import sketched
from haptic_wall.controller.report.style import RUN_STYLE, picture, titled
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.telemetry import FLAG_PROBED

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_AXES: Final = 6
"""Axes in one picture"""
Panel = Callable[["Axes", DrawnRun], None]


def plot_log(log: LogReader, path: Path, stop_reason: str | None = None) -> None:
    """Select rows of a log, or of a stretch of it, in bounded memory, and draw them as PNG.

    Args:
        log: The log, or a stretch of it.
        path: Path of the picture.
        stop_reason: Stop reason of the report; the title names a trip. None: not known.

    Raises:
        LogFormatError: There are no rows, or its metadata holds no known configuration.
        OSError: The log cannot be read, or the picture not be written.
    """
    count = log.count()
    if not count:
        raise LogFormatError(f"{log.path} holds no rows")

    def drawn(one: LogReader) -> DrawnRun:
        sketch = sketched(one.blocks(), count, log.origin_ns)
        return DrawnRun.of(sketch, walls_of(one.metadata, one.changes), one.end)

    name = log.metadata.get("name")
    name = titled(name if isinstance(name, str) else "run")
    if log.axes == ONE_AXIS:
        plot_run(drawn(log), name, path, stop_reason or "")
        return
    runs = {axis: drawn(log.axis(axis)) for axis in log.axes[:MOST_AXES]}
    shown = f"{name}: {len(log.axes)} axes"
    if len(log.axes) > MOST_AXES:
        shown += f", of which the first {MOST_AXES} are shown: `haptic-wall log LOG --axis NAME`"
    _plot_axes(runs, f"{shown}{_trip(stop_reason or '')}", path)


def _plot_axes(runs: Mapping[str, DrawnRun], title: str, path: Path) -> None:
    """Draw position and torque of each axis, one row an axis."""
    size = 11.0, 1.2 + 1.6 * len(runs)
    with picture(path, *size, RUN_STYLE) as figure:
        figure.suptitle(title, fontsize=12, ha="left", x=0.01)
        rows = figure.subplots(len(runs), 2, sharex=True, squeeze=False)
        panels = (run_panels.position, "{}\n[rad]"), (run_panels.torque, "torque [N·m]")
        for (name, run), row in zip(runs.items(), rows, strict=True):
            for ax, (panel, label) in zip(row, panels, strict=True):
                _draw(panel, ax, run)
                ax.set_ylabel(label.format(name))
        told = dict[str, Any]()
        for ax in rows.flat:
            handles, labels = ax.get_legend_handles_labels()
            told |= {
                each: one for each, one in zip(labels, handles, strict=True) if "±" not in each
            }
        figure.legend(
            [*told.values()], [*told], loc="outside lower left", ncols=4, fontsize=9, frameon=False
        )
        for ax in rows[-1]:
            ax.set_xlabel("time [s]")
        figure.align_ylabels(rows)


def _draw(panel: Panel, ax: Axes, run: DrawnRun) -> None:
    """Draw a panel over the time of its run, without a legend."""
    panel(ax, run)
    run_panels.shade_warm_up(ax, run)
    run_panels.mark_oscillation(ax, run)
    ax.grid(True, color="#e6e6e6", linewidth=0.6)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.set_xlim(run.time[0], max(run.time[-1], run.time[0] + 1e-3))


def plot_run(run: DrawnRun, name: str, path: Path, stop_reason: str) -> None:
    """Draw the selected rows of a run as PNG: panels over one time axis.

    Args:
        run: The run of one servo.
        name: Its name, for the title.
        path: Path of the picture.
        stop_reason: Of its report; empty: not known.

    Raises:
        OSError: The picture cannot be written.
    """
    panels: list[tuple[Panel, float]] = [
        (run_panels.position, 3.0),
        (run_panels.torque, 2.0),
        (run_panels.stiffness_or_velocity, 1.6),
    ]
    if run_panels.has_timing(run):
        panels.append((run_panels.timing, 2.0))
    heights = [height for _, height in panels]
    with picture(path, 11.0, 1.1 * sum(heights), RUN_STYLE) as figure:
        axes = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights)
        figure.suptitle(_title(run, name, stop_reason), fontsize=12, ha="left", x=0.01)
        for (panel, _), ax in zip(panels, axes, strict=True):
            _draw(panel, ax, run)
            handles, labels = ax.get_legend_handles_labels()
            if handles:
                ax.legend(
                    handles,
                    labels,
                    loc="upper left",
                    bbox_to_anchor=(1.0, 1.0),
                    fontsize=9,
                    frameon=False,
                )
        axes[-1].set_xlabel("time [s]")
        figure.align_ylabels(axes)


def _title(run: DrawnRun, name: str, stop_reason: str) -> str:
    wall, servo = run.config.wall, run.config.servo
    what = servo.model or f"{servo.kind} servo"
    where = f" at {titled(servo.port)}" if servo.port and servo.kind == "hardware" else ""
    if servo.kind == "emulated":
        where = ", emulated"
    unprobed = np.flatnonzero((run.rows["flags"] & FLAG_PROBED) == 0)
    last = run.rows[unprobed[-1] if unprobed.size else -1]
    parts = [
        _commanded("K", float(last["stiffness"]), wall.stiffness, "N·m/rad"),
        _commanded("B", float(last["damping"]), wall.damping, "N·m·s/rad"),
        f"delay {1000 * float(last['delay_s']):.2f} ms",
        f"{run.config.loop.rate_hz:g} Hz",
    ]
    if run.config.guard.mode == "off":
        parts.append("guard off")
    if run.config.loop.clock == "simulated":
        parts.append("simulated clock")
    if not run.on.any():
        parts = ["the wall was never on"]
    return f"{name}: {what}{where}{_trip(stop_reason)}\n" + "   ".join(parts)


def _trip(stop_reason: str) -> str:
    trip = Trip.of(stop_reason)
    return "" if trip is None else f", ENDED BY A SAFETY TRIP: {titled(trip.label)}"


def _commanded(name: str, commanded: float, requested: float, unit: str) -> str:
    as_asked = np.isclose(commanded, requested, rtol=1e-6)
    asked = "as requested" if as_asked else f"of {requested:.4g} requested"
    return f"{name} {commanded:.4g} {unit} ({asked})"
