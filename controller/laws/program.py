"""Program of an experiment, phase after phase, in place of the guarded wall.

A phase is a spring and a damper about a centre that may travel, and a torque beside them: enough
to move the shaft somewhere and hold it, to let it go at a wall, to shake it and to let it coast.
It ends by its time, or before, when the shaft has come too far or has come to rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from haptic_wall.controller.laws.wall import Side, Wall

Wave = Literal["constant", "sine"]


@dataclass(frozen=True, slots=True)
class Phase:
    """One part of a program; positions count from where the shaft was when the program began.

    Attributes:
        seconds: How long it lasts at most, in executed periods [s].
        stiffness: Of the spring about the centre [N·m/rad].
        damping: Of the damper on the estimated velocity [N·m·s/rad].
        center: Where the centre goes [rad].
        speed: How fast it travels there from where the shaft is [rad/s]; None: it jumps.
        integral: What the spring lacks to reach the centre against friction grows at this rate
            [N·m/(rad·s)]; stable while it is below stiffness × all damping / inertia.
        side: ``both``, or a one-sided wall at the centre that never pulls.
        torque: Amplitude of the torque beside spring and damper [N·m].
        wave: ``constant``, or a ``sine`` whose frequency goes evenly from one to the other.
        from_hz: Frequency of the sine at the beginning of the phase [Hz].
        to_hz: At the end of ``seconds`` [Hz].
        reach: The phase ends when the shaft is further than this from the centre's goal [rad].
        still_s: It ends when the shaft has kept still for so long, the centre too [s].
        still_band: Motion within this width is none [rad].
    """

    seconds: float
    stiffness: float = 0.0
    damping: float = 0.0
    center: float = 0.0
    speed: float | None = None
    integral: float = 0.0
    side: Side = "both"
    torque: float = 0.0
    wave: Wave = "constant"
    from_hz: float = 0.0
    to_hz: float = 0.0
    reach: float | None = None
    still_s: float | None = None
    still_band: float = 0.0


class Program:
    """Renders phases one after the other; stands where a ``Wall`` stands in the tick.

    Args:
        phases: At least one.
        period: Sampling period [s].
        torque_limit: No phase asks for more than this [N·m].

    Attributes:
        guarded: Never: what a phase asks for is what is commanded.
        done: All phases are over; the torque is zero from then on.
        phase: Number of the one in force, from 0.
        stiffness: [N·m/rad], of the phase in force.
        damping: [N·m·s/rad]
        injected: Nothing.
        position: Where the centre is [rad], in the servo's own count.

    Raises:
        ValueError: There is no phase.
    """

    __slots__ = (
        "_goal",
        "_integral",
        "_limit",
        "_origin",
        "_period",
        "_phases",
        "_resting_at",
        "_still",
        "_ticks",
        "_wall",
        "_wave_phase",
        "clip",
        "damping",
        "damping_scale",
        "done",
        "elastic_limit",
        "guarded",
        "injected",
        "one_sided",
        "phase",
        "position",
        "scale",
        "stiffness",
    )

    def __init__(self, phases: Sequence[Phase], period: float, torque_limit: float) -> None:
        if not phases:
            raise ValueError("a program needs at least one phase")
        self._phases = tuple(phases)
        self._period = period
        self._limit = torque_limit
        self._origin = self._goal = math.nan
        self._wall = Wall(0.0, 0.0, 0.0, "both")
        self._ticks = self._still = 0
        self._resting_at = self._wave_phase = self._integral = 0.0
        self.phase = -1
        self.guarded = self.one_sided = self.done = False
        self.stiffness = self.damping = self.injected = self.position = 0.0
        self.scale = self.damping_scale = 1.0
        self.elastic_limit = math.inf
        self.clip = math.inf  # the phases keep to the torque limit

    def in_contact(self, position: float) -> bool:  # noqa: ARG002 - whatever the position
        """Always: a program has no outside."""
        return True

    def torque(self, position: float, velocity: float) -> float:
        """Torque [N·m] at a position [rad] and an estimated velocity [rad/s]; one a period."""
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
        torque = self._wall.torque(position, velocity)
        if phase.integral:
            self._integral += phase.integral * (self.position - position) * self._period
            self._integral = min(max(self._integral, -self._limit), self._limit)
            torque += self._integral
        torque += self._beside(phase)
        self._ticks += 1
        return min(max(torque, -self._limit), self._limit)

    def _begin(self, number: int, position: float) -> None:
        phase = self._phases[number]
        self.phase = number
        self._ticks = 0
        self._wave_phase = 0.0
        self._integral = 0.0
        self._goal = self._origin + phase.center
        self.position = self._goal if phase.speed is None else position
        self.stiffness, self.damping = phase.stiffness, phase.damping
        self._wall = Wall(phase.stiffness, phase.damping, self.position, phase.side)
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
        """Move the centre on toward its goal."""
        if phase.speed is None:
            return
        step = phase.speed * self._period
        away = self._goal - self.position
        arrives = abs(away) <= step
        self.position = self._goal if arrives else self.position + math.copysign(step, away)

    def _beside(self, phase: Phase) -> float:
        """The torque beside spring and damper [N·m]."""
        if phase.wave == "constant":
            return phase.torque
        share = min(1.0, self._ticks * self._period / phase.seconds)
        hertz = phase.from_hz + (phase.to_hz - phase.from_hz) * share
        torque = phase.torque * math.sin(self._wave_phase)
        self._wave_phase = (self._wave_phase + math.tau * hertz * self._period) % math.tau
        return torque
