"""Renders the program of an experiment, phase after phase, in place of the guarded wall.

A phase is a spring and a damper about a centre that may travel, and an additional torque. Phases
can move the shaft and hold it, release it at a wall, excite it, and let it coast. A phase ends
after its time, or earlier when the shaft has gone too far or has come to rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from haptic_wall.controller.laws.wall import Derating, Wall

Wave = Literal["constant", "sine"]


@dataclass(frozen=True, slots=True)
class Phase:
    """One part of a program; positions count from the shaft's position when the program began.

    Attributes:
        seconds: Longest duration, in executed periods [s].
        stiffness: Stiffness of the spring about the centre [N·m/rad].
        damping: Damping of the damper on the estimated velocity [N·m·s/rad].
        center: Goal of the centre [rad].
        speed: Speed at which the centre travels from the shaft to its goal [rad/s]; None: it jumps.
        torque: Amplitude of the additional torque [N·m].
        bias: Constant torque beside it [N·m].
        wave: ``constant``, or a ``sine`` with a linear frequency sweep.
        from_hz: Frequency of the sine at the beginning of the phase [Hz].
        to_hz: Frequency at the end of ``seconds`` [Hz].
        reach: The phase ends when the shaft is further than this from the centre's goal [rad].
        still_s: The phase ends when the shaft and the centre have rested for this time [s].
        still_band: Motion within this width counts as rest [rad].
    """

    seconds: float
    stiffness: float = 0.0
    damping: float = 0.0
    center: float = 0.0
    speed: float | None = None
    torque: float = 0.0
    bias: float = 0.0
    wave: Wave = "constant"
    from_hz: float = 0.0
    to_hz: float = 0.0
    reach: float | None = None
    still_s: float | None = None
    still_band: float = 0.0


class Program:
    """Renders phases one after the other; used in the tick in place of a ``Wall``.

    Args:
        phases: At least one phase.
        period: Sampling period [s].
        torque_limit: No phase commands more than this [N·m].

    Attributes:
        guarded: Always false: the guard does not change the phases' values.
        done: All phases are over; the torque is zero from then on.
        phase: Number of the present phase, from 0.
        stiffness: Stiffness of the present phase [N·m/rad].
        damping: Damping of the present phase [N·m·s/rad].
        injected: Always zero.
        position: Position of the centre [rad], in the servo's own count.

    Raises:
        ValueError: There is no phase.
    """

    name, linear, guarded, one_sided = "program", True, False, False

    def __init__(self, phases: Sequence[Phase], period: float, torque_limit: float) -> None:
        if not phases:
            raise ValueError("a program needs at least one phase")
        self._phases = tuple(phases)
        self._period = period
        self._limit = torque_limit
        self._origin = self._goal = math.nan
        self._wall = Wall(0.0, 0.0, 0.0, "both")
        self._ticks = self._still = 0
        self._resting_at = self._wave_phase = 0.0
        self.phase = -1
        self.done = False
        self.stiffness = self.damping = self.injected = self.position = self.held = 0.0
        self.derating = Derating()
        self.clip = math.inf  # the phases keep to the torque limit

    def in_contact(self, position: float) -> bool:  # noqa: ARG002 - whatever the position
        """Return true: a program acts at every position."""
        return True

    def elongation(self, position: float) -> float:
        """Return the distance from the centre [rad], signed."""
        return position - self.position

    def stored(self, position: float, limit: float) -> float:
        """Return the energy of the present phase's spring [J]."""
        return self._wall.stored(position, limit)

    def settle(self, position: float) -> None:
        """Do nothing: a program begins at its first sample."""

    def torque(self, position: float, velocity: float) -> float:
        """Return the torque [N·m] at a position [rad] and velocity [rad/s]; call once a period."""
        if self.done:
            return 0.0
        if self.phase < 0:
            self._origin = position
            self._begin(0, position)
        elif self._over(position):
            if self.phase + 1 == len(self._phases):
                self.done = True
                self.stiffness = self.damping = 0.0
                return 0.0
            self._begin(self.phase + 1, position)
        phase = self._phases[self.phase]
        self._travel(phase)
        self._wall.position = self.position
        torque = self._wall.torque(position, velocity) + self._beside(phase)
        self._ticks += 1
        return min(max(torque, -self._limit), self._limit)

    def _begin(self, number: int, position: float) -> None:
        phase = self._phases[number]
        self.phase = number
        self._ticks = 0
        self._wave_phase = 0.0
        self._goal = self._origin + phase.center
        self.position = self._goal if phase.speed is None else position
        self.stiffness, self.damping = phase.stiffness, phase.damping
        self._wall = Wall(phase.stiffness, phase.damping, self.position, "both")
        self._still = 0
        self._resting_at = position

    def _over(self, position: float) -> bool:
        phase = self._phases[self.phase]
        if self._ticks * self._period >= phase.seconds - 0.5 * self._period:
            return True
        if phase.reach is not None and abs(position - self._goal) > phase.reach:
            return True
        if phase.still_s is None:
            return False
        if abs(position - self._resting_at) > phase.still_band or self.position != self._goal:
            self._resting_at = position
            self._still = 0
        self._still += 1
        return self._still * self._period >= phase.still_s

    def _travel(self, phase: Phase) -> None:
        """Move the centre one step toward its goal."""
        if phase.speed is None:
            return
        step = phase.speed * self._period
        away = self._goal - self.position
        arrives = abs(away) <= step
        self.position = self._goal if arrives else self.position + math.copysign(step, away)

    def _beside(self, phase: Phase) -> float:
        """Return the additional torque [N·m]."""
        if phase.wave == "constant":
            return phase.bias + phase.torque
        share = min(1.0, self._ticks * self._period / phase.seconds)
        hertz = phase.from_hz + (phase.to_hz - phase.from_hz) * share
        torque = phase.bias + phase.torque * math.sin(self._wave_phase)
        self._wave_phase = (self._wave_phase + math.tau * hertz * self._period) % math.tau
        return torque
