"""Many current loops at once: the array form of ``haptic_wall.hw.plant.current_loop``.

The same formulas, with one difference: all of the back-EMF is taken at the speed predicted for the
middle of the step, where a loop alone has part of it act continuously. Both are of second order.
Steps have one length for all bodies. ``STEP_S`` at the most keeps the errors that are stated there.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from haptic_wall.hw.plant.current_loop import STEP_NS

Floats = NDArray[np.float64]

STEP_S = STEP_NS * 1e-9
"""Longest step [s]"""


@dataclass(frozen=True, slots=True)
class CurrentLoopParameters:
    """Of many loops; arrays of shape (n,)."""

    bandwidth: Floats
    """[Hz]; 0: at once"""
    dead_band: Floats
    """[N·m]"""
    back_emf: Floats
    """Stall torque over no-load speed [N·m·s/rad]; 0: none"""
    stall_torque: Floats
    """[N·m]; used with back-EMF"""
    droop: Floats
    """Fraction of the back-EMF that stays at the no-load speed"""

    def take(self, index: NDArray[np.intp] | slice) -> CurrentLoopParameters:
        """Return the loops at ``index``."""
        return CurrentLoopParameters(*(getattr(self, one.name)[index] for one in fields(self)))


class CurrentLoops:
    """The current loops of many servos; the caller moves the bodies."""

    __slots__ = ("_lost", "_parameters", "_rate", "state")

    def __init__(self, parameters: CurrentLoopParameters, velocity: Floats) -> None:
        """Create loops without torque, on bodies that move.

        Args:
            parameters: Parameters of each.
            velocity: Velocity of the bodies [rad/s].
        """
        self._parameters = parameters
        self._rate = 2.0 * np.pi * parameters.bandwidth
        with np.errstate(divide="ignore", invalid="ignore"):
            lost = parameters.droop * parameters.back_emf**2 / parameters.stall_torque
        self._lost = np.where(parameters.back_emf > 0.0, lost, 0.0)
        self.state = np.array([parameters.back_emf * velocity, velocity])
        """Voltage [N·m] and velocity [rad/s] at the start of the last step, shape (2, n)"""

    @property
    def parameters(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return back-EMF, its lost share for each speed, stall torque and dead band."""
        p = self._parameters
        return p.back_emf, self._lost, p.stall_torque, p.dead_band

    def shares(self, duration: Floats) -> tuple[Floats, Floats]:
        """Return what is left of a gap over a step [s] in the mean, and at its end."""
        y = self._rate * duration
        fraction = np.ones_like(y)
        np.divide(-np.expm1(-y), y, out=fraction, where=y > 0.0)
        return fraction, np.exp(-y)

    def held(self, goal: Floats, velocity: Floats, duration: Floats) -> Floats:
        """Return the torques to hold over the next step [N·m].

        Args:
            goal: [N·m].
            velocity: Velocity of the bodies at its start [rad/s].
            duration: Its length [s], > 0; for the prediction, also that of the last one.
        """
        p = self._parameters
        voltage, speed = self.state
        middle = velocity + 0.5 * (velocity - speed)
        np.copyto(speed, velocity)
        back_emf = p.back_emf * middle
        wanted = np.copysign(np.maximum(np.abs(goal) - p.dead_band, 0.0), goal)
        wanted += back_emf - self._lost * np.abs(middle) * middle
        limited = np.clip(wanted, -p.stall_torque, p.stall_torque)
        target = np.where(p.back_emf > 0.0, limited, wanted)
        fraction, rest = self.shares(duration)
        gap = np.where(rest < 1.0, voltage - target, 0.0)
        np.copyto(voltage, target + gap * rest)
        result: Floats = target + gap * fraction - back_emf
        return result
