"""Fills the table of the one-sided limit so that its interpolation underestimates the limit.

It computes the nodes, samples every cell at random places, and lowers the cell's nodes until the
interpolation lies below the computed values. It leaves out cells where the interpolation would be
far too low, and cells that reach to where no stiffness is allowed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptic_wall.controller.theory import critical_stiffness, max_virtual_damping
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.controller.theory.one_sided import one_sided_limit
from haptic_wall.controller.theory.one_sided_table import (
    DEVICE,
    GRIDS,
    LESS,
    LONG_CONTACT,
    MAX_DELTA,
    MAX_OF_CEILING,
    OFFSET,
    PER_ROOT,
    UNIT,
    Grid,
    Point,
    grid_of,
    one_sided_limit_tabulated,
)

_Array = NDArray[np.uint8] | NDArray[np.uint16]

_BATCH = 300  # settings that one task computes
# Nodes extend a little beyond the domain of the table, for whole cells at its edge.
_NODE_OF_CEILING, _NODE_DELTA = 0.978, 0.16
_LOOKS = 5  # places sampled in each cell, its middle among them
# In a cell at the edge of the domain, places beyond the edge do not count: largest number of draws
# until one does.
_DRAWS = 40
_BELOW = 2e-3  # distance of the interpolation below the computed fraction
# A cell is unusable if the interpolation stays below this part of the computed value; if it has to
# be lowered by more than this part; or if the least fraction at a node over the greatest is less
# than this.
_LOWEST, _MOST_LOWERED, _STEEP = 0.96, 0.04, 0.7
_LEAST = 0.03  # fraction at a node below which a cell is left out
# Near the ceiling a few samples miss the scallops that lie across a cell. Above this fraction of
# the ceiling, and where the least fraction at a node is below this part of the greatest, so many
# more samples are taken, most of them near the edges, and the interpolation is lowered further.
_NEAR_CEILING, _SLOPING, _MORE_LOOKS, _FURTHER_BELOW = 0.7, 0.9, 90, 8e-3


def settings_at(grid: Grid, coordinates: FloatArray, samples: int) -> Point:
    """Convert coordinates (axes × settings) to settings."""
    first, second, third = coordinates
    lag = np.exp(third)
    delay = np.maximum(lag - OFFSET, 0.0)
    n = np.full_like(delay, samples)
    if grid.kind == "plain":
        delta = second**2 / lag
        return Point(delta, first**2, delay, max_virtual_damping(1.0, delta, 1.0, delay, n))
    left = np.maximum(2.0 - first / LONG_CONTACT, 1e-9)
    length = np.where(first < LONG_CONTACT, first, LONG_CONTACT / left)
    both = (PER_ROOT / (length / lag + LESS)) ** 2
    # the ceiling rises with delta, more slowly than delta itself
    device, delta = second * both / DEVICE, np.zeros_like(both)
    for _ in range(12):
        delta = device * max_virtual_damping(1.0, delta, 1.0, delay, n)
    return Point(delta, (1 - second) * both, delay, max_virtual_damping(1.0, delta, 1.0, delay, n))


def between(grid: Grid, cell: IntArray, place: FloatArray) -> FloatArray:
    """Return the coordinates of places in cells, axes × points."""
    first, last, nodes = (np.array(column)[:, None] for column in zip(*grid.axes, strict=True))
    result: FloatArray = first + (cell + place) * ((last - first) / (nodes - 1))
    return result


def computed_share(delta: FloatArray, beta: FloatArray, delay: FloatArray, n: int) -> FloatArray:
    """Return the computed one-sided limit over the exact one; NaN where nothing is stable."""
    exact = critical_stiffness(1.0, delta, beta, 1.0, delay, np.full_like(delta, n))
    limit = one_sided_limit(1.0, delta, beta, 1.0, delay, n)
    share: FloatArray = np.where(exact > 0, limit / np.where(exact > 0, exact, 1.0), np.nan)
    return share


def looked_up(
    inertia: ArrayLike,
    damping: ArrayLike,
    virtual_damping: ArrayLike,
    period: ArrayLike,
    delay: ArrayLike,
    samples: ArrayLike = 1,
) -> FloatArray:
    """Return the looked-up limit [N·m/rad]; arguments as of ``one_sided_limit``."""
    wall = (inertia, damping, virtual_damping, period, delay, samples)
    exact = np.asarray(critical_stiffness(*wall))
    ceiling = max_virtual_damping(inertia, damping, period, delay, samples)
    ceiling = np.broadcast_to(ceiling, exact.shape)
    return one_sided_limit_tabulated(*wall, exact, ceiling)


def parts(executor: Executor) -> Iterator[tuple[str, dict[str, _Array]]]:
    """Yield the table part by part: a message, and the arrays to store."""
    for n, name in product((1,), GRIDS):
        nodes, good = _filled(name, n, executor)
        said = f"N = {n}, {name}: {nodes.size} nodes, {np.count_nonzero(good)} cells usable"
        yield said, {f"{name}_{n}": nodes, f"{name}_{n}_good": np.packbits(good)}


class _Look(NamedTuple):
    """One sampled place in each of many cells, and the fraction computed there."""

    cell: IntArray
    place: FloatArray
    share: FloatArray


def _filled(name: str, n: int, executor: Executor) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Return a grid's nodes as stored (flat), and which of its cells are good."""
    grid = GRIDS[name]
    mesh = np.meshgrid(*(axis.values() for axis in grid.axes), indexing="ij")
    computed = _shares(name, np.stack([m.ravel() for m in mesh]), n, True, executor)
    # a cell with a NaN node has a NaN minimum too
    corners = computed.reshape(grid.shape)
    least, most = _of_corners(np.minimum, corners), _of_corners(np.maximum, corners)
    good: NDArray[np.bool_] = (least > _LEAST) & (least > _STEEP * most)
    random = np.random.default_rng(n)
    looks = [_look(name, good, n, random if i else None, executor) for i in range(_LOOKS)]
    stored, good = _corrected(grid, np.nan_to_num(computed), good, looks, _BELOW)
    if grid.kind == "aligned":  # little virtual damping
        return stored, good
    doubtful = good & _sloping_near_ceiling(grid, stored / UNIT)
    random = np.random.default_rng([n, 1])
    looks = [_look(name, doubtful, n, random, executor, True) for _ in range(_MORE_LOOKS)]
    return _corrected(grid, stored / UNIT, good, looks, _FURTHER_BELOW)


