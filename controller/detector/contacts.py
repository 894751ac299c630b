"""Cuts the motion at a wall that never pulls into contacts, without any belief about the servo."""

from __future__ import annotations

import math


class Contacts:
    """The last four contacts with a one-sided wall, each from entry to exit.

    It has the attributes of ``HalfCycles``, so that the same questions can be asked of both. The
    spring's elongation is zero at both ends of a contact, so the apparent inertia is found as
    there, with the depth for the distance.

    Attributes:
        known: Contacts seen since the start.
        duration: Of the last one [s]; ``duration_2`` to ``duration_4``: of those before it.
        amplitude: Greatest depth in it [rad]; likewise.
        inertia: Apparent inertia in it [kg·m²]; ``inertia_2``: in the one before.
        pull: Mean outward torque, weighted by the depth over the greatest depth [N·m]; likewise.
        elapsed: Since the last contact ended [s].
        interval: Between the ends of the last two contacts [s].
    """

    __slots__ = (
        "_deepest",
        "_inside",
        "_last",
        "_least",
        "_moment",
        "_square",
        "_time",
        "amplitude",
        "amplitude_2",
        "amplitude_3",
        "amplitude_4",
        "duration",
        "duration_2",
        "duration_3",
        "duration_4",
        "elapsed",
        "inertia",
        "inertia_2",
        "interval",
        "known",
        "pull",
        "pull_2",
        "pull_3",
    )

    def __init__(self, position_step: float) -> None:
        """Begin with nothing known.

        Args:
            position_step: Encoder count [rad]; 0: none. A contact is at least one deep.
        """
        self._least = position_step
        self._inside = False
        self._last = math.nan
        self._deepest = self._moment = self._square = self._time = 0.0
        self.known = 0
        self.duration = self.duration_2 = self.duration_3 = self.duration_4 = 0.0
        self.amplitude = self.amplitude_2 = self.amplitude_3 = self.amplitude_4 = 0.0
        self.inertia = self.inertia_2 = 0.0
        self.pull = self.pull_2 = self.pull_3 = 0.0
        self.elapsed = self.interval = 0.0

    def update(self, depth: float, torque: float, span: float) -> bool:
        """Take a sample; whether a contact has ended with it.

        Args:
            depth: Inside the wall where positive [rad].
            torque: Commanded since the sample before, positive toward greater depth [N·m].
            span: Time since the sample before [s].
        """
        moved = depth - self._last
        self._last = depth
        self.elapsed += span
        if math.isnan(moved):  # the first sample
            return False
        if depth > 0.0:
            if not self._inside:
                self._inside = True
                self._deepest = self._moment = self._square = self._time = 0.0
            self._deepest = max(self._deepest, depth)
            self._moment += torque * depth * span
            self._square += moved * moved / span
            self._time += span
            return False
        if not self._inside:
            return False
        self._inside = False
        if self._deepest <= self._least:
            return False
        self._keep()
        return True

    def _keep(self) -> None:
        """Keep the contact that has just ended."""
        self.duration_4, self.amplitude_4 = self.duration_3, self.amplitude_3
        self.duration_3, self.amplitude_3 = self.duration_2, self.amplitude_2
        self.duration_2, self.amplitude_2 = self.duration, self.amplitude
        self.inertia_2 = self.inertia
        self.pull_3, self.pull_2 = self.pull_2, self.pull
        self.duration, self.amplitude = self._time, self._deepest
        self.inertia = -self._moment / self._square if self._square > 0.0 else 0.0
        self.pull = -self._moment / (self._time * self._deepest)
        self.interval, self.elapsed = self.elapsed, 0.0
        self.known += 1
