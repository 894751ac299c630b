"""A servo as a chain of masses behind its motor: state matrices, and its response over one period.

The motor turns the first mass; transmissions with stiffness and damping turn the next ones. With a
finite bandwidth of the current loop the torque follows what was commanded with a first-order lag.
The chain's states are speeds, twists of the transmissions and the lagging torque; the position of
the encoder's mass is the integral of its speed, which the response keeps apart: the pole at zero
is then exact, however slow the next one is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from haptic_wall.controller.theory.checks import (
    ComplexArray,
    FloatArray,
    IntArray,
    broadcast,
    not_negative,
    positive,
)

_LEAST_RATIO = 1e-9
"""Least damping ratio of a transmission"""


@dataclass(frozen=True, slots=True)
class Chain:
    """Parameters of chains with the same number of masses; arrays of one length each."""

    inertias: FloatArray
    """Inertias of the masses from the motor on, chains × masses [kg·m²]"""
    dampings: FloatArray
    """Viscous friction of each mass against the ground, chains × masses [N·m·s/rad]"""
    stiffnesses: FloatArray
    """Stiffnesses of the transmissions, chains × (masses - 1) [N·m/rad]"""
    transmission_dampings: FloatArray
    """Dampings of the transmissions, chains × (masses - 1) [N·m·s/rad]"""
    bandwidth: FloatArray | None = None
    """Bandwidth of the current loop [Hz]; None: the torque follows at once"""
    encoder: int = -1
    """Index of the mass that the encoder measures"""

    def take(self, index: IntArray) -> Chain:
        """Return the chains at ``index``."""
        bandwidth = None if self.bandwidth is None else self.bandwidth[index]
        return Chain(
            self.inertias[index],
            self.dampings[index],
            self.stiffnesses[index],
            self.transmission_dampings[index],
            bandwidth,
            self.encoder,
        )

    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return A, b and c of ``x' = A x + b u``, where ``c x`` is the encoder's speed.

        States: the speeds [rad/s], the twists [rad], and with a bandwidth the acting torque [N·m].
        """
        count, masses = self.inertias.shape
        twists = masses - 1
        size = masses + twists + (self.bandwidth is not None)
        a, b, c = np.zeros((count, size, size)), np.zeros((count, size)), np.zeros(size)
        c[self.encoder % masses] = 1.0
        for i in range(masses):
            a[:, i, i] -= self.dampings[:, i] / self.inertias[:, i]
        dampings = np.maximum(self.transmission_dampings, self._least_dampings())
        for i in range(twists):
            twist = masses + i
            a[:, twist, i], a[:, twist, i + 1] = 1.0, -1.0
            for mass, other, sign in ((i, i + 1, -1.0), (i + 1, i, 1.0)):
                per = 1.0 / self.inertias[:, mass]
                a[:, mass, twist] += sign * self.stiffnesses[:, i] * per
                a[:, mass, mass] -= dampings[:, i] * per
                a[:, mass, other] += dampings[:, i] * per
        if self.bandwidth is None:
            b[:, 0] = 1.0 / self.inertias[:, 0]
        else:
            rate = 2.0 * math.pi * self.bandwidth
            a[:, 0, -1] = 1.0 / self.inertias[:, 0]
            a[:, -1, -1], b[:, -1] = -rate, rate
        return a, b, c

    def _least_dampings(self) -> FloatArray:
        """Return what the transmissions are damped with at least [N·m·s/rad].

        Poles of an undamped chain are on the unit circle without a wall, where no crossing shows.
        """
        ease = 1.0 / self.inertias
        found: FloatArray = (
            2.0 * _LEAST_RATIO * np.sqrt(self.stiffnesses / (ease[:, 1:] + ease[:, :-1]))
        )
        return found