def _sloping_near_ceiling(grid: Grid, nodes: FloatArray) -> NDArray[np.bool_]:
    """Select the cells of a plain grid that need more samples."""
    corners = nodes.reshape(grid.shape)
    least, most = _of_corners(np.minimum, corners), _of_corners(np.maximum, corners)
    near = grid.axes[0].values()[1:] ** 2 > _NEAR_CEILING
    sloping: NDArray[np.bool_] = (least < _SLOPING * most) & near[:, None, None]
    return sloping


def _corrected(
    grid: Grid, nodes: FloatArray, good: NDArray[np.bool_], looks: Sequence[_Look], below: float
) -> tuple[NDArray[np.uint16], NDArray[np.bool_]]:
    """Lower the nodes to the sampled values; return them as stored, and the cells still good."""
    failed = np.zeros_like(good)
    for look in looks:
        excess = grid.interpolate(nodes, look.cell, look.place) - (1 - below) * look.share
        excess[look.share == 1] = 0.0
        low = excess > _MOST_LOWERED * look.share
        failed[tuple(look.cell[:, low])] = True
        nodes = _lowered(grid, nodes, look.cell[:, ~low], excess[~low])
    stored = np.floor(np.clip(nodes, 0.0, 1.0) * UNIT).astype(np.uint16)
    for look in looks:
        found = grid.interpolate(stored / UNIT, look.cell, look.place)
        failed[tuple(look.cell[:, found < _LOWEST * look.share])] = True
    # a few samples miss some failures: the neighbours of a failed cell are doubtful
    return stored, good & ~_beside(failed)


