"""Runs the detector over the record of a simulated wall, with wrong beliefs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings, State
from haptic_wall.controller.detector.tuning import TUNING, Tuning
from haptic_wall.controller.experiments.maps.walls import Walls
from haptic_wall.controller.theory.checks import FloatArray
from scripts.trials.watched import Trace

COUNT = 2.0 * np.pi / 4096
"""One count of the encoder [rad]"""
PERIOD = 1e-3


@dataclass(frozen=True, slots=True)
class Heard:
    """The detector's result on a trace."""

    detector: Detector
    """In its final state"""
    alarms: list[int]
    """Samples at which an alarm began"""
    counts: float
    """Amplitude at the first, in counts; NaN without"""
    small: list[int]
    """Samples at which it began to call the motion sustained without an alarm"""


def listen(
    walls: Walls,
    i: int,
    trace: Trace,
    belief: FloatArray,
    *,
    once: bool,
    tuning: Tuning = TUNING,
) -> Heard:
    """Run the detector over a trace, with wrong beliefs.

    Args:
        walls: The simulated walls.
        i: Index of the wall.
        trace: Its record.
        belief: Factors on inertia, damping, Coulomb friction and delay.
        once: Stop at the first alarm.
        tuning: Numbers of the detector.
    """
    m, b, c, delay = belief.tolist()
    settings = DetectorSettings(
        PERIOD,
        float(walls.inertia[i]) * m,
        float(walls.damping[i]) * b,
        float(walls.coulomb[i]) * c,
        COUNT,
        float(walls.torque_limit[i]),
        tuning,
    )
    lag = float(walls.whole[i] * PERIOD + walls.lag[i]) * delay
    detector = Detector(settings)
    detector.stiffness = float(walls.stiffness[i])
    balance = detector.balance
    balance.virtual_damping = float(walls.virtual_damping[i])
    balance.surface, balance.side, balance.lag = 0.0, int(walls.one_sided[i]), lag
    acting = ActingTorque(lag / PERIOD)
    alarms: list[int] = []
    small: list[int] = []
    counts, alarmed, was = np.nan, False, State.QUIET
    positions = (trace.counts * COUNT).tolist()
    for k, (position, torque) in enumerate(zip(positions, trace.torque.tolist(), strict=True)):
        state = detector.update(position, acting.push(torque))
        if state is not was:
            was = state
            if state is State.SUSTAINED and not detector.alarm:
                small.append(k)
        if detector.alarm is not alarmed:
            alarmed = detector.alarm
            if alarmed:
                alarms.append(k)
                if len(alarms) == 1:
                    counts = detector.amplitude / COUNT
                if once:
                    break
    return Heard(detector, alarms, counts, small)
