"""Simulates laws other than a wall, many at once, on servos without friction.

Nothing here uses ``haptic_wall``: what the guard commands is held against it. A servo, rigid or of
two masses, moves exactly under each held torque. All is in pure numbers: one period, an inertia of
1. Positions are in units of a law's own length.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]
Kind = Literal["periodic", "bounded", "stops", "friction", "texture"]
QUARTERS = 4


@dataclass(frozen=True, slots=True)
class Loads:
    """Loads behind flexible transmissions; flat arrays of one length."""

    share: Array
    """Inertia of the load over the whole inertia"""
    rate: Array
    """Angular frequency of the vibration with both ends free, times T"""
    ratio: Array
    """Damping ratio of that vibration"""
    at_motor: Array
    """1: the encoder measures the motor's side; 0: the load's"""
    shake: Array
    """Speed of the load against the motor at the start"""


@dataclass(frozen=True, slots=True)
class Servos:
    """Servos, and what is commanded; flat arrays of one length."""

    damping: Array
    """b T / m"""
    stiffness: Array
    """K T² / m, of a law's steepest slope"""
    virtual_damping: Array
    """B T / m"""
    delay: Array
    """t_d / T"""
    loads: Loads | None = None
    """None: the servos are rigid"""

    def mapped(self, change: Callable[[Array], Array]) -> Servos:
        """Return servos with each array changed."""
        loads = self.loads
        if loads is not None:
            loads = Loads(*(change(getattr(loads, each.name)) for each in fields(loads)))
        return Servos(
            change(self.damping),
            change(self.stiffness),
            change(self.virtual_damping),
            change(self.delay),
            loads,
        )

    def stiffer(self, factor: float) -> Servos:
        """Return servos with another stiffness."""
        return replace(self, stiffness=factor * self.stiffness)


@dataclass(frozen=True, slots=True)
class Found:
    """Energies of each motion over time."""

    kinetic: Array
    """Largest energy of the servo, kinetic and in its transmission, in each quarter of the time,
    shape (4, n)"""
    energy: Array
    """Largest of it and of the energy that the law stores, in each quarter"""
    start: Array
    """Energy at the start"""


class Law:
    """The elongation of one kind of law for each servo.

    Args:
        kind: ``periodic``: a table over one unit, again and again; ``bounded``: a table over two
            units about zero, and constant beyond; ``stops``: walls at ±1 that never pull;
            ``friction``: a spring to an anchor that is dragged along at an elongation of 1;
            ``texture``: a sine of period 1 that fades.
        table: Elongations at equal distances, shape (n, j); for tables only.
    """

    def __init__(self, kind: Kind, count: int, table: Array | None = None) -> None:
        self.kind = kind
        self._rows = np.arange(count)
        self._anchor = np.full(count, np.nan)
        if table is None:
            return
        self._size = table.shape[1] if kind == "periodic" else table.shape[1] - 1
        width = 1.0 if kind == "periodic" else 2.0
        self._knot = width / self._size
        ends = np.concatenate([table, table[:, :1]], 1) if kind == "periodic" else table
        steps = 0.5 * (ends[:, 1:] + ends[:, :-1]) * self._knot
        potential = np.concatenate([np.zeros((count, 1)), np.cumsum(steps, 1)], 1)
        self._ends = ends
        self._potential = potential - potential.min(1, keepdims=True)

    def at(self, x: Array, speed: Array) -> tuple[Array, Array]:
        """Return elongation and potential."""
        if self.kind == "stops":
            e = x - np.clip(x, -1.0, 1.0)
            return e, 0.5 * e * e
        if self.kind == "friction":
            bent = np.where(np.isnan(self._anchor), 0.0, x - self._anchor)
            e = np.clip(bent, -1.0, 1.0)
            self._anchor = x - e
            return e, 0.5 * e * e
        if self.kind == "texture":
            wave = 2.0 * np.pi
            fade = np.clip(2.0 - 8.0 * np.abs(speed), 0.0, 1.0)
            return fade * np.sin(wave * x) / wave, (1.0 - np.cos(wave * x)) / wave**2
        place = (x - np.floor(x)) if self.kind == "periodic" else np.clip(x, -1.0, 1.0) + 1.0
        at = place / self._knot
        i = np.minimum(at.astype(np.intp), self._size - 1)
        low, high = self._ends[self._rows, i], self._ends[self._rows, i + 1]
        e = low + (high - low) * (at - i)
        u = self._potential[self._rows, i] + 0.5 * (low + e) * (at - i) * self._knot
        if self.kind == "bounded":
            u = u + e * (x - np.clip(x, -1.0, 1.0))
        return e, u


