"""Simulates a servo and its load under recorded torques, for many parameters and pieces at once.

    m x'' = u(t - delay) - weight(x) - b x' - friction(x, x', u)

A step leads from one row of the record to the next, by the fourth-order Runge-Kutta method while
the direction stays. Where the speed passes zero the shaft stops, and stays where friction holds it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.experiments.recorded.friction import dry_friction
from haptic_wall.controller.theory.checks import FloatArray

LONGEST_S = 0.0085
"""Longest step [s]; a longer row is passed in several"""


@dataclass(frozen=True, slots=True)
class Pieces:
    """Pieces of a record without gaps, padded to one length; arrays of shape (pieces, rows)."""

    time: FloatArray
    """[s]; even padding rows go on rising"""
    position: FloatArray
    """[rad]"""
    held: NDArray[np.bool_]
    """Rows that are no padding"""
    driven: NDArray[np.bool_]
    """Shape (pieces,): a torque acts in it"""
    torque_time: tuple[FloatArray, ...]
    """Instants of each piece's torques [s]; begins before the piece by the longest delay"""
    torque: tuple[FloatArray, ...]
    """Sent at these instants [N·m or A], held until the next"""

    def taken(self, chosen: NDArray[np.intp]) -> Pieces:
        """Return the pieces at these places."""
        rows = int(self.held[chosen].sum(axis=1).max()) if chosen.size else 0
        return Pieces(
            self.time[chosen, :rows],
            self.position[chosen, :rows],
            self.held[chosen, :rows],
            self.driven[chosen],
            tuple(self.torque_time[at] for at in chosen),
            tuple(self.torque[at] for at in chosen),
        )


def acting(pieces: Pieces, delay: FloatArray) -> FloatArray:
    """Return the mean torque that acts from each row to the next, shape (..., pieces, rows - 1).

    Args:
        pieces: The record.
        delay: Delay from the sending of a torque to its action [s], any shape.
    """
    delay = np.asarray(delay)
    count, rows = pieces.time.shape
    found = np.zeros((*delay.shape, count, rows - 1))
    for at in np.flatnonzero(pieces.driven):
        when, sent = pieces.torque_time[at], pieces.torque[at]
        work = np.concatenate([[0.0], np.cumsum(sent[:-1] * np.diff(when))])
        asked = pieces.time[at] - delay[..., None]
        inside = np.interp(asked, when, work)
        inside += np.maximum(asked - when[-1], 0.0) * sent[-1]
        found[..., at, :] = np.diff(inside, axis=-1) / np.diff(pieces.time[at])
    return found


def positions(
    pieces: Pieces, terms: Mapping[str, FloatArray], begin: FloatArray, speed: FloatArray
) -> FloatArray:
    """Return the positions at all rows [rad], shape (variants, pieces, rows).

    Args:
        pieces: The record.
        terms: Parameters by name, each of shape (variants, 1): ``inertia``, those of friction,
            ``sine`` and ``cosine`` (the load's torque over sine and cosine of the angle),
            ``gain`` and ``delay`` of the torque; and ``quadratic`` (drag over the speed's
            square), which may be missing.
        begin: Positions at the first rows [rad], shape (variants, pieces).
        speed: Speeds there [rad/s], shape (variants, pieces).
    """
    shape = np.broadcast_shapes(begin.shape, speed.shape)
    q, v = np.broadcast_to(begin, shape).copy(), np.broadcast_to(speed, shape).copy()
    rows = pieces.time.shape[1]
    out = np.empty((*shape, rows))
    out[..., 0] = q
    push = np.zeros((1, shape[1], rows - 1))
    if pieces.driven.any():
        push = terms["gain"][..., None] * acting(pieces, terms["delay"][:, 0])
    length = np.diff(pieces.time, axis=1)
    inner = max(1, math.ceil(float(np.max(length, initial=0.0)) / LONGEST_S))
    body = _Body(dict(terms))
    lengths = np.ascontiguousarray(length.T) / inner
    pushes = np.ascontiguousarray(np.moveaxis(push, -1, 0))
    with np.errstate(over="ignore", invalid="ignore"):  # what no servo does ends as inf or NaN
        for row in range(rows - 1):
            for _ in range(inner):
                q, v = body.step(q, v, pushes[row], lengths[row])
            out[..., row + 1] = q
    return out


class _Body:
    """The servo's forces."""

    def __init__(self, terms: dict[str, FloatArray]) -> None:
        self._damping = terms["damping"]
        self._per_inertia = 1.0 / terms["inertia"]
        self._sine, self._cosine = terms["sine"], terms["cosine"]
        self._terms = terms
        self._plain = set(terms).isdisjoint({"stribeck", "load"})
        self._quadratic = terms.get("quadratic")

    def step(
        self, q: FloatArray, v: FloatArray, u: FloatArray, h: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return position and speed after the time ``h``."""
        way = np.sign(v)
        moving = bool(way.all())
        if not moving:
            net = u - self._load(q)
            pull = np.sign(net)
            holds = np.abs(net) <= self._dry(u - net, u, v)
            way = np.where(way == 0.0, np.where(holds, 0.0, pull), way)
            if not way.any():
                return q, v
        half = 0.5 * h
        a1 = self._acceleration(q, v, u, way)
        v2 = v + half * a1
        a2 = self._acceleration(q + half * v, v2, u, way)
        v3 = v + half * a2
        a3 = self._acceleration(q + half * v2, v3, u, way)
        v4 = v + h * a3
        a4 = self._acceleration(q + h * v3, v4, u, way)
        sixth = h / 6.0
        after = v + sixth * (a1 + 2.0 * (a2 + a3) + a4)
        to = q + sixth * (v + 2.0 * (v2 + v3) + v4)
        if not moving:
            rests = way == 0.0
            after, to = np.where(rests, 0.0, after), np.where(rests, q, to)
        turns = after * way < 0.0
        if turns.any():
            share = np.abs(v) / (np.abs(v) + np.abs(after) + 1e-300)
            stop = q + 0.5 * share * h * v
            net = u - self._load(stop)
            pull = np.sign(net)
            dry = self._dry(u - net, u, np.zeros_like(v))
            push = np.where(np.abs(net) > dry, (net - pull * dry) * self._per_inertia, 0.0)
            rest = (1.0 - share) * h
            after = np.where(turns, push * rest, after)
            to = np.where(turns, stop + 0.5 * push * rest**2, to)
        return to, after

    def _load(self, q: FloatArray) -> FloatArray:
        return self._sine * np.sin(q) + self._cosine * np.cos(q)

    def _dry(self, load: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
        return self._terms["coulomb"] if self._plain else dry_friction(self._terms, -load, u, v)

    def _acceleration(
        self, q: FloatArray, v: FloatArray, u: FloatArray, way: FloatArray
    ) -> FloatArray:
        load = self._load(q)
        torque = u - load - self._damping * v - way * self._dry(load, u, v)
        if self._quadratic is not None:
            torque = torque - self._quadratic * v * np.abs(v)
        return torque * self._per_inertia
