"""Measures the cost of the oscillation detector in a tick."""

from __future__ import annotations

import math
import time

import numpy as np

from haptic_wall.controller.bench.rows import Measurement, Section
from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings

_PERIOD, _COUNT = 1e-3, 2.0 * math.pi / 4096
_INERTIA, _STIFFNESS = 0.012, 20.0
_TICKS = 50_000


def measure() -> Section:
    """Time every tick by itself, on an oscillation that decays and is kicked again."""
    natural = math.sqrt(_STIFFNESS / _INERTIA)
    t = np.arange(_TICKS) * _PERIOD
    x = 0.2 * np.exp(-(t % 2.0)) * np.cos(natural * t)
    positions = (np.rint(x / _COUNT) * _COUNT).tolist()
    detector = Detector(DetectorSettings(_PERIOD, _INERTIA, 0.012, 0.02, _COUNT))
    detector.stiffness = _STIFFNESS
    detector.balance.surface, detector.balance.lag = 0.0, 0.0025
    acting = ActingTorque(2.5)
    spent = np.empty(_TICKS)
    clock = time.perf_counter_ns
    for k, position in enumerate(positions):
        begin = clock()
        detector.update(position, acting.push(-_STIFFNESS * position))
        spent[k] = clock() - begin
    median, p99 = np.percentile(1e-3 * spent, [50, 99])
    return Section(
        (
            Measurement("detector and acting torque, a tick, median", float(median), "µs", _NOT),
            Measurement("the same, 99 % of ticks", float(p99), "µs", _NOT),
        )
    )


_NOT = "the rest of the tick, nor a busy machine"