def moved(law: Law, servos: Servos, x: Array, v: Array, periods: int) -> Found:
    """Let servos move.

    Args:
        law: For each servo.
        servos: Servos and gains.
        x: Positions at the start, with no torque before.
        v: Velocities at the start.
        periods: How long.
    """
    count, n = servos.damping.size, np.floor(servos.delay).astype(np.intp)
    part = servos.delay - n
    body = _Rigid(servos, part, x, v) if servos.loads is None else _TwoMasses(servos, part, x, v)
    rows, size = np.arange(count), int(n.max()) + 2
    ring = np.zeros((size, count))
    before = x - v
    kinetic = np.zeros((QUARTERS, count))
    energy = np.zeros((QUARTERS, count))
    start = np.zeros(count)
    for k in range(periods):
        x = body.measured()
        speed = x - before
        before = x
        e, u = law.at(x, speed)
        torque = -servos.stiffness * e - servos.virtual_damping * speed
        if law.kind == "stops":
            torque = np.where(e * torque < 0.0, torque, 0.0)
        ring[k % size] = torque
        own = body.energy()
        whole = own + servos.stiffness * u
        if k == 0:
            start = whole
        quarter = QUARTERS * k // periods
        np.maximum(kinetic[quarter], own, out=kinetic[quarter])
        np.maximum(energy[quarter], whole, out=energy[quarter])
        for interval, age in enumerate((n + 1, n)):
            body.move(interval, ring[(k - age) % size, rows])
    return Found(kinetic, energy, start)


class _Rigid:
    """Servos of one mass.

    Args:
        servos: The servos.
        part: Fraction of the period after which the newer torque acts.
        x: Positions at the start.
        v: Velocities at the start.
    """

    def __init__(self, servos: Servos, part: Array, x: Array, v: Array) -> None:
        self._steps = _steps(servos.damping, part), _steps(servos.damping, 1.0 - part)
        self._x, self._v = x, v

    def measured(self) -> Array:
        """Return the positions that the encoders measure."""
        return self._x

    def energy(self) -> Array:
        """Return kinetic energy and that of the transmission."""
        return 0.5 * self._v * self._v

    def move(self, interval: int, torque: Array) -> None:
        """Move under a held torque, in the first or second part of a period."""
        decay, reach, push = self._steps[interval]
        self._x = self._x + reach * self._v + push * torque
        self._v = decay * self._v + reach * torque


class _TwoMasses:
    """Servos whose load is behind a spring; arguments and methods as of ``_Rigid``."""

    def __init__(self, servos: Servos, part: Array, x: Array, v: Array) -> None:
        loads = servos.loads
        assert loads is not None
        load, motor = loads.share, 1.0 - loads.share
        moving = load * motor
        self._load, self._motor, self._spring = load, motor, moving * loads.rate**2
        c = 2.0 * loads.ratio * moving * loads.rate
        a = np.zeros((x.size, 5, 5))  # motor x and v, load x and v, torque
        a[:, 0, 1] = a[:, 2, 3] = 1.0
        a[:, 1, 0], a[:, 1, 2] = -self._spring / motor, self._spring / motor
        a[:, 1, 1], a[:, 1, 3] = -(servos.damping + c) / motor, c / motor
        a[:, 3, 0], a[:, 3, 2] = self._spring / load, -self._spring / load
        a[:, 3, 1], a[:, 3, 3] = c / load, -c / load
        a[:, 1, 4] = 1.0 / motor
        self._steps = [
            np.ascontiguousarray(np.moveaxis(expm(a * time[:, None, None])[:, :4], 0, 2))
            for time in (part, 1.0 - part)
        ]
        self._at_motor = loads.at_motor > 0.0
        self._state: Array = np.array([x, v - load * loads.shake, x, v + motor * loads.shake])

    def measured(self) -> Array:
        """Return the positions that the encoders measure."""
        found: Array = np.where(self._at_motor, self._state[0], self._state[2])
        return found

    def energy(self) -> Array:
        """Return kinetic energy and that of the transmission."""
        x, v, y, w = self._state
        found: Array = 0.5 * (
            self._motor * v * v + self._load * w * w + self._spring * (x - y) ** 2
        )
        return found

    def move(self, interval: int, torque: Array) -> None:
        """Move under a held torque, in the first or second part of a period."""
        step, state = self._steps[interval], self._state
        self._state = np.einsum("ijn,jn->in", step[:, :4], state) + step[:, 4] * torque


def _steps(delta: Array, time: Array) -> tuple[Array, Array, Array]:
    """Return the responses over a time: decay of v, position by v, position by torque."""
    small = delta * time < 1e-4
    safe = np.where(small, 1.0, delta)
    decay = np.exp(-delta * time)
    reach = np.where(small, time - 0.5 * delta * time**2, (1.0 - decay) / safe)
    push = np.where(small, 0.5 * time**2 - delta * time**3 / 6.0, (time - reach) / safe)
    return decay, reach, push


def lasting(found: Found, floor: Array) -> Array:
    """Return a measure of persistence: about 1 or more if a motion goes on, below 1 if it decays.

    The lesser of the kinetic energy's and the whole energy's ratio from the second to the last
    quarter: a shaft that falls from a crest gains the one, a shaft that rests on a slope of no law
    keeps the other.

    Args:
        found: Energies of the motions.
        floor: Kinetic energy below which it is at rest.
    """
    kinetic = found.kinetic[-1] / np.maximum(found.kinetic[1], 1e-300)
    energy = found.energy[-1] / np.maximum(found.energy[1], 1e-300)
    return np.where(found.kinetic[-1] > floor, np.minimum(kinetic, energy), 0.0)
