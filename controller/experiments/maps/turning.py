"""Computes from turning points whether a two-sided wall's motion grows after a kick.

The growth is fitted to the amplitudes of many oscillations, so that its sign is known long before
the motion has become large or small.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.maps import lane_rows
from haptic_wall.controller.experiments.maps.kicks import unsaturated
from haptic_wall.controller.experiments.maps.many_walls import Loops
from haptic_wall.controller.experiments.maps.walls import Walls, blocks
from haptic_wall.controller.theory.checks import FloatArray, IntArray

_LEAST_PERIODS = 1000
_MOST_PERIODS = 200_000
_SURE = 3.0
"""Standard errors by which growth must differ from zero where counts or backlash make it irregular.
"""
_CHANGES = 0.05
"""Largest late change of an amplitude's logarithm in steady motion"""
_SOON = 2.0
"""Number of late parts of a run within which a motion must return to its kick"""
_SEGMENT = 256
"""Periods between two checks for decided walls."""
_DECIDED = 3.0
"""Factor of growth after which a motion is no longer simulated, and of decay with friction. Without
friction another, faster oscillation may still appear."""
_DEAD = 1e-12
"""Factor of decay after which a motion counts as dead."""
_LATE = 0.4
"""Fraction of the time after which the growth without friction is fitted: fast modes have decayed.
With friction the growth depends on the amplitude, and the kick's own counts; with counts or
backlash the late amplitude itself is compared with that at the start."""
_STILL = 1e-12
"""Rounding of the position of a motor that stands still before a load that moves [rad]"""
_FADING = 0.01
"""A saturating motion that loses less than this fraction per oscillation late in its run persists.
"""
_SETTLING = 2
"""Turning points omitted at the start: the release excites other modes too."""


def growth(walls: Walls, kick: FloatArray, cycles: float) -> FloatArray:
    """Return the growth per oscillation after a kick; > 0: the motion grows.

    The servo is released at rest after being held for long: at a turning point, with zero estimated
    velocity. Motion that saturates the torque cannot grow: it decays to what the torque limit
    sustains, if anything. So no kick exceeds ``kicks.unsaturated``, and motion that still saturates
    late without fading counts as growing.

    Args:
        walls: Two-sided walls with stiffness > 0.
        kick: Displacement at the start, > 0 [rad].
        cycles: Least number of fitted oscillations (of the undamped spring).

    Returns:
        Logarithm of the ratio of amplitudes one oscillation apart; only its sign has a meaning for
        motion that ends within a few turning points, or that friction has stopped.
    """
    result = np.empty(walls.size)
    start = unsaturated(walls, kick)
    with np.errstate(over="ignore", invalid="ignore"):  # what has grown out of all bounds
        for index in blocks(walls):
            result[index] = _growth(walls.take(index), start[index], cycles)
    return result


def _growth(walls: Walls, start: FloatArray, cycles: float) -> FloatArray:
    loops = Loops(walls, start)
    cycle = 2.0 * np.pi * np.sqrt(walls.moved / walls.stiffness) / walls.period
    length = float(np.max(cycles * cycle)) + _LEAST_PERIODS
    length += float(np.max(walls.whole)) + float(np.max(walls.velocity_samples))
    length = min(length, _MOST_PERIODS)
    frictional = bool(walls.coulomb[0] > 0.0)
    turnings = Turnings(loops, walls, int(_LATE * length))
    floor = start * (1.0 / _DECIDED if frictional else _DEAD)
    resting = np.full(walls.size, np.nan)
    while loops.k < length:
        turnings.run(_SEGMENT)
        turnings.gather()
        up = turnings.greatest > _DECIDED * start
        down = turnings.least < floor
        position = loops.bodies.motor_position
        # No motion since the last check, longer than the delay: stuck for ever. A load may still
        # swing behind its transmission, and only fades.
        still = np.abs(position - resting) <= (0.0 if walls.transmission is None else _STILL)
        stuck = (loops.bodies.motor_velocity == 0.0) & still & (loops.k > 2 * _SEGMENT)
        resting = position.copy()
        if np.all(up | down | stuck):
            break
    slope = (turnings.whole if frictional else turnings.late).slope() * cycle
    if walls.counts_per_radian[0] > 0.0 or walls.backlash[0] > 0.0:
        slope = _uneven(turnings, start, cycle, loops.k)
    if turnings.saturating is not None:
        sustained = turnings.saturating & ~(slope < -_FADING)
        slope = np.where(sustained, np.maximum(np.abs(slope), _FADING), slope)
    # Motion without turning points creeps: away from the wall, or toward it.
    creeps = np.where(np.abs(position) > start, 1.0, -1.0)
    slope = np.where(np.isnan(slope), creeps, slope)
    slope = np.where(up, np.where(slope > 0.0, slope, 1.0), slope)
    return np.where(~up & (down | stuck), np.where(slope < 0.0, slope, -1.0), slope)