@dataclass(frozen=True, slots=True)
class Sampled:
    """Chains over one period under a held, delayed torque, in terms of delta = z - 1.

    The transfer from the commanded torque to the sampled position is
    ``z^-(whole + 1) numerator(delta) / (delta prod(delta - moved_poles))``.
    """

    moved_poles: ComplexArray
    """z - 1 of each pole but that of the position, chains × states"""
    numerator: FloatArray
    """Coefficients of rising powers of delta, chains × (states + 2)"""
    step: FloatArray
    """Transition of the states and the position over a period, less the identity; chains × n × n"""
    new: FloatArray
    """Change of states and position per torque of ``whole`` periods ago, chains × n"""
    old: FloatArray
    """Change per torque of the period before, which acts during the fraction; chains × n"""

    def take(self, index: IntArray) -> Sampled:
        """Return the chains at ``index``."""
        return Sampled(*(getattr(self, name)[index] for name in self.__slots__))

    def moved_zeros(self) -> ComplexArray:
        """Return z - 1 of each zero, chains × (states + 1); huge where a zero is far away."""
        count, order = self.numerator.shape[0], self.numerator.shape[1] - 1
        companion = np.zeros((count, order, order))  # of 1 / delta
        companion[:, 0] = -self.numerator[:, 1:] / self.numerator[:, :1]
        inner = np.arange(1, order)
        companion[:, inner, inner - 1] = 1.0
        inverse = np.linalg.eigvals(companion).astype(np.complex128)
        found = np.empty_like(inverse)
        np.divide(1.0, np.where(np.abs(inverse) < 1e-12, 1e-12, inverse), out=found)
        return found


def sampled(chain: Chain, period: FloatArray, fraction: FloatArray) -> Sampled:
    """Return chains over one period.

    Args:
        chain: The chains.
        period: T of each [s].
        fraction: Fraction of a period by which the torque comes later than the whole periods of the
            delay, 0 <= fraction < 1; of each chain.
    """
    step, new, old = _over_period(chain, period, fraction)
    numerator, _ = _polynomials(step, new, old)
    poles = np.linalg.eigvals(chain.matrices()[0] * period[:, None, None]).astype(np.complex128)
    return Sampled(np.expm1(poles), numerator, step, new, old)


