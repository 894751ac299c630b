"""Divides the motion at a one-sided wall into contacts, without a model of the servo."""

from __future__ import annotations

import math
from collections import deque

from haptic_wall.controller.detector.half_cycles import HalfCycle
from haptic_wall.controller.detector.tuning import TUNING

_FINEST = 1e-6
"""Depth of the least contact without an encoder step [rad]: avoids a division by zero."""


class Contacts:
    """The last four contacts with a one-sided wall, each from entry to exit.

    Attributes as of ``HalfCycles``, ``gain``: smoothed logarithm of exit over entry speed, and
    ``gaining``: consecutive contacts that throw the shaft back. A contact with unknown speeds
    counts as a gain of 0: an earlier, larger motion is no evidence about one that stays within the
    gate.
    """

    def __init__(self, position_step: float) -> None:
        """Start with no contact.

        Args:
            position_step: Encoder count [rad]; 0: none. A contact is at least one deep.
        """
        self._least = position_step or _FINEST
        self._gate = TUNING.gate_counts * position_step if position_step else TUNING.gate_rad
        self.last: deque[HalfCycle] = deque(maxlen=4)
        self.elapsed = self.interval = self.gain = 0.0
        self.gaining = 0
        # Times since passing the gate inward and the surface outward, and the duration of the last
        # way in; NaN: none [s].
        self._way_in = self._way_out = self._took = math.nan
        self._inside = False
        self._position = math.nan
        self._deepest = self._moment = self._square = self._time = self._impulse = 0.0
        self._rested = 0.0

    @property
    def load(self) -> float:
        """Return the mean torque from the last exit but one to the last [N·m]."""
        return self.last[-1].impulse / self.interval if self.last else 0.0

    def forget(self) -> None:
        """Discard the contacts so far."""
        self.last.clear()
        self.gaining = 0

    def update(self, depth: float, torque: float, span: float) -> bool:
        """Take a sample; return whether a contact has ended with it.

        Args:
            depth: Inside the wall where positive [rad].
            torque: Commanded since the last sample, positive toward greater depth [N·m].
            span: Time since the last sample [s].
        """
        before, self._position = self._position, depth
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
                self._rested = 0.0
            self._deepest = max(self._deepest, depth)
            self._moment += torque * depth * span
            self._impulse += torque * span
            self._rested += span
            if moved:
                self._square += moved * moved / self._rested
                self._rested = 0.0
            self._time += span
            return False
        if not self._inside:
            return False
        self._inside = False
        if self._deepest <= self._least:
            return False
        self.last.append(
            HalfCycle(
                self._time,
                self._deepest,
                -self._moment / self._square if self._square > 0.0 else 0.0,
                -self._moment / (self._time * self._deepest),
                self._impulse,
                0.0,
                0.0,
            )
        )
        self.interval, self.elapsed = self.elapsed, 0.0
        return True

    def shift(self, way: float) -> None:
        """Go on at a surface that is deeper by ``way`` [rad]; the present contact has no gain."""
        self._position -= way
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
        gate, smoothing = -self._gate, TUNING.smoothing
        if depth > before:
            if before <= gate < depth:
                self._way_in = (before - gate) * slowness
            if before <= 0.0 < depth:
                self._took = self._way_in - before * slowness
                if math.isnan(self._took):
                    self.gain -= smoothing * self.gain
                    self.gaining = 0
                self._way_in = self._way_out = math.nan
            return
        if depth <= 0.0 < before:
            self._way_out = before * slowness
        if depth <= gate < before:
            took = self._way_out + (gate - before) * slowness
            if took > 0.0 and self._took > 0.0:  # also false where either is NaN
                gain = math.log(self._took / took)
                self.gain += smoothing * (gain - self.gain)
                self.gaining = self.gaining + 1 if gain > TUNING.thrown else 0
            self._way_in = self._way_out = self._took = math.nan
