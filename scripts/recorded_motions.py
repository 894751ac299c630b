"""Recorded motions: those of an XL330 in docs/examples, and synthetic ones whose truth is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from haptic_wall.controller.experiments.identify.motion import Motion, Pieces
from haptic_wall.controller.experiments.recorded.estimate import Pendulum
from haptic_wall.controller.experiments.recorded.record import read_record
from haptic_wall.controller.experiments.recorded.shooting import beginnings, model_of
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo
from tests.support.truth import COUNT

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "examples" / "xl330-pendulum"
PENDULUM = Pendulum(0.49, 0.1)
DROPS = ("kp100_lift_and_drop", "kp400_lift_and_drop")
DRIVEN = tuple(
    f"{gain}_{motion}"
    for gain in ("kp100", "kp400")
    for motion in ("sin_sin", "sin_time_square", "up_and_down")
)
BEGINNING_S = 0.2
"""Length of the beginning that tells where a predicted piece begins [s]"""
_ROUNDS = 10
FULL_PWM = 885.0
"""Present PWM of an XL330 at full voltage"""


def drop(name: str) -> tuple[Motion, ...]:
    """Return the free swing of a recording."""
    return read_record(FOLDER / f"{name}.csv").stretches


def driven(name: str) -> Motion:
    """Return a recording in position mode; its torque is the motor's mean voltage [V]."""
    rows = columns(name)
    duty = rows["load_raw"]
    duty = np.where(duty >= 2**15, duty - 2**16, duty) / FULL_PWM
    # the supply is measured in steps of 0.1 V, and jumps: its mean over 50 ms
    supply = np.convolve(np.pad(rows["supply_v"], 5, "edge"), np.full(11, 1 / 11), "valid")
    return Motion(rows["time_s"], rows["position_rad"], rows["time_s"], duty * supply)


def columns(name: str) -> dict[str, FloatArray]:
    """Return all columns of a recording."""
    path = FOLDER / f"{name}.csv"
    names = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    return dict(zip(names, table.T, strict=True))


def predicted(pieces: Pieces, terms: Mapping[str, float]) -> FloatArray:
    """Return the positions [rad] as predicted from the first 0.2 s of each piece.

    Args:
        pieces: The record; shape (pieces, rows) is that of the result.
        terms: The parameters, per inertia.
    """
    near = pieces.held & (pieces.sampled - pieces.sampled[:, :1] <= BEGINNING_S)
    rows = max(8, int(near.sum(axis=1).max()))
    first = replace(
        pieces,
        sampled=pieces.sampled[:, :rows],
        position=pieces.position[:, :rows],
        held=near[:, :rows],
    )
    own, model = beginnings(first), model_of(first, terms)
    for _ in range(_ROUNDS):
        linear = model.linear(model.begin, own)
        own = own - linear.own_part(linear.left[None])[0]
    model = model_of(pieces, terms)
    found: FloatArray = pieces.position + model.left(model.begin[None], own[:, None])[0]
    return found


def error_of(pieces: Pieces, at: FloatArray) -> float:
    """Return the root mean square of the difference to the record [rad]."""
    left = np.where(pieces.held, at - pieces.position, 0.0)
    return math.sqrt(float(np.sum(left**2)) / np.count_nonzero(pieces.held))


@dataclass(frozen=True, slots=True)
class Made:
    """A synthetic recording."""

    columns: dict[str, FloatArray]
    truth: dict[str, float]
    pendulum: Pendulum


def made(seed: int, *, torque: bool, stribeck: bool = False) -> Made:
    """Return a recording of a servo that is drawn.

    Args:
        seed: Seed of the draw.
        torque: A known torque drives it; else it swings free.
        stribeck: Half of the friction at rest fades at 0.3 rad/s.
    """
    random = np.random.default_rng(seed)
    pendulum = Pendulum(random.uniform(0.3, 0.7), random.uniform(0.07, 0.14))
    arm = random.uniform(0.0, 0.1)
    inertia = random.uniform(0.001, 0.004)
    damping = math.exp(random.uniform(math.log(0.002), math.log(0.008)))
    coulomb = math.exp(random.uniform(math.log(0.006), math.log(0.025)))
    hanging = random.uniform(-0.05, 0.05)
    total, weight = inertia + pendulum.inertia(arm), pendulum.weight(arm)
    truth = {"inertia": inertia, "damping": damping, "coulomb": coulomb}
    interval = random.uniform(0.001, 0.006)
    count = int(6.0 / interval)
    time = np.cumsum(interval * (1.0 + 0.3 * np.abs(random.standard_normal(count))))
    delay, gain = 0.0, 1.0
    begin, sent = hanging, np.zeros(count)
    if torque:
        delay = truth["delay"] = random.uniform(0.001, 0.008)
        gain = truth["torque_gain"] = random.uniform(0.8, 1.2)
        size = random.uniform(0.13, 0.3) * weight
        for hertz in (0.5, 1.3, 2.2):
            sent += size * np.sin(math.tau * (hertz * time + random.random()))
    else:
        begin = random.uniform(0.3, 1.4) * random.choice([-1.0, 1.0])
    servo = TrueServo(
        total, damping, coulomb, counts_per_rev=0, delay=delay, torque_limit=1e3,
        position=begin, gravity=weight, gravity_angle=hanging,
    )  # fmt: skip
    if stribeck:
        servo = replace(servo, static_friction=1.5 * coulomb, stribeck_speed=0.3)
    mechanism = Mechanism(servo, 0)
    found = np.empty(count)
    for row, (at, asked) in enumerate(zip(np.rint(1e9 * time), sent, strict=True)):
        mechanism.advance(int(at))
        found[row] = mechanism.position
        mechanism.command(gain * float(asked), int(at))
    rows = {"time_s": time, "position_rad": np.round(found / COUNT) * COUNT}
    rows |= {"torque_nm": sent} if torque else {"torque_enabled": np.zeros(count)}
    return Made(rows, truth, pendulum)
