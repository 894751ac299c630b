"""Looks up the one-sided limit in a table of its fraction of the exact limit.

In dimensionless form the fraction depends on ``delta = b T / m``, ``beta = B T / m`` (here as a
fraction of the damping ceiling), the delay in periods, and N. Three grids hold it, each in
coordinates that make interpolation easy:

- short delays, little virtual damping: a contact has a whole number of samples, which makes
  scallops in the fraction, one for each additional sample. One axis is the length of the contact,
  so that the scallops lie along the grid;
- short delays, much virtual damping: few scallops, on a fine grid;
- long delays: smooth.

The stored values are lowered until the interpolation lies below the computed limit (in 18,000
random settings it is at most 0.06 % above). Cells where that costs more than 4 % are left out, and
there the limit is computed. With a little more inertia or delay the limit falls by up to 5.5 %
(over 1 % in 9 of 3,000 plants): the guard's margin covers this. The lowest value of each
neighbourhood would cost as much everywhere.

A computed limit takes a millisecond of simulated contacts, and a decision needs hundreds: those of
64 delays took 84 to 286 ms, with the table 1.2.
``scripts/study one_sided_table`` makes the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.dimensionless import settings
from haptic_wall.controller.theory.exact import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.one_sided import one_sided_limit

TABLE = Path(__file__).with_name("one_sided_table.npz")
UNIT = np.iinfo(np.uint16).max
"""Stored value of a fraction of 1"""

MAX_DELTA, MAX_OF_CEILING = 0.1, 0.95  # the table's domain, without negative virtual damping
_SHORT, _LONG = 7.0, 60.0  # delays in periods, where the grids meet and end
_MUCH = 0.3  # fraction of the ceiling where the grids for short delays meet

# The contact lasts about (d + OFFSET)(2.65/sqrt(e) - 1) samples, with e the damping as a fraction
# of the ceiling: that of the wall plus 0.93 of the device's (fitted to 1200 computed limits with an
# error of a tenth of a sample; the better the fit, the coarser the grid may be).
OFFSET, PER_ROOT, LESS, DEVICE = 0.6, 2.65, 1.0, 0.93
# Up to this length the axis is the length; beyond, it reaches twice that at infinite length.
LONG_CONTACT = 10.0


class Point(NamedTuple):
    """Coordinates in the table, as flat arrays."""

    delta: FloatArray
    of_ceiling: FloatArray
    """Virtual damping as a fraction of the ceiling"""
    delay: FloatArray
    ceiling: FloatArray
    """Dimensionless virtual damping above which nothing is stable"""


class Axis(NamedTuple):
    """Evenly spaced nodes."""

    first: float
    last: float
    nodes: int

    def values(self) -> FloatArray:
        """Return the nodes."""
        return np.linspace(self.first, self.last, self.nodes)


@dataclass(frozen=True, slots=True)
class Grid:
    """Three axes, and the conversion of settings to coordinates."""

    kind: Literal["aligned", "plain"]
    axes: tuple[Axis, Axis, Axis]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return the number of nodes along each axis."""
        a, b, c = self.axes
        return a.nodes, b.nodes, c.nodes

    def coordinates(self, p: Point) -> FloatArray:
        """Convert settings to coordinates, axes × settings."""
        lag = p.delay + OFFSET
        if self.kind == "plain":
            # beyond the last node of the second axis the fraction is 1, as on the node
            friction = np.minimum(np.sqrt(p.delta * lag), self.axes[1].last)
            return np.stack([np.sqrt(p.of_ceiling), friction, np.log(lag)])
        device = DEVICE * p.delta / p.ceiling
        both = np.maximum(p.of_ceiling + device, np.finfo(np.float64).tiny)
        length = lag * np.maximum(PER_ROOT / np.sqrt(both) - LESS, 1e-3)
        folded = LONG_CONTACT * (2.0 - LONG_CONTACT / length)
        return np.stack(
            [np.where(length < LONG_CONTACT, length, folded), device / both, np.log(lag)]
        )

    def locate(self, coordinates: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return each point's cell (axes × points), and its place there, 0 to 1 on each axis."""
        first, last, nodes = (np.array(column)[:, None] for column in zip(*self.axes, strict=True))
        along = (coordinates - first) * ((nodes - 1) / (last - first))
        cell = np.clip(along.astype(np.int64), 0, nodes - 2)
        return cell, along - cell

    def interpolate(self, nodes: FloatArray, cell: IntArray, place: FloatArray) -> FloatArray:
        """Interpolate trilinearly between ``nodes`` (flat)."""
        b, c = self.shape[1:]
        base = (cell[0] * b + cell[1]) * c + cell[2]
        x, y, z = place
        result: FloatArray = np.zeros_like(x)
        for i, in_x in ((0, 1 - x), (b * c, x)):
            for j, in_y in ((0, in_x * (1 - y)), (c, in_x * y)):
                at = base + (i + j)
                result += in_y * ((1 - z) * nodes[at] + z * nodes[at + 1])
        return result


_LAG_0, _LAG_SHORT, _LAG_LONG = (float(np.log(d + OFFSET)) for d in (0.0, _SHORT, _LONG))
GRIDS: Mapping[str, Grid] = {
    "little": Grid(
        "aligned",
        (Axis(0.8, 2 * LONG_CONTACT, 193), Axis(0.0, 1.0, 13), Axis(_LAG_0, _LAG_SHORT, 25)),
    ),
    "much": Grid(
        "plain",
        (Axis(_MUCH**0.5, 0.978, 38), Axis(0.0, 0.88, 14), Axis(_LAG_0, _LAG_SHORT, 96)),
    ),
    "late": Grid(
        "plain",
        (Axis(0.0, 0.978, 32), Axis(0.0, 1.4, 22), Axis(_LAG_SHORT, _LAG_LONG, 12)),
    ),
}


def grid_of(of_ceiling: FloatArray, delay: FloatArray) -> dict[str, NDArray[np.bool_]]:
    """Return which settings each grid covers."""
    late, much = delay > _SHORT, of_ceiling > _MUCH
    return {"little": ~late & ~much, "much": ~late & much, "late": late}


class Stored(NamedTuple):
    """One grid's part of the table."""

    share: FloatArray
    """At the nodes, flat"""
    good: NDArray[np.bool_]
    """Whether a cell may be used; cells along each axis"""


@lru_cache(maxsize=1)
def _table() -> dict[str, Stored]:
    with np.load(TABLE) as file:
        found = {}
        for name, grid in GRIDS.items():
            cells = tuple(n - 1 for n in grid.shape)
            share = file[f"{name}_1"].reshape(grid.shape).ravel() / UNIT
            bits = np.unpackbits(file[f"{name}_1_good"], count=int(np.prod(cells)))
            found[name] = Stored(share, bits.reshape(cells).astype(np.bool_))
        return found


def tabulated_share(
    delta: FloatArray,
    beta: FloatArray,
    delay: FloatArray,
    samples: FloatArray,
    ceiling: FloatArray,
) -> FloatArray:
    """Return the one-sided limit as a fraction of the exact one, from the table; flat arrays.

    Args:
        delta: Dimensionless viscous damping b T / m.
        beta: Dimensionless virtual damping B T / m.
        delay: Total delay in periods.
        samples: N of the velocity difference.
        ceiling: Dimensionless virtual damping beyond which nothing is stable.

    Returns:
        The fraction, NaN where the table has none.
    """
    result = np.full_like(delta, np.nan)
    of_ceiling = beta / ceiling
    inside = (delta <= MAX_DELTA) & (of_ceiling >= 0) & (of_ceiling <= MAX_OF_CEILING)
    inside &= delay <= _LONG
    for name, here in grid_of(of_ceiling, delay).items():
        which = np.flatnonzero(here & inside & (samples == 1))
        if not which.size:
            continue
        grid, stored = GRIDS[name], _table()[name]
        point = Point(delta[which], of_ceiling[which], delay[which], ceiling[which])
        cell, place = grid.locate(grid.coordinates(point))
        good = stored.good[tuple(cell)] & (place.min(axis=0) > -1e-9)
        share = grid.interpolate(stored.share, cell, place)
        result[which] = np.where(good & (place.max(axis=0) < 1 + 1e-9), share, np.nan)
    return result


def one_sided_limit_tabulated(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    velocity_samples: ArrayLike,
    exact: FloatArray,
    ceiling: FloatArray,
) -> FloatArray:
    """Return the limit of ``one_sided_limit``, looked up where the table has it, else computed.

    A looked-up limit is at most 5 % lower than the computed one, mostly under 1 %, and at most 0.5
    % higher.

    Args:
        inertia: m > 0 [kg·m²].
        damping: Viscous damping b >= 0 [N·m·s/rad].
        virtual_damping: B [N·m·s/rad].
        period: T > 0 [s].
        delay: t_d >= 0, from the sample to its torque acting [s].
        velocity_samples: N of the velocity difference, >= 1.
        exact: ``critical_stiffness`` of each setting [N·m/rad].
        ceiling: ``max_virtual_damping`` of each setting [N·m·s/rad].

    Returns:
        Stiffness [N·m/rad] in the broadcast shape; 0 where none will do.

    Raises:
        ValueError: An argument is outside of its domain; the message names it.
    """
    s = settings(inertia, damping, virtual_damping, period, delay, velocity_samples)
    alpha, most = exact.ravel() / s.stiffness_unit, ceiling.ravel() / s.damping_unit
    # The period hardly counts in a longer delay: so many periods may be one.
    times = np.maximum((s.delay + OFFSET) / (_LONG + OFFSET), 1.0)
    delta, beta, late = s.delta * times, s.beta * times, np.minimum(s.delay, _LONG)
    n, ratio = np.maximum(np.round(s.samples / times), 1.0), np.ones_like(alpha)
    long = np.flatnonzero(times > 1.0)
    if long.size:
        most, short = most.copy(), [each[long] for each in (delta, beta, late, n)]
        most[long] = max_virtual_damping(1.0, short[0], 1.0, *short[2:])
        fewer = critical_stiffness(1.0, short[0], short[1], 1.0, *short[2:])
        np.divide(alpha[long], fewer, out=fewer, where=fewer > 0)
        ratio[long] = fewer
    share = tabulated_share(delta, beta, late, n, most)
    left = np.flatnonzero(np.isnan(share) & (alpha > 0))
    result = np.where(alpha > 0, share * alpha, 0.0)
    if left.size:
        delta, beta, late, n = (each[left] for each in (delta, beta, late, n))
        result[left] = ratio[left] * one_sided_limit(1.0, delta, beta, 1.0, late, n)
    return s.shaped(result * s.stiffness_unit)
