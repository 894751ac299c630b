"""Simulates a servo under recorded torques, for many parameters and pieces of motion at once.

The servo is an inertia with viscous and Coulomb friction and a delayed torque. Its encoder may
follow with backlash::

    m x'' = u(t - delay) - b x' - c sign(x')

The effects of a real servo can be added. Torques are held, so the motion between two changes of the
torque has a closed form, even if the body stops or reverses in between. Torques that depend on
speed and position are held over that time too. Samples and torques have their recorded instants,
which need not lie on the grid.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.experiments.identify.motion import Pieces
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.response import held_response

_NO_SPEED = 1e-6
"""[rad/s]"""


Values = Mapping[str, FloatArray]
"""Values of v variants by name, as in ``Fit``: arrays (v, 1); a missing one is 0"""


class _Friction(NamedTuple):
    """Friction of every variant of every piece, arrays of shape (v, s)."""

    coulomb: FloatArray
    """In quick motion [N·m]"""
    slow: FloatArray
    """In slow motion [N·m]"""
    static: FloatArray
    """At rest [N·m]"""
    fading: FloatArray | None
    """Speed over which that of slow motion fades [rad/s]; None: there is none"""
    exponent: float
    """Of that fading"""

    def moving(self, speed: FloatArray) -> FloatArray:
        """Return the friction at a speed [N·m]."""
        if self.fading is None:
            return self.coulomb
        faded = np.exp(-((np.abs(speed) / self.fading) ** self.exponent))
        return self.coulomb + (self.slow - self.coulomb) * faded


def _friction(used: Values, values: Values, shape: tuple[int, ...]) -> _Friction:
    none = np.zeros((shape[0], 1))

    def size(name: str) -> FloatArray:
        return np.broadcast_to(used.get(name, none), shape)

    slow = size("coulomb") + used.get("excess", none)
    return _Friction(
        coulomb=size("coulomb"),
        slow=slow,
        static=np.maximum(size("static"), slow),
        fading=np.maximum(size("fading"), _NO_SPEED) if "excess" in used else None,
        exponent=float(np.max(values.get("exponent", 1.0))),
    )


def simulated(  # noqa: PLR0915 - in one piece for speed
    pieces: Pieces, values: Values, speeds: FloatArray, begins: FloatArray | None = None
) -> FloatArray:
    """Simulate every piece with every variant; return the encoder's unrounded positions [rad].

    Each piece begins with the backlash taken up in the direction of its speed.

    Args:
        pieces: The recorded motion.
        values: Inertia, damping, friction, delay and effects.
        speeds: Initial speed of each piece in each variant [rad/s], shape (v, s).
        begins: Initial position of each [rad]: the weight is then that at the simulated position,
            as long pieces need it, and friction that of the middle of each step. None: zero, and
            the weight is that at the measured one, which no wrong value can lead astray.

    Returns:
        Shape (v, s, n).
    """
    used = {name: value for name, value in values.items() if np.any(value)}
    none = np.zeros((speeds.shape[0], 1))
    swings = begins is not None
    lengths, motor, outside, weight = _torques(pieces, used, used.get("delay", none), swings)
    friction = _friction(used, values, speeds.shape)
    decay = used.get("damping", none) / values["inertia"]
    response = held_response(decay[:, :, None, None], lengths)
    # Time first: a step reads whole rows of memory.
    phi, psi, kept, motor, lengths = (
        np.ascontiguousarray(np.moveaxis(each, (2, 3), (0, 1)))
        for each in (*response, motor, lengths)
    )
    outside, weight = (np.moveaxis(each, (2, 3), (0, 1)) for each in (outside, weight))
    held = motor - outside
    decay, inertia = (np.broadcast_to(each, speeds.shape) for each in (decay, values["inertia"]))
    half = np.broadcast_to(0.5 * used.get("backlash", none), speeds.shape)
    loose = "backlash" in used
    x, v = np.zeros(speeds.shape) if begins is None else begins.copy(), speeds.copy()
    shown = x - np.sign(v) * half
    out = np.empty((pieces.sampled.shape[1], *speeds.shape))
    out[0] = shown
    last, pull, load = np.zeros(speeds.shape), none, none
    for k in range(held.shape[0]):
        for j in range(held.shape[1]):
            u, by_speed, pace = held[k, j], phi[k, j], v
            if swings:
                ahead = 0.5 * lengths[k, j]
                pull = _wave(used, "sine", "cosine", x + ahead * v)
                u, pace = u - pull, v + ahead * last
                pace = np.where(pace * v > 0.0, pace, 0.0)
            if "gear" in used:  # bam's friction by the gear's load (arXiv:2410.08650)
                load = used["gear"] * np.abs(motor[k, j] + (pull if swings else weight[k, 0]))
            sign = np.sign(v)
            moving = bool(sign.all())
            if not moving:
                free = np.abs(u) > friction.static + load
                sign = np.where(sign == 0.0, np.where(free, np.sign(u), 0.0), sign)
            push = u - sign * (friction.moving(pace) + load)
            if "uneven" in used:
                push -= used["uneven"] * np.abs(pace)
            if "drag" in used:
                push -= used["drag"] * pace * np.abs(pace)
            if not moving:
                push[sign == 0.0] = 0.0
            push /= inertia
            end = v * kept[k, j] + push * by_speed
            moved = v * by_speed + push * psi[k, j]
            turned = (end * sign < 0.0).nonzero()
            if swings:
                np.divide(end - v, lengths[k, j], out=last, where=lengths[k, j] > 0.0)
            if turned[0].size:
                last[turned] = 0.0
                slow, static = ((each + load)[turned] for each in (friction.slow, friction.static))
                rest, moved[turned], end[turned] = _through_rest(
                    v[turned],
                    push[turned],
                    decay[turned],
                    lengths[k, j][turned],
                    _breakaway(u[turned], slow, static) / inertia[turned],
                )
                if loose:
                    at = x[turned] + rest
                    shown[turned] = np.clip(shown[turned], at - half[turned], at + half[turned])
            x = x + moved
            v = end
        shown = np.minimum(np.maximum(shown, x - half), x + half) if loose else x
        out[k + 1] = shown
    return np.moveaxis(out, 0, 2)


def _torques(
    pieces: Pieces, used: Values, delay: FloatArray, swings: bool
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return lengths [s] and the motor's torques as ``_schedule``; what opposes them, the weight.

    Args:
        pieces: The recorded motion.
        used: Values that are not zero.
        delay: [s].
        swings: The weight is that at the simulated position.
    """
    lengths, torques = _schedule(pieces, delay)
    if "gain" in used:
        torques = torques * used["gain"][:, :, None, None]
    if "dead_band" in used:
        missing = np.maximum(used["dead_band"], 0.0)[:, :, None, None]
        torques = torques - np.clip(torques, -missing, missing)
    angle = 0.5 * (pieces.position[:, 1:] + pieces.position[:, :-1])
    weight: FloatArray = np.zeros((1, 1, 1))
    if not swings:
        weight = _wave({n: v[:, :, None] for n, v in used.items()}, "sine", "cosine", angle)
    outside = weight
    if "periods" in used:
        turned = used["periods"][:, :, None] * (angle - np.max(used.get("center", 0.0)))
        sizes = {name: value[:, :, None] for name, value in used.items()}
        outside = weight + _wave(sizes, "cogging_sine", "cogging_cosine", turned)
    shape = (*lengths.shape[:3], 1)
    outside, weight = (np.broadcast_to(each[..., None], shape) for each in (outside, weight))
    return lengths, torques, outside, weight


