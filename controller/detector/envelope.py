"""Divides a record into pieces, each of which is one oscillation that grows, lasts or decays.

A growing or decaying sinusoid is fitted to the whole record. Where a cycle differs from the fit,
the record is divided, and its two pieces are judged in turn. So each piece is as long as possible,
and the fit needs no turning points: few samples in a cycle, an amplitude of a few counts, an
offset, a drift and noise hardly change the growth that it finds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CYCLES: Final = 2.5
"""Smallest number of cycles of an oscillation"""
SMALLEST: Final = 1.5
"""Smallest amplitude [counts]"""
_IRREGULAR: Final = 0.012
"""Largest part of the amplitude by which the cycles differ from the fit, rms, more than allowed"""
_COUNTS: Final = 0.25
"""Allowed is this part of a count,"""
_NOISE: Final = 1.5
"""and so much of what white noise of the size of the remainder makes,"""
_MOST: Final = 0.15
"""but at most this part of the amplitude"""
_EXPLAINED: Final = 0.5
"""Largest remainder over the amplitude, rms"""
_TORQUE: Final = 0.25
"""Largest part of the torque by which its cycles differ from an oscillation with the motion, rms"""
_FAINT: Final = 0.25
"""Smallest amplitude in a spectrum over the largest one: a faster motion is preferred from it on"""
_FLOOR: Final = 0.02
"""Smaller amplitudes over the largest one have the weight of this one"""
_BESIDE: Final = 0.3
"""Irregularity up to which a motion of another frequency is looked for beside the first"""
_APART: Final = 1.6
"""Smallest ratio of two such frequencies: closer ones are one motion whose amplitude changes"""
_FEWEST: Final = 12
"""Smallest number of samples of a piece"""
_DEEPER: Final = 3
"""Number of times that a piece of few cycles is divided: a faster motion may be in it"""
_UNEVEN: Final = 8
"""Ratio of a piece to the smallest one that it is divided into"""
_DENSE: Final = 48
"""Samples in a cycle that are enough for a fit"""
_STEPS: Final = 12
"""Largest number of steps of a fit"""
_HOPELESS: Final = 4
"""Steps after which a fit must explain the motion"""


class Piece(NamedTuple):
    """Samples ``start`` up to, but without, ``end``, and their oscillation."""

    start: int
    end: int
    rate: complex
    """Growth [1/s] and, as imaginary part, angular frequency [rad/s]"""
    phasor: complex = 0j
    """The oscillation in the middle [rad]"""
    error: float = math.inf
    """Standard error of the growth [1/s]"""
    irregular: float = math.inf
    """Part of the amplitude by which the cycles differ from the fit, rms, more than allowed"""
    pull: complex = complex(math.nan)
    """Torque over position, as phasors [N·m/rad]; NaN: not known; 0: it is another motion's"""
    split: int = 0
    """Sample at which the piece should be divided"""

    @property
    def amplitude(self) -> float:
        """Return the amplitude in the middle [rad]."""
        return abs(self.phasor)

    @property
    def growth(self) -> float:
        """Return the growth of the amplitude's logarithm in a cycle [1]."""
        return math.tau * self.rate.real / self.rate.imag

    def cycles(self, period: float) -> float:
        """Return the number of cycles, for a time between samples [s]."""
        return (self.end - self.start) * period * self.rate.imag / math.tau


def pieces(positions: Array, torques: Array | None, period: float, step: float) -> Iterator[Piece]:
    """Yield the oscillations of a record, in order of time.

    Args:
        positions: Shape (n,) [rad]; finite.
        torques: Commanded with each sample, shape (n,) [N·m]; finite; None: not known.
        period: T [s]
        step: Encoder count [rad]; 0: none.
    """
    stack = [(0, positions.size, _DEEPER)]
    while stack:
        start, end, deeper = stack.pop()
        x = positions[start:end]
        if x.size < _FEWEST or np.ptp(x) <= 2.0 * SMALLEST * step:
            continue
        piece = _oscillation(x, None if torques is None else torques[start:end], step)
        cycles = piece.cycles(1.0)
        if piece.irregular <= _IRREGULAR and cycles >= CYCLES:
            if piece.amplitude > SMALLEST * step:
                yield piece._replace(
                    start=start, end=end, rate=piece.rate / period, error=piece.error / period
                )
            continue
        few = cycles < 2.0 * CYCLES
        if deeper or not few:
            middle = start + piece.split
            stack += [(middle, end, deeper - few), (start, middle, deeper - few)]


def _oscillation(x: Array, u: Array | None, step: float) -> Piece:
    """Return the main oscillation of a motion, whose time counts in samples.

    Another one beside it is removed, if that makes it regular.
    """
    main = _fitted(x, u, step)
    if _IRREGULAR < main.irregular < _BESIDE:
        other = _fitted(x - _wave(main), None, step)
        if not 1.0 / _APART < other.rate.imag / main.rate.imag < _APART:
            alone = _fitted(x - _wave(other), u, step)
            if alone.irregular <= _IRREGULAR:
                return alone
    return main