def _shares(
    name: str, coordinates: FloatArray, n: int, at_nodes: bool, executor: Executor
) -> FloatArray:
    """Return computed fractions at coordinates of a grid (axes × points); see ``_task``."""
    # group contacts of similar length, since a batch takes as long as its longest
    order = np.argsort(coordinates[0], kind="stable")
    parts = np.array_split(order, order.size // _BATCH + 1)
    result = np.empty(order.size)
    tasks = [executor.submit(_task, name, coordinates[:, part], n, at_nodes) for part in parts]
    for part, task in zip(parts, tasks, strict=True):
        result[part] = task.result()
    return result


def _task(name: str, coordinates: FloatArray, n: int, at_nodes: bool) -> FloatArray:
    """Return computed fractions at coordinates of a grid; NaN outside the grid's domain.

    ``at_nodes`` extends the domain a little; there the result is 1 without virtual damping, even
    where without any damping nothing is stable.
    """
    p = settings_at(GRIDS[name], coordinates, n)
    if at_nodes:
        wanted = (p.of_ceiling < _NODE_OF_CEILING) & (p.delta < _NODE_DELTA) & (p.of_ceiling > 0)
    else:
        wanted = _looked_up(name, p)
    result = np.where(at_nodes & (p.of_ceiling <= 0), 1.0, np.nan)
    delta, of_ceiling, delay, ceiling = (a[wanted] for a in p)
    result[wanted] = computed_share(delta, of_ceiling * ceiling, delay, n)
    return result


def _looked_up(name: str, p: Point) -> NDArray[np.bool_]:
    """Whether each setting lies in the table's domain, and in this grid."""
    wanted = (p.of_ceiling <= MAX_OF_CEILING) & (p.delta <= MAX_DELTA)
    wanted &= grid_of(p.of_ceiling, p.delay)[name]
    return wanted


def _look(
    name: str,
    good: NDArray[np.bool_],
    n: int,
    random: np.random.Generator | None,
    executor: Executor,
    at_edges: bool = False,
) -> _Look:
    """Sample a place in each good cell, random or the middle; drop places outside the domain."""
    grid, cell = GRIDS[name], np.stack(np.nonzero(good))
    place = np.full(cell.shape, 0.5)
    if random is not None:
        left = np.arange(cell.shape[1])
        for _ in range(_DRAWS):
            drawn = random.random((3, left.size))
            place[:, left] = 0.5 * (1.0 - np.cos(np.pi * drawn)) if at_edges else drawn
            point = settings_at(grid, between(grid, cell[:, left], place[:, left]), n)
            left = left[~_looked_up(name, point)]
    share = _shares(name, between(grid, cell, place), n, False, executor)
    wanted = np.isfinite(share)
    return _Look(cell[:, wanted], place[:, wanted], share[wanted])


def _beside(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return these cells and their neighbours along each axis."""
    result = cells.copy()
    for axis in range(cells.ndim):
        along, source = np.moveaxis(result, axis, 0), np.moveaxis(cells, axis, 0)
        along[1:] |= source[:-1]
        along[:-1] |= source[1:]
    return result


def _of_corners(ufunc: np.ufunc, nodes: FloatArray) -> FloatArray:
    """Apply ``ufunc`` over the eight nodes of each cell."""
    for axis in range(nodes.ndim):
        along = np.moveaxis(nodes, axis, 0)
        nodes = np.moveaxis(ufunc(along[:-1], along[1:]), 0, axis)
    return nodes


def _lowered(grid: Grid, nodes: FloatArray, cell: IntArray, excess: FloatArray) -> FloatArray:
    """Lower each node by the greatest excess of the cells around it."""
    down = np.zeros(grid.shape)
    for corner in product((0, 1), repeat=3):
        np.maximum.at(down, tuple(cell + np.array(corner)[:, None]), excess)
    return nodes - down.ravel()
