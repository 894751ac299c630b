"""Solves the boundary with every branch of its curve: for any damping and velocity difference.

With long differences or heavy damping the lowest crossing can lie on another branch than the first,
or be a real pole at ``z = -1``. This solver scans the first turns of ``F`` for sign changes and
refines each. It takes a hundred times as long as ``first_branch``, the principal solver.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.loop import HeldLoop
from haptic_wall.controller.theory.roots import dips, refined


def ceiling(loop: HeldLoop) -> FloatArray:
    """Return the virtual damping at which the lowest crossing reaches zero stiffness.

    Args:
        loop: Settings along the first axis, one column.
    """
    # alpha = 0 where F is parallel to D = U 2 sin(N w/2) / N; the zeros of D are no solutions

    def along(w: FloatArray) -> NDArray[np.complex128]:
        """Return F conj(U)."""
        parallel: NDArray[np.complex128] = loop.inverse_plant(w) * np.exp(
            0.5j * (loop.samples * w - np.pi)
        )
        return parallel

    w, found = _crossings(loop, lambda w: along(w).imag)
    size = 2.0 * np.sin(0.5 * loop.samples * w) / loop.samples
    beta = along(w).real / np.where(size != 0, size, np.finfo(np.float64).tiny)
    constant, reach = _real_pole(loop)
    by_real = np.where(reach > 0, constant / np.where(reach > 0, reach, 1.0), np.inf)
    by_curve: FloatArray = np.min(np.where(found & (beta > 0), beta, np.inf), axis=1)
    return np.minimum(by_curve, by_real)


def crossing(loop: HeldLoop, beta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest crossing at ``beta`` as (alpha, w).

    Args:
        loop: Settings along the first axis, one column.
        beta: Virtual damping, -delta < beta < ceiling; flat.
    """
    column = beta[:, None]
    w, found = _crossings(
        loop, lambda w: loop.inverse_plant(w).imag - column * loop.difference(w).imag
    )
    alpha = loop.inverse_plant(w).real - column * loop.difference(w).real
    constant, reach = _real_pole(loop)
    alpha = np.column_stack([np.where(found, alpha, np.inf), constant - reach * beta])
    w = np.column_stack([w, np.full_like(beta, np.pi)])
    alpha = np.where(alpha > 0, alpha, np.inf)
    rows, lowest = np.arange(beta.size), np.argmin(alpha, axis=1)
    least = alpha[rows, lowest]
    stable = np.isfinite(least)
    return np.where(stable, least, 0.0), np.where(stable, w[rows, lowest], 0.0)


def _real_pole(loop: HeldLoop) -> tuple[FloatArray, FloatArray]:
    """Return the line ``alpha + reach beta = constant`` on which a pole is at z = -1.

    Returns:
        (constant, reach); constant is inf where the line lies at negative stiffness.
    """
    n = loop.samples[:, 0]
    reach = np.where(n % 2 == 1, 2.0 / n, 0.0)
    constant = loop.inverse_plant(np.full_like(loop.delta, np.pi))[:, 0].real
    return np.where(constant > 0, constant, np.inf), reach


def _crossings(
    loop: HeldLoop, function: Callable[[FloatArray], FloatArray]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Find the first zeros of ``function`` over 0 < w < pi; the function is negative at w = 0+.

    Returns:
        (w, found), both settings × crossings; w has no meaning where not found.
    """
    # two turns of the delayed plant, at 32 points or more per turn of the difference
    span = np.minimum(np.pi, 4 * np.pi / (loop.delay + 1))
    steps = 80 + int(np.max(16 / np.pi * loop.samples * span))
    grid = span * np.linspace(0.0, 1.0, steps + 1)
    # Near the ceiling, and where the curve turns back, one cell holds two zeros. The division by w
    # removes the zero at w = 0.
    first = grid[:, :1] + 1e-3 * grid[:, 1:2]
    hidden = dips(lambda w: function(w) / w, np.column_stack([first, grid[:, 1:]]))
    grid = np.sort(np.column_stack([grid, hidden]), axis=1)
    above = function(grid[:, 1:]) > 0
    before = np.column_stack([np.zeros(span.size, dtype=np.bool_), above[:, :-1]])
    # stable sort: the crossings first, in order of frequency. With heavy damping any of them can be
    # the lowest, because the long difference turns once between its N zeros.
    most = max(int(np.max(np.count_nonzero(above != before, axis=1))), 1)
    cell = np.argsort(above == before, axis=1, kind="stable")[:, :most]
    rows = np.arange(span.size)[:, None]
    found = above[rows, cell] != before[rows, cell]
    sign = np.where(before[rows, cell], -1.0, 1.0)
    return refined(lambda w: sign * function(w), grid[rows, cell], grid[rows, cell + 1]), found