def _uneven(turnings: Turnings, start: FloatArray, cycle: FloatArray, periods: int) -> FloatArray:
    """Return the growth per oscillation where counts or backlash can sustain a motion.

    Such a motion grows from a smaller kick and decays from a larger one, and soon settles. So late
    amplitudes are compared with the kick, unless they are on their way to its other side.
    """
    late = turnings.late
    slope, window = late.slope(), (1.0 - _LATE) * periods
    from_kick = late.level() - np.log(start)
    # Steady motion beats a little: a motion that would not return soon counts as settled.
    back = np.maximum(np.abs(from_kick) / _SOON, _CHANGES) / window
    returning = (from_kick * slope < 0.0) & (np.abs(slope) > back)
    returning &= np.abs(slope) > _SURE * late.slope_error()
    return np.where(returning, slope, from_kick / periods) * cycle


class Line:
    """Straight lines fitted to the logarithms of amplitudes over the periods, one for each wall."""

    def __init__(self, count: int) -> None:
        self._sums = np.zeros((6, count))

    def add(self, index: IntArray, t: FloatArray, y: FloatArray) -> None:
        """Add points of the walls at ``index``."""
        for row, value in enumerate((np.ones_like(t), t, t * t, y, t * y, y * y)):
            self._sums[row] += np.bincount(index, value, minlength=self._sums.shape[1])

    def level(self) -> FloatArray:
        """Return the mean of the logarithms; NaN without points."""
        n, _, _, y, _, _ = self._sums
        return np.where(n > 0, y / np.maximum(n, 1.0), np.nan)

    def slope(self) -> FloatArray:
        """Return the growth of the logarithm per period; NaN with fewer than 3 points."""
        n, t, tt, y, ty, _ = self._sums
        spread = n * tt - t * t
        usable = (n > 2) & (spread > 0)
        return np.where(usable, (n * ty - t * y) / np.where(usable, spread, 1.0), np.nan)

    def slope_error(self) -> FloatArray:
        """Return the standard error of ``slope``; 0 where there is none."""
        n, t, tt, y, _, yy = self._sums
        spread = n * tt - t * t
        usable = (n > 2) & (spread > 0)
        left = (n * yy - y * y) / np.where(usable, spread, 1.0) - self.slope() ** 2
        return np.where(usable, np.sqrt(np.maximum(left, 0.0) / np.maximum(n - 2, 1.0)), 0.0)


