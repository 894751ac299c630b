"""Finds the least stable member of a range by search, and proves that no member is less stable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from haptic_wall.controller.theory.checks import FloatArray, number, positive, samples, scalar
from haptic_wall.controller.theory.exact import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.exclusion import Exclusion, Family, exclude
from haptic_wall.controller.theory.ranges import Member, Ranges

_BUDGET = 100_000  # boxes for one proof, under a second
_ROUNDING = 1e-12  # by which the proved family exceeds the requested one
_ROUNDS = 5  # refinements of the search, each on a grid four times finer
_AROUND = np.linspace(-1, 1, 9)
_MOST_WHOLE = 64  # delays that the search evaluates


@dataclass(frozen=True, slots=True)
class WorstSearch:
    """Search for the worst member, and the proof that no other is worse."""

    ranges: Ranges
    virtual_damping: float
    period: float
    samples: int

    @classmethod
    def of(
        cls, ranges: Ranges, virtual_damping: float, period: float, velocity_samples: int
    ) -> WorstSearch:
        """Return the search for checked arguments.

        Raises:
            ValueError: An argument is outside of its domain; the message names it.
        """
        return cls(
            ranges,
            scalar(number, "virtual_damping", virtual_damping),
            scalar(positive, "period", period),
            int(scalar(samples, "velocity_samples", velocity_samples)),
        )

    @property
    def edge(self) -> tuple[float, float]:
        """Return the range of x: see the module ``exclusion``."""
        inertia, damping = self.ranges.inertia, self.ranges.damping
        return float(np.sqrt(inertia[0] / inertia[1])), damping[1] / damping[0]

    def proof(self, stiffness: float) -> Exclusion:
        """Try to prove that all members are stable up to a stiffness."""
        inertia, damping = self.ranges.inertia[0], self.ranges.damping[0]
        low, high = self.edge
        return exclude(
            Family(
                gain=self.ranges.torque_gain[1] * self.period**2 / inertia * (1 + _ROUNDING),
                delta=damping * self.period / inertia,
                edge=(low * (1 - _ROUNDING), high * (1 + _ROUNDING)),
                delay=(
                    self.ranges.delay[0] / self.period * (1 - _ROUNDING),
                    self.ranges.delay[1] / self.period * (1 + _ROUNDING),
                ),
                stiffness=stiffness,
                damper=self.virtual_damping / self.period,
                samples=self.samples,
            ),
            _BUDGET,
        )

    def stiffness(self, near: tuple[float, float] | None = None) -> tuple[float, Member]:
        """Return the least critical stiffness found, and its member."""
        gain = self.ranges.torque_gain[1]

        def limits(inertia: FloatArray, damping: FloatArray, delay: FloatArray) -> FloatArray:
            acting = critical_stiffness(
                inertia, damping, gain * self.virtual_damping, self.period, delay, self.samples
            )
            return acting / gain

        return self._least(limits, near)

    def ceiling(self, near: tuple[float, float] | None = None) -> tuple[float, Member]:
        """Return the least damping ceiling found, and its member."""
        gain = self.ranges.torque_gain[1]

        def limits(inertia: FloatArray, damping: FloatArray, delay: FloatArray) -> FloatArray:
            return max_virtual_damping(inertia, damping, self.period, delay, self.samples) / gain

        return self._least(limits, near)

    def _least(
        self,
        limits: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
        near: tuple[float, float] | None,
    ) -> tuple[float, Member]:
        """Search a grid of the two edges and the delay, refined around the best, or ``near``."""
        r = self.ranges
        edge, delay = self.edge, r.delay
        xs = np.unique([*np.linspace(edge[0], 1, 9), *np.linspace(1, edge[1], 5)])
        whole = np.arange(np.ceil(delay[0] / self.period), delay[1] / self.period)[:_MOST_WHOLE]
        late = np.unique([*np.linspace(*delay, 9), *whole * self.period])
        steps = np.array([edge[1] - edge[0], delay[1] - delay[0]]) / 8
        if near is not None:
            xs, late = np.array([near[0]]), np.array([near[1] * self.period])
        best, found = np.inf, np.zeros(3)
        for _ in range(_ROUNDS):
            x, d = (each.ravel() for each in np.meshgrid(xs, late))
            inertia = np.clip(r.inertia[0] / np.minimum(x, 1.0) ** 2, *r.inertia)
            damping = np.clip(r.damping[0] * np.maximum(x, 1.0), *r.damping)
            values = limits(inertia, damping, np.clip(d, *delay))
            i = int(np.argmin(values))
            if values[i] < best:
                best, centre = float(values[i]), (x[i], d[i])
                found = np.array([inertia[i], damping[i], np.clip(d[i], *delay)])
            xs = np.clip(centre[0] + steps[0] * _AROUND, *edge)
            late = np.clip(centre[1] + steps[1] * _AROUND, *delay)
            steps = steps / 4
        inertia_, damping_, delay_ = found.tolist()
        return best, Member(inertia_, damping_, delay_, torque_gain=r.torque_gain[1])


def closed_in(
    least: Callable[[tuple[float, float] | None], tuple[float, Member]],
    proof: Callable[[float], Exclusion],
    tolerance: float,
) -> tuple[float, float, Member, int]:
    """Lower the limit to prove, by counterexamples or by doubt, until it is proved.

    Args:
        least: Finds the least limit of a member, everywhere or near a suspect.
        proof: Tries a limit.
        tolerance: Relative distance below the least limit that is tried first.

    Returns:
        The proved limit (0: none), the least limit found, its member, and the evaluated boxes.
    """
    upper, worst = least(None)
    gap, boxes = tolerance, 0
    while upper > 0 and gap < 1:
        outcome = proof(upper * (1 - gap))
        boxes += outcome.boxes
        if outcome.proved:
            return upper * (1 - gap), upper, worst, boxes
        lower, member = least(outcome.suspect)
        if lower < upper * (1 - gap):
            upper, worst = lower, member
        else:
            gap *= 4
    return 0.0, upper, worst, boxes
