"""Divides the motion at a one-sided wall into contacts, without a model of the servo."""

from __future__ import annotations

import math

from haptic_wall.controller.detector.tuning import ContactTuning

_FINEST = 1e-6
"""Depth of the least contact without an encoder step [rad]: avoids a division by zero."""


class Contacts:
    """The last four contacts with a one-sided wall, each from entry to exit.

    It has the attributes of ``HalfCycles``, so that both can be judged alike. The spring's
    elongation is zero at both ends of a contact, so the apparent inertia is computed as there, with
    the depth for the distance.

    Attributes:
        known: Contacts since the start.
        duration: Duration of the last one [s]; ``duration_2`` to ``duration_4``: of those before
            it.
        amplitude: Greatest depth in it [rad]; ``amplitude_2`` and so on, as for ``duration``.
        inertia: Apparent inertia in it [kg·m²]; ``inertia_2``: in the one before.
        pull: Mean outward torque, weighted by the depth over the greatest depth [N·m]; ``pull_2``
            and so on.
        elapsed: Since the last contact ended [s].
        interval: Between the ends of the last two contacts [s].
        load: Mean torque over that time [N·m]: the load that the wall holds.
        gain: Logarithm of the exit speed over the entry speed, smoothed over some two contacts. A
            contact with unknown speeds counts as 0: an earlier, larger motion is no evidence about
            one that stays within the gate.
        gaining: Consecutive contacts that were left clearly faster than they were entered.
    """

    __slots__ = (
        "_deepest",
        "_gate",
        "_impulse",
        "_inside",
        "_last",
        "_least",
        "_moment",
        "_smoothing",
        "_square",
        "_thrown",
        "_time",
        "_took",
        "_way_in",
        "_way_out",
        "amplitude",
        "amplitude_2",
        "amplitude_3",
        "amplitude_4",
        "duration",
        "duration_2",
        "duration_3",
        "duration_4",
        "elapsed",
        "gain",
        "gaining",
        "inertia",
        "inertia_2",
        "interval",
        "known",
        "load",
        "pull",
        "pull_2",
        "pull_3",
    )

    def __init__(self, position_step: float, tuning: ContactTuning) -> None:
        """Start with no contact.

        Args:
            position_step: Encoder count [rad]; 0: none. A contact is at least one deep.
            tuning: Numbers for contacts.
        """
        self._least = position_step or _FINEST
        self._gate = tuning.gate_counts * position_step if position_step else tuning.gate_rad
        self._smoothing, self._thrown = tuning.smoothing, tuning.thrown
        # Times since passing the gate inward and the surface outward, and the duration of the last
        # way in; NaN: none [s].
        self._way_in = self._way_out = self._took = math.nan
        self.gain = 0.0
        self.gaining = 0
        self._inside = False
        self._last = math.nan
        self._deepest = self._moment = self._square = self._time = self._impulse = 0.0
        self.load = 0.0
        self.known = 0
        self.duration = self.duration_2 = self.duration_3 = self.duration_4 = 0.0
        self.amplitude = self.amplitude_2 = self.amplitude_3 = self.amplitude_4 = 0.0
        self.inertia = self.inertia_2 = 0.0
        self.pull = self.pull_2 = self.pull_3 = 0.0
        self.elapsed = self.interval = 0.0

    def update(self, depth: float, torque: float, span: float) -> bool:
        """Take a sample; return whether a contact has ended with it.

        Args:
            depth: Inside the wall where positive [rad].
            torque: Commanded since the last sample, positive toward greater depth [N·m].
            span: Time since the last sample [s].
        """
        before, self._last = self._last, depth
        moved = depth - before
        self.elapsed += span
        if math.isnan(moved):  # the first sample
            return False
        if moved:
            self._pass(before, depth, span / moved)
        self._way_in += span
        self._way_out += span
        if depth > 0.0:
            if not self._inside:
                self._inside = True
                self._deepest = self._moment = self._square = self._time = self._impulse = 0.0
            self._deepest = max(self._deepest, depth)
            self._moment += torque * depth * span
            self._impulse += torque * span
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

    def shift(self, way: float) -> None:
        """Go on at a surface that is deeper by ``way`` [rad]; the present contact has no gain."""
        self._last -= way
        self._deepest -= way
        self._way_in = self._way_out = self._took = math.nan

    def _pass(self, before: float, depth: float, slowness: float) -> None:
        """Compute when gate and surface were passed, between the samples.

        Times count from the last sample; the caller adds the time since.

        Args:
            before: Depth at the last sample [rad].
            depth: Depth now [rad].
            slowness: Time over distance between them, signed [s/rad].
        """
        gate = -self._gate
        if depth > before:
            if before <= gate < depth:
                self._way_in = (before - gate) * slowness
            if before <= 0.0 < depth:
                self._took = self._way_in - before * slowness
                if math.isnan(self._took):
                    self.gain -= self._smoothing * self.gain
                    self.gaining = 0
                self._way_in = self._way_out = math.nan
            return
        if depth <= 0.0 < before:
            self._way_out = before * slowness
        if depth <= gate < before:
            took = self._way_out + (gate - before) * slowness
            if took > 0.0 and self._took > 0.0:  # also false where either is NaN
                gain = math.log(self._took / took)
                self.gain += self._smoothing * (gain - self.gain)
                self.gaining = self.gaining + 1 if gain > self._thrown else 0
            self._way_in = self._way_out = self._took = math.nan

    def _keep(self) -> None:
        """Store the contact that has just ended."""
        self.duration_4, self.amplitude_4 = self.duration_3, self.amplitude_3
        self.duration_3, self.amplitude_3 = self.duration_2, self.amplitude_2
        self.duration_2, self.amplitude_2 = self.duration, self.amplitude
        self.inertia_2 = self.inertia
        self.pull_3, self.pull_2 = self.pull_2, self.pull
        self.duration, self.amplitude = self._time, self._deepest
        self.inertia = -self._moment / self._square if self._square > 0.0 else 0.0
        self.pull = -self._moment / (self._time * self._deepest)
        self.interval, self.elapsed = self.elapsed, 0.0
        self.load = self._impulse / self.interval
        self.known += 1
