"""Reads a recorded motion and runs the oscillation detector over it, or reads a run's verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.detector.detection import DetectionRecord, Known, detect
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.csv_recording import recording_of_csv
from haptic_wall.controller.logs.file import is_log
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.recording import Part, Recording, recording_of_log, seconds

WINDOW = 120_000
"""Samples that are analysed at once, without the overlap: it bounds the memory"""
BEFORE_S = 10.0
"""Overlap with the window before [s]: the detector needs some half-cycles of an oscillation."""


_VERDICT = ("state", "frequency_hz", "amplitude_rad", "first_alarm_s")


def read_recording(path: Path, axis: str | None = None) -> Recording:
    """Read a log, or a CSV with the columns ``time_s``, ``position_rad``, ``torque_nm``.

    Args:
        path: A file with a log's content is a log, whatever its name. Any other file is a CSV; its
            torque, the one commanded at that sample, may be missing.
        axis: Name of the axis in a log of several; None: there is only one.

    Raises:
        UserError: The file holds no usable motion; the message says what was found.
        LogFormatError: The file is not a log of this program.
        OSError: It cannot be read, or is no regular file.
    """
    if is_log(path):
        return recording_of_log(path, axis)
    if axis is not None:
        raise UserError(f"found {axis}", field="--axis", wanted="none: a CSV has no axes")
    return recording_of_csv(path)


def detect_all(
    recording: Recording,
    given: Mapping[str, float | None],
    *,
    stiffness: float = math.nan,
    virtual_damping: float = 0.0,
) -> tuple[list[DetectionRecord], dict[str, float]]:
    """Run the detector over a recording.

    Args:
        recording: The motion, of one part or more.
        given: ``inertia``, ``damping``, ``coulomb``, ``lag`` in place of the recording's values;
            None: use its own.
        stiffness: Of the wall, where its torque is not recorded [N·m/rad]; NaN: not known.
        virtual_damping: The same [N·m·s/rad].

    Returns:
        The results of each part, and the servo parameters that were used; NaN: not known.
    """
    known = {
        name: float(getattr(recording, name) if value is None else value)
        for name, value in given.items()
    }
    if not math.isnan(known["inertia"]) and math.isnan(known["lag"]):
        known["lag"] = 0.0
    settings = Known(
        recording.period,
        known["inertia"],
        recording.position_step,
        known["lag"],
        stiffness,
        virtual_damping,
    )
    return [_seen(part, settings) for part in recording.parts], known


def _seen(part: Part, settings: Known) -> DetectionRecord:
    """Return the detector's result at every sample of a part, found window by window."""
    records = []
    for start in range(0, part.times.size, WINDOW):
        since = int(np.searchsorted(part.times, part.times[start] - BEFORE_S))
        since = max(since, start - WINDOW)
        some = part.sliced(slice(since, start + WINDOW))
        found = detect(some.times, some.positions, some.torques, settings)
        records.append(DetectionRecord._make(column[start - since :] for column in found))
    return DetectionRecord.joined(records)


def verdict_of(log: LogReader) -> Mapping[str, Any] | None:
    """Return ``oscillation`` of the run's report: the worst that its watch saw; None: unknown.

    The names are ``state``, ``frequency_hz``, ``amplitude_rad``, ``first_alarm_s``.
    """
    told = (log.end or {}).get("oscillation")
    found = {name: told.get(name) for name in _VERDICT} if isinstance(told, dict) else {}
    state, *numbers = found.values() or (None,)
    is_known = state in [each.name.lower() for each in State]
    is_known &= all(isinstance(number, float | None) for number in numbers)
    return found if is_known else None


def text(report: Mapping[str, Any]) -> str:
    """Format the result of ``haptic-wall detect``."""

    def known(name: str, unit: str) -> str:
        value = report[name]
        return f"{value:.4g} {unit}" if value is not None and math.isfinite(value) else "none"

    alarm, period = report["first_alarm_s"], report["period_s"]
    lines = [
        f"state       {report['state']}",
        f"frequency   {known('frequency_hz', 'Hz')}",
        f"amplitude   {known('amplitude_rad', 'rad')}",
        f"alarm       {'none' if alarm is None else f'first after {seconds(alarm)} s'}",
    ]
    if period is not None:
        lines += [
            f"growth      {known('growth_per_s', '1/s')}",
            f"record      {report['samples']} samples, one each {1e3 * period:.4g} ms",
        ]
    lines += [f"note        {note}" for note in report["notes"]]
    if report["plot"] is not None:
        lines.append(f"picture     {report['plot']}")
    return "\n".join(lines)
