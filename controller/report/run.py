"""Draws a run as PNG: panels of position and wall, torque, stiffness or velocity, timing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.logs.file import ONE_AXIS
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.walls import walls_of
from haptic_wall.controller.report import run_panels
from haptic_wall.controller.report.sketch import Sketch, sketched
from haptic_wall.controller.report.style import RUN_STYLE, picture, titled
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_PROBED, FLAG_WARM_UP

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_AXES: Final = 6
"""Axes in one picture"""


def plot_log(log: LogReader, path: Path, stop_reason: str | None = None) -> None:
    """Select rows of a log, or of a stretch of it, in bounded memory, and draw them as PNG.

    Args:
        log: The log, or a stretch of it.
        path: Path of the picture.
        stop_reason: As for ``plot_run``.

    Raises:
        LogFormatError: As ``plot_run``; or there are no rows.
        OSError: The log cannot be read, or the picture not be written.
    """
    count = log.count()
    if not count:
        raise LogFormatError(f"{log.path} holds no rows")
    if log.axes == ONE_AXIS:
        sketch = sketched(log.blocks(), count, log.origin_ns)
        plot_run(sketch, log.metadata, path, stop_reason, log.changes, log.end)
        return
    runs = {}
    for name in log.axes[:MOST_AXES]:
        one = log.axis(name)
        sketch = sketched(one.blocks(), count, log.origin_ns)
        runs[name] = _drawn(sketch, one.metadata, one.changes, one.end)
    shown = f"{_name(log.metadata)}: {len(log.axes)} axes"
    if len(log.axes) > MOST_AXES:
        shown += f", of which the first {MOST_AXES} are shown: `haptic-wall log LOG --axis NAME`"
    _plot_axes(runs, f"{shown}{_trip(stop_reason or '')}", path)


def _plot_axes(runs: Mapping[str, run_panels.DrawnRun], title: str, path: Path) -> None:
    """Draw position and torque of each axis, one row an axis."""
    size = 11.0, 1.2 + 1.6 * len(runs)
    with picture(path, *size, RUN_STYLE) as figure:
        figure.suptitle(titled(title), fontsize=12, ha="left", x=0.01)
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


def _draw(
    panel: Callable[[Axes, run_panels.DrawnRun], None], ax: Axes, run: run_panels.DrawnRun
) -> None:
    """Draw a panel over the time of its run, without a legend."""
    panel(ax, run)
    run_panels.shade_warm_up(ax, run)
    run_panels.mark_oscillation(ax, run)
    ax.grid(True, color="#e6e6e6", linewidth=0.6)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.set_xlim(run.time[0], max(run.time[-1], run.time[0] + 1e-3))


def plot_run(
    sketch: Sketch,
    metadata: Mapping[str, Any],
    path: Path,
    stop_reason: str | None = None,
    changes: Sequence[Mapping[str, Any]] = (),
    report: Mapping[str, Any] | None = None,
) -> None:
    """Draw the selected rows of a run as PNG: panels over one time axis.

    Args:
        sketch: The selected rows of the run, see ``sketched``.
        metadata: Metadata of the log: its ``config``, and its ``name`` for the title.
        path: Path of the picture.
        stop_reason: Stop reason of the report; the title names a trip. None: not known.
        changes: Changes of the running wall, from the log.
        report: The report in the log, for the servo's torque limit; None: there is none.

    Raises:
        LogFormatError: The metadata holds no known configuration.
        OSError: The picture cannot be written.
    """
    run = _drawn(sketch, metadata, changes, report)
    panels: list[tuple[Callable[[Axes, run_panels.DrawnRun], None], float]] = [
        (run_panels.position, 3.0),
        (run_panels.torque, 2.0),
        (run_panels.stiffness_or_velocity, 1.6),
    ]
    if run_panels.has_timing(run):
        panels.append((run_panels.timing, 2.0))
    heights = [height for _, height in panels]
    with picture(path, 11.0, 1.1 * sum(heights), RUN_STYLE) as figure:
        axes = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights)
        title = _title(run, _name(metadata), stop_reason or "")
        figure.suptitle(title, fontsize=12, ha="left", x=0.01)
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


def _drawn(
    sketch: Sketch,
    metadata: Mapping[str, Any],
    changes: Sequence[Mapping[str, Any]],
    report: Mapping[str, Any] | None,
) -> run_panels.DrawnRun:
    on = (sketch.rows["flags"] & (FLAG_WARM_UP | FLAG_OFF)) == 0
    facts = (report or {}).get("servo")
    limit = facts.get("torque_limit") if isinstance(facts, dict) else None
    return run_panels.DrawnRun(sketch, on, walls_of(metadata, changes), limit)


def _title(run: run_panels.DrawnRun, name: str, stop_reason: str) -> str:
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
    return f"{titled(name)}: {what}{where}{_trip(stop_reason)}\n" + "   ".join(parts)


def _name(metadata: Mapping[str, Any]) -> str:
    name = metadata.get("name")
    return name if isinstance(name, str) else "run"


def _trip(stop_reason: str) -> str:
    trip = Trip.of(stop_reason)
    return "" if trip is None else f", ENDED BY A SAFETY TRIP: {titled(trip.label)}"


def _commanded(name: str, commanded: float, requested: float, unit: str) -> str:
    as_asked = np.isclose(commanded, requested, rtol=1e-6)
    asked = "as requested" if as_asked else f"of {requested:.4g} requested"
    return f"{name} {commanded:.4g} {unit} ({asked})"