def transfer(
    chain: Chain, period: FloatArray, fraction: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the numerator of ``sampled``, and what is below it over delta, by rising powers.

    Beside a pole that is hardly damped these coefficients lose digits, and the poles do not; they
    take half the time.
    """
    return _polynomials(*_over_period(chain, period, fraction))


def _over_period(
    chain: Chain, period: FloatArray, fraction: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ``step``, ``new`` and ``old`` of ``sampled``."""
    a, b, c = chain.matrices()
    count, size, _ = a.shape
    # states, position, held torque
    whole = np.zeros((count, size + 2, size + 2))
    whole[:, :size, :size], whole[:, :size, -1], whole[:, size, :size] = a, b, c
    whole *= period[:, None, None]
    scale = _scale(chain, period)
    scales = scale[:, :, None] / scale[:, None]
    full = late = moved(whole * scales) / scales
    if fraction.any():
        late = moved(whole * ((1.0 - fraction)[:, None, None] * scales)) / scales
    new = late[:, :-1, -1]
    return full[:, :-1, :-1], new, full[:, :-1, -1] - new


_BLOCK = 256
"""Matrices whose products fit into the processor's cache"""


def _scale(chain: Chain, period: FloatArray) -> FloatArray:
    """Return factors of states, position and torque with which their rates are alike.

    Twists count by the rate of their joint, and a torque by the speed that it makes in a period.
    """
    ease = 1.0 / chain.inertias
    twists = np.sqrt(chain.stiffnesses * (ease[:, 1:] + ease[:, :-1]))
    torque = (ease[:, 0] * period)[:, None]
    lag = torque[:, : chain.bandwidth is not None]
    found: FloatArray = np.concatenate(
        [np.ones_like(ease), twists, lag, 1.0 / period[:, None], torque], axis=1
    )
    return found


def moved(matrices: FloatArray) -> FloatArray:
    """Return exp(A) - I of many small matrices at once; shape (n, size, size).

    Taylor's series of A / 2^s to A^15, s times squared. scipy's ``expm`` takes them one by one.

    Source: Paterson and Stockmeyer (1973), for few products.
    """
    blocks = [matrices[i : i + _BLOCK] for i in range(0, len(matrices), _BLOCK)]
    return np.concatenate([_moved(block) for block in blocks] or [matrices])


def _moved(matrices: FloatArray) -> FloatArray:
    size = float(np.abs(matrices).sum(axis=2).max(initial=0.0))
    squarings = max(math.frexp(size)[1] + 1, 0)
    small = matrices * 0.5**squarings
    square = small @ small
    cube, fourth = square @ small, square @ square
    found = np.zeros_like(small)
    diagonal = np.arange(small.shape[1])
    for k in range(12, -1, -4):
        term = [1.0 / math.factorial(k + i) for i in range(4)]
        found = found @ fourth if k < 12 else found
        found += term[1] * small + term[2] * square + term[3] * cube
        if k:
            found[:, diagonal, diagonal] += term[0]
    for _ in range(squarings):
        found = 2.0 * found + found @ found
    result: FloatArray = found
    return result


def _polynomials(
    step: FloatArray, new: FloatArray, old: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the last row of adj(delta I - step) (old + z new), and the determinant over delta.

    Both by rising powers of delta; ``step`` has a determinant of 0.

    Source: Faddeev and LeVerrier's recursion.
    """
    size = step.shape[1]
    below, numerator = np.ones((len(step), size)), np.zeros((len(step), size + 1))
    matrix = np.broadcast_to(np.eye(size), step.shape)
    both = old + new
    for k in range(size - 1, -1, -1):
        row = matrix[:, -1]
        numerator[:, k] += np.einsum("ij,ij->i", row, both)
        numerator[:, k + 1] += np.einsum("ij,ij->i", row, new)  # z = 1 + delta
        if k:
            product = step @ matrix
            below[:, k - 1] = -np.trace(product, axis1=1, axis2=2) / (size - k)
            matrix = product + below[:, k - 1, None, None] * np.eye(size)
    return numerator, below


def one_mass(inertia: ArrayLike, damping: ArrayLike) -> tuple[Chain, tuple[int, ...]]:
    """Return chains of a motor alone, and the shape that their parameters broadcast to."""
    m, b = broadcast(inertia=positive("inertia", inertia), damping=not_negative("damping", damping))
    none = np.empty((m.size, 0))
    return Chain(np.reshape(m, (-1, 1)), np.reshape(b, (-1, 1)), none, none), m.shape


def two_masses(
    inertia: ArrayLike,
    damping: ArrayLike,
    load_inertia: ArrayLike,
    transmission_stiffness: ArrayLike,
    transmission_damping: ArrayLike,
    *,
    encoder: str = "output",
    bandwidth: ArrayLike | None = None,
) -> tuple[Chain, tuple[int, ...]]:
    """Return chains of a motor and a load, and the shape that their parameters broadcast to."""
    given = {
        "inertia": positive("inertia", inertia),
        "damping": not_negative("damping", damping),
        "load_inertia": positive("load_inertia", load_inertia),
        "transmission_stiffness": positive("transmission_stiffness", transmission_stiffness),
        "transmission_damping": not_negative("transmission_damping", transmission_damping),
    }
    if bandwidth is not None:
        given["bandwidth"] = positive("bandwidth", bandwidth)
    if encoder not in ("output", "motor"):
        raise ValueError(f"encoder must be 'output' or 'motor', got {encoder!r}")
    arrays = broadcast(**given)
    m, b, load, k, c, *rest = (np.ravel(array) for array in arrays)
    chain = Chain(
        np.stack([m, load], axis=1),
        np.stack([b, np.zeros_like(b)], axis=1),
        k[:, None],
        c[:, None],
        rest[0] if rest else None,
        encoder=1 if encoder == "output" else 0,
    )
    return chain, arrays[0].shape
