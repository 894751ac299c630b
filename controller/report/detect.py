"""Draws the result of ``haptic-wall detect``: the motion, the detector's state, the frequency."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from haptic_wall.controller.detector.detection import DetectionRecord
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.logs.recording import Part
from haptic_wall.controller.report.style import BLUE, GREY, INK, ORANGE, PAGE, grid, picture, shade

_SHADES = {State.DECAYING: "#e3efe4", State.SUSTAINED: "#fbe3c8", State.GROWING: "#f6c6c0"}
MOST_PARTS = 200
FEW = 5
"""Samples with an oscillation below which they are dots"""


def plot_detection(parts: Sequence[Part], found: Sequence[DetectionRecord], path: Path) -> None:
    """Draw position and amplitude over the detector's state, and the frequency below.

    Of very many parts, the first are drawn.

    Raises:
        OSError: The file cannot be written.
    """
    with picture(path, PAGE, 4.4) as figure:
        motion, pace = figure.subplots(2, 1, sharex=True, height_ratios=[2.6, 1.0])
        drawn = list(zip(parts, found, strict=True))[:MOST_PARTS]
        states = {each for _, record in drawn for each in np.unique(record.state).tolist()}
        any_seen = any(np.any(record.amplitude > 0.0) for _, record in drawn)
        for number, (part, record) in enumerate(drawn):
            first = number == 0
            label = "position" if first else None
            motion.plot(part.times, part.positions, color=INK, lw=0.7, label=label)
            seen = record.amplitude > 0.0
            size = np.where(seen, record.amplitude, np.nan)
            middle = float(np.nanmean(part.positions))
            # a run that ends at the alarm has one such sample
            dot: dict[str, Any] = {"marker": "o", "markersize": 3.0} if np.sum(seen) < FEW else {}
            for sign in (1.0, -1.0):
                label = "amplitude" if first and sign > 0 and any_seen else None
                at = middle + sign * size
                motion.plot(part.times, at, color=ORANGE, lw=0.9, label=label, **dot)
            for state, color in _SHADES.items():
                label = state.name.lower() if first and state in states else None
                shade(motion, part.times, record.state == state, color=color, label=label)
            pace.plot(part.times, record.frequency_hz, color=BLUE, lw=0.9, **dot)
        alarms = [record.first_alarm_s for record in found if np.isfinite(record.first_alarm_s)]
        if alarms:
            motion.axvline(alarms[0], color=GREY, lw=0.9, ls="--", label="first alarm")
        motion.set_ylabel("position [rad]")
        motion.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
        pace.set_ylabel("frequency [Hz]")
        pace.set_ylim(bottom=0.0)
        pace.set_xlabel("time [s]")
        for each in (motion, pace):
            grid(each)