def _wave(piece: Piece) -> Array:
    t = np.arange(piece.end) - 0.5 * (piece.end - 1)
    wave: Array = (piece.phasor * np.exp(piece.rate * t)).real
    return wave


def _fitted(x: Array, u: Array | None, step: float) -> Piece:
    """Fit a growing or decaying sinusoid on a parabola, so that each cycle has the same weight."""
    n = x.size
    slow = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, n), 3))[0]
    w = _fastest(x - slow @ (slow.T @ x))
    # Means of several samples are enough of a slow motion.
    k = max(1, int(math.tau / w / _DENSE))
    slow, x = _means(slow, k), _means(x, k)
    t = k * (np.arange(x.size) - 0.5 * (x.size - 1))
    none = Piece(0, n, complex(0.0, w), split=n // 2)
    rate, scale, change, weight = none.rate, 1.0 / n, math.inf, np.ones(x.size)
    for tried in range(_STEPS):
        wave = np.exp(rate * t)
        basis = np.column_stack([slow, wave.real, wave.imag])
        solved = _solved(basis, x, weight)
        phasor = complex(solved[3], -solved[4])
        size = abs(phasor) * np.exp(rate.real * t)
        size = np.maximum(size, max(_FLOOR * float(size.max()), 4.0 * step, 1e-300))
        left = (x - basis @ solved) / size
        remainder = math.sqrt(float(left @ left) / x.size)
        if change < 1e-3 * scale:
            break
        if tried >= _HOPELESS and remainder > _EXPLAINED:
            return none
        # A step of Gauss and Newton
        weight = float(size.min()) / size
        moved = phasor * wave * t * scale
        found = _solved(np.column_stack([basis, moved.real, -moved.imag]), x, weight)
        way = scale * complex(found[5], found[6])
        change = abs(way)
        rate += way * min(1.0, 2.0 * scale / max(change, 1e-300))
        if not (0.3 * w < rate.imag < min(2.0 * w, 3.0) and abs(rate.real) < 0.5 * rate.imag):
            return none
    if not (remainder < _EXPLAINED and phasor):
        return none
    cycles = max(3, round(n * rate.imag / math.tau))
    edges = np.linspace(0, x.size, cycles + 1).astype(int)
    turn = 2.0 * np.exp(-1j * rate.imag * t)

    def differing(values: Array) -> Array:
        """Return the part of each cycle that oscillates, as an amplitude."""
        each: Array = np.abs(np.add.reduceat(values * turn, edges[:-1])) / np.diff(edges)
        return each

    each = differing(left)
    irregular = math.sqrt(float(each @ each) / max(0.5, cycles - 2.0))
    noise = _NOISE * remainder * math.sqrt(2.0 * cycles / x.size)
    allowed = min(_MOST, noise + _COUNTS * step / float(size.min()))
    worst = int(np.argmax(each))
    split = int(edges[worst + (worst < 0.5 * cycles)]) * k
    pull = complex(math.nan)
    if u is not None:
        u = _means(u, k)
        solved = _solved(basis, u, weight)
        pull = complex(solved[3], -solved[4]) / phasor
        other = differing((u - basis @ solved) / size - pull.real * left)
        if other @ other > cycles * (_TORQUE * abs(pull)) ** 2:
            pull = 0j
    return none._replace(
        rate=rate,
        phasor=phasor,
        error=irregular * math.sqrt(6.0 / cycles) / n,
        irregular=max(0.0, irregular - allowed),
        pull=pull,
        split=n // 2
        if irregular - allowed <= _IRREGULAR
        else min(max(split, n // _UNEVEN), n - n // _UNEVEN),
    )


def _fastest(x: Array) -> float:
    """Return the angular frequency of the largest speed in a spectrum [rad a sample], > 0."""
    n = x.size
    sizes = np.abs(np.fft.rfft(x * np.hanning(n + 2)[1:-1], 4 * n))
    sizes[:6] = 0.0  # less than 1.5 cycles
    sizes[sizes < _FAINT * sizes.max()] = 0.0
    return 0.25 * math.tau * max(6, int(np.argmax(sizes * np.arange(sizes.size)))) / n


def _means(values: Array, k: int) -> Array:
    """Return the means of ``k`` rows each."""
    m = values.shape[0] // k
    return np.asarray(values[: m * k].reshape(m, k, *values.shape[1:]).mean(axis=1), np.float64)


def _solved(columns: Array, values: Array, weight: Array) -> Array:
    """Return the weighted least-squares solution, by the few normal equations."""
    heavy = (columns * (weight * weight)[:, None]).T
    found = np.linalg.lstsq(heavy @ columns, heavy @ values, rcond=1e-14)[0]
    return np.asarray(found, np.float64)
