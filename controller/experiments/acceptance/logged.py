"""Reads from the logs of an acceptance what its steps do not measure: noise, current, replies."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.errors import LogFormatError
from haptic_wall.controller.experiments.holding import torque_limit_of, without_hand
from haptic_wall.controller.experiments.testbed import Testbed, recorded
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.logs.file import SUFFIX
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.servo import Outcome

REST_S = 3.0
_SPEEDS = (0.0, 1.0, 2.0, 3.0, 4.0)
"""Ends of the ranges of speed [rad/s]"""
_TORQUE = 0.05
"""Least torque of which a share is computed, over the torque limit"""
_LEAST_ROWS = 50


def measure_rest(config: Config, folder: Path, tell: Callable[[str], None]) -> dict[str, Any]:
    """Watch the encoder for some seconds with torque on and zero torque; nothing moves.

    Returns:
        ``rows``, ``counts_apart``, ``rms_counts`` (null without an encoder) and ``changes``.
    """
    rows = Testbed(without_hand(config), folder, tell).play("rest", [Phase(REST_S)]).rows
    good = rows[rows["outcome"] == Outcome.OK]
    position, step = good["position"], config.servo.position_step
    moved = float(np.ptp(position)) if len(good) else 0.0
    rms = float(np.std(position)) if len(good) else 0.0
    return {
        "rows": len(good),
        "counts_apart": moved / step if step else None,
        "rms_counts": rms / step if step else None,
        "changes": int(np.count_nonzero(np.diff(position))),
    }


def from_logs(config: Config, folder: Path) -> dict[str, Any]:
    """Return current over speed and the times of the bus, from all logs of a folder.

    Returns:
        ``current``: the share of the commanded torque that the servo measured, over the speed;
        ``bus``: cycles, losses and times with torque on, in µs.
    """
    rows = [*_rows(folder)]
    if not rows:
        return {"current": [], "bus": None}
    together = np.concatenate(rows)
    age, waited = together["age_ns"] * 1e-3, together["bus_ns"] * 1e-3
    outcomes = together["outcome"]
    return {
        "current": _current(config, together),
        "bus": {
            "cycles": len(together),
            "lost": int(np.count_nonzero(outcomes == Outcome.LOST)),
            "corrupt": int(np.count_nonzero(outcomes == Outcome.CORRUPT)),
            "missed_ticks": int(together["missed"].sum()),
            "sample_age_us": _percentiles(age),
            "bus_us": _percentiles(waited),
        },
    }


def _rows(folder: Path) -> Iterator[NDArray[np.void]]:
    for log in sorted(folder.rglob(f"*{SUFFIX}")):
        try:
            rows = recorded(log)
        except (LogFormatError, OSError):
            continue
        if rows.size:
            yield rows


def _current(config: Config, rows: NDArray[np.void]) -> list[dict[str, float | int]]:
    """Return the measured torque over the commanded one, by speed, where both have one sign."""
    asked, found = rows["torque"], rows["measured_torque"]
    used = np.isfinite(found) & (np.abs(asked) > _TORQUE * torque_limit_of(config))
    used[1:] &= np.abs(np.diff(asked)) < 0.02 * np.abs(asked[1:])  # the current has settled
    along = used & (np.sign(asked) == np.sign(rows["velocity"]))
    answer = []
    for low, high in pairwise(_SPEEDS):
        speed = np.abs(rows["velocity"])
        inside = along & (speed >= low) & (speed < high)
        count = int(np.count_nonzero(inside))
        if count >= _LEAST_ROWS:
            share = float(np.median(found[inside] / asked[inside]))
            answer.append({"from": low, "to": high, "share": share, "rows": count})
    return answer


def _percentiles(values: NDArray[Any]) -> dict[str, float]:
    p50, p99 = np.percentile(values, (50.0, 99.0))
    return {"p50": float(p50), "p99": float(p99), "max": float(np.max(values))}