class Turnings:
    """Finds the turning points of a block of loops, and fits lines to their amplitudes' logarithms.

    The amplitude of a turning point is its distance from the wall, from the velocities before and
    after
    it: exact for a light body under one held torque.

    Attributes:
        whole: Fit of all turning points, without those omitted at the start.
        late: Fit of those from a given period on.
        saturating: Whether the torque was limited since the last ``gather``; None: there is no
            limit.
        count: Number of turning points.
        least, greatest: Amplitudes, without those omitted at the start [rad]; inf and 0 before.
    """

    def __init__(self, loops: Loops, walls: Walls, late: int) -> None:
        """Start.

        Args:
            loops: The loops.
            walls: Their walls.
            late: Period from which a turning point is late.
        """
        n = walls.size
        self._late = late
        self.whole, self.late = Line(n), Line(n)
        self._loops = loops
        self._period = walls.period
        self._full = walls.torque_limit - walls.torque_step  # from here on the limit has acted
        limited = bool(np.isfinite(walls.torque_limit[0]))
        self._limited = np.zeros(n, dtype=np.bool_) if limited else None
        self.saturating: NDArray[np.bool_] | None = None
        self._before = loops.bodies.velocity.copy()
        self._position = loops.bodies.position.copy()
        self._turned = np.empty(n, dtype=np.bool_)
        self._product = np.empty(n)
        self._memory: FloatArray | None = None
        if loops.lanes is not None:
            self._memory = loops.lanes.seen(self._before, self._position)
        self._seen: list[tuple[IntArray, FloatArray, FloatArray, FloatArray]] = []
        self._when: list[FloatArray] = []
        self.count = np.zeros(n, dtype=np.int64)
        self.least = np.full(n, np.inf)
        self.greatest = np.zeros(n)

    def run(self, periods: int) -> None:
        """Simulate some periods, and watch them."""
        if self._memory is None:
            self._loops.run(periods, self.watch)
            return
        memory = self._memory
        turned = np.empty((5, memory.shape[1] * periods))  # room for all; hardly any is touched
        count = self._loops.run_watched(periods, lane_rows.TURNINGS, memory, turned)
        if count:
            index, when, before, after, position = turned[:, :count]
            self._seen.append((index.astype(np.intp), before, after, position))
            self._when.append(when)
        if self._limited is not None:
            np.not_equal(memory[lane_rows.LIMITED], 0.0, self._limited)
            memory[lane_rows.LIMITED] = 0.0

    def watch(self) -> None:
        """Process the period that has just passed."""
        loops, before = self._loops, self._before
        position, velocity = loops.bodies.position, loops.bodies.velocity
        np.multiply(before, velocity, self._product)
        np.less(self._product, 0.0, self._turned)
        index = self._turned.nonzero()[0]
        if index.size:
            self._seen.append((index, before[index], velocity[index], self._position[index]))
            self._when.append(np.full(index.size, float(loops.k)))
        if self._limited is not None:
            np.absolute(loops.torque, self._product)
            np.greater_equal(self._product, self._full, self._turned)
            np.logical_or(self._limited, self._turned, self._limited)
        # A body at rest between two moves keeps the sign of its last velocity.
        np.not_equal(velocity, 0.0, self._turned)
        np.copyto(before, velocity, where=self._turned)
        np.copyto(self._position, position)

    def gather(self) -> None:
        """Process the turning points since the last call."""
        if self._limited is not None:
            self.saturating = self._limited.copy()
            self._limited[:] = False
        if not self._seen:
            return
        index, before, after, position = (
            np.concatenate(arrays) for arrays in zip(*self._seen, strict=True)
        )
        when = np.concatenate(self._when)
        self._seen.clear()
        self._when.clear()
        # The number of earlier turning points of each body, in order of time.
        order = np.argsort(index, kind="stable")
        index = index[order]
        new = np.bincount(index, minlength=self.count.size)
        first = np.cumsum(new) - new
        number = self.count[index] + np.arange(index.size) - first[index]
        self.count += new
        order, index = order[number >= _SETTLING], index[number >= _SETTLING]
        before, after, t = before[order], after[order], when[order]
        moved = 0.5 * self._period[index] * before * before / (before - after)
        amplitude = np.abs(position[order] + moved)
        amplitude = np.maximum(amplitude, np.finfo(np.float64).tiny)
        np.minimum.at(self.least, index, amplitude)
        np.maximum.at(self.greatest, index, amplitude)
        y = np.log(amplitude)
        self.whole.add(index, t, y)
        late = t >= self._late
        self.late.add(index[late], t[late], y[late])