def _wave(used: Values, sine: str, cosine: str, angle: FloatArray) -> FloatArray:
    """Return a torque at each angle, by the sizes of its sine and cosine [N·m]."""
    found: FloatArray = np.zeros(angle.shape)
    for name, wave in ((sine, np.sin), (cosine, np.cos)):
        if name in used:
            found = found + used[name] * wave(angle)
    return found


def _breakaway(torque: FloatArray, coulomb: FloatArray, static: FloatArray) -> FloatArray:
    """Return the torque on a body at rest in excess of friction [N·m]."""
    left = np.sign(torque) * np.maximum(np.abs(torque) - coulomb, 0.0)
    return np.where(np.abs(torque) > static, left, 0.0)


def _through_rest(
    speed: FloatArray, push: FloatArray, decay: FloatArray, length: FloatArray, after: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute a step in which the body comes to rest, then continues with the push ``after``.

    Returns:
        Position at rest, position and speed at the end, from the start of the step.
    """
    ratio = speed / push  # below zero: it decelerates
    drag = -decay * ratio
    small = drag < 1e-6
    time = np.where(
        small, -ratio * (1.0 - 0.5 * drag), np.log1p(drag) / np.where(small, 1.0, decay)
    )
    time = np.minimum(time, length)
    by_speed, by_torque, _ = held_response(decay, np.stack([time, length - time]))
    rest = speed * by_speed[0] + push * by_torque[0]
    return rest, rest + after * by_torque[1], after * by_speed[1]


def _schedule(pieces: Pieces, delay: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the held torques between samples: length [s] and torque, (v, s, n - 1, j)."""
    lengths, torques = [], []
    known: dict[float, tuple[FloatArray, FloatArray]] = {}
    for value in delay[:, 0].tolist():
        if value not in known:
            known[value] = _parts(pieces, value)
        lengths.append(known[value][0])
        torques.append(known[value][1])
    most = max(part.shape[-1] for part in lengths)

    def filled(parts: list[FloatArray]) -> FloatArray:
        missing = [most - part.shape[-1] for part in parts]
        return np.stack(
            [
                np.concatenate([part, np.zeros((*part.shape[:2], n))], axis=2) if n else part
                for part, n in zip(parts, missing, strict=True)
            ]
        )

    return filled(lengths), filled(torques)


def _parts(pieces: Pieces, delay: float) -> tuple[FloatArray, FloatArray]:
    motion = pieces.motion
    acts = np.append(motion.sent + delay, np.inf)
    torque = np.concatenate([[0.0], motion.torque])  # zero before the first
    begin, end = pieces.sampled[:, :-1], pieces.sampled[:, 1:]
    first = np.searchsorted(acts, begin, side="right")  # acts before it: torque[first]
    last = np.searchsorted(acts, end, side="right")
    lengths, torques = [], []
    edge = begin
    for j in range(int(np.max(last - first, initial=0)) + 1):
        index = np.minimum(first + j, last)
        until = np.where(index < last, acts[np.minimum(index, acts.size - 1)], end)
        lengths.append(np.maximum(until - edge, 0.0))
        torques.append(torque[index])
        edge = until
    return np.stack(lengths, axis=2), np.stack(torques, axis=2)
