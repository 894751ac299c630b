"""Notices that the loop oscillates by itself: quiet, decaying, sustained, growing."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum


class State(IntEnum):
    """What the motion does; the worse, the greater."""

    QUIET = 0
    DECAYING = 1
    SUSTAINED = 2
    GROWING = 3


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """What the detector knows of the servo; NaN: not known.

    Without inertia and friction it goes by the motion alone.
    """

    period: float
    """T [s]"""
    inertia: float = math.nan
    """m [kg·m²]"""
    damping: float = math.nan
    """Viscous friction b [N·m·s/rad]"""
    coulomb: float = math.nan
    """Coulomb friction c [N·m]"""
    position_step: float = math.nan
    """Encoder count q [rad]; 0: not quantised"""


class Detector:
    """Watches position and acting torque, sample by sample.

    Attributes:
        state: Of the motion now.
        frequency_hz: Of the oscillation [Hz]; NaN while there is none.
        amplitude: Half its width [rad]; 0 while there is none.
        growth: Rate at which the amplitude's logarithm grows [1/s]; NaN while there is none.
        alarm: Whether it is sustained or grows, and the wall feeds it.
        stiffness: Commanded K [N·m/rad], for the energy in the spring and the frequencies to
            expect; NaN: not known. May be changed at any time.
    """

    def __init__(self, settings: DetectorSettings) -> None:
        self.settings = settings
        self.stiffness = math.nan
        self._hysteresis = 1.5 * settings.position_step if settings.position_step > 0 else 1e-9
        self.restart()

    def restart(self) -> None:
        """Forget what was seen."""
        self.state = State.QUIET
        self.alarm = False
        self.frequency_hz = math.nan
        self.amplitude = 0.0
        self.growth = math.nan
        self._extreme = math.nan
        self._turn = math.nan
        self._up = True
        self._since = 0
        self._half = 0
        self._growing = 0

    def update(self, position: float, torque: float, periods: int = 1) -> State:  # noqa: ARG002
        """Take a sample.

        Args:
            position: Measured [rad].
            torque: Mean torque that acted since the sample before [N·m].
            periods: From the sample before to this one, >= 1.
        """
        self._since += periods  # torque: the energy is to follow
        if self._extreme != self._extreme:  # the first sample
            self._extreme = self._turn = position
            return self.state
        if (position > self._extreme) is self._up and position != self._extreme:
            self._extreme = position
        elif abs(position - self._extreme) > self._hysteresis:
            self._turned(position)
        return self.state

    def _turned(self, position: float) -> None:
        amplitude = 0.5 * abs(self._extreme - self._turn)
        period = self._since * self.settings.period
        previous = self.amplitude
        self.frequency_hz = 0.5 / period
        self.amplitude = amplitude
        self._turn, self._extreme, self._up, self._since = self._extreme, position, not self._up, 0
        if previous > 0.0 and amplitude > 0.0:
            self.growth = math.log(amplitude / previous) / period
            self._growing = self._growing + 1 if self.growth >= 0.0 else 0
            self.state = State.GROWING if self._growing >= 4 else State.DECAYING
            self.alarm = self._growing >= 4
