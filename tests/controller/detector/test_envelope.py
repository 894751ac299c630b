"""The state of a record is that of its envelope: drawn sampled springs, held torques, counts."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from haptic_wall.controller.detector.detection import DetectionRecord, position_step
from haptic_wall.controller.logs.detected import detect_all
from haptic_wall.controller.logs.recording import Part, Recording
from haptic_wall.controller.theory.checks import FloatArray

NOTHING = dict.fromkeys(("inertia", "damping", "coulomb", "lag"))
STATES = {-1: "decaying", 0: "sustained", 1: "growing"}


class Drawn(NamedTuple):
    """An oscillation by its envelope."""

    period: float
    positions: FloatArray
    torques: FloatArray | None
    way: int
    """-1: it decays; 0; +1: it grows"""


def found(period: float, positions: FloatArray, torques: FloatArray | None) -> DetectionRecord:
    times = np.asarray(np.arange(positions.size) * period, np.float64)
    part = Part(times, positions, torques)
    recording = Recording(period, (part,), position_step(positions), ())
    return detect_all(recording, NOTHING)[0][0]


def rounded(values: FloatArray, step: float) -> FloatArray:
    return np.rint(values / step) * step if step else values


def drawn(random: np.random.Generator) -> Drawn:
    """An oscillation of 2 to 40 % a cycle or none, of at least four counts, by any wall."""
    period = math.exp(random.uniform(math.log(1 / 2000), math.log(1 / 50)))
    angle = math.exp(random.uniform(math.log(0.02), math.log(0.8)))  # omega T
    way = int(random.integers(-1, 2))
    growth = way * math.exp(random.uniform(math.log(0.02), math.log(0.4)))
    step = float(random.choice([0.0, math.tau / 512, math.tau / 4096]))
    cycles = min(random.uniform(10.0, 40.0), 3.0 / max(abs(growth), 0.01))
    smallest = max(0.01, 4.0 * step) * random.uniform(1.0, 3.0)
    k = np.arange(round(cycles * math.tau / angle))
    rate = growth * angle / math.tau
    wave = np.exp(rate * (k if way >= 0 else k - k[-1]))
    positions = rounded(smallest * wave * np.cos(angle * k + random.uniform(0.0, 6.0)), step)
    stiffness = math.exp(random.uniform(-1.0, 4.0))
    damping = random.uniform(0.0, 0.5) * stiffness / angle * period
    speeds = np.diff(positions, prepend=positions[0]) / period
    torques = -stiffness * positions - damping * speeds
    return Drawn(period, positions, torques if random.random() < 0.5 else None, way)


def test_the_state_is_that_of_the_envelope(thorough: bool) -> None:
    count, wrong = 500 if thorough else 40, 0
    for number in range(count):
        one = drawn(np.random.default_rng([7, number]))
        seen = found(one.period, one.positions, one.torques)
        wrong += seen.worst.name.lower() != STATES[one.way]
        if one.way and seen.worst:
            assert seen.growth[seen.worst_at] * one.way > 0.0, number
        assert one.way >= 0 or math.isnan(seen.first_alarm_s), number
    assert wrong <= 0.02 * count


def ringing(period: float, angle: float, damping: float, lag: int) -> tuple[FloatArray, FloatArray]:
    """A spring rendered with a held torque on a servo of 4096 counts, from 0.1 rad.

    ``damping`` is b over the K T (1/2 + lag) that balances the delay.
    """
    inertia, step = 0.01, math.tau / 4096
    stiffness = inertia * (angle / period) ** 2
    b = damping * stiffness * period * (0.5 + lag)
    decay = math.exp(-b / inertia * period)
    x, v, sent = 0.1, 0.0, [0.0] * lag
    positions, torques = [], []
    for _ in range(round(20 * math.tau / angle)):
        positions.append(round(x / step) * step)
        torques.append(-stiffness * positions[-1])
        sent.append(torques[-1])
        u = sent.pop(0)
        x += u / b * period + (v - u / b) * inertia / b * (1.0 - decay)
        v = u / b + (v - u / b) * decay
    return np.array(positions), np.array(torques)


@pytest.mark.parametrize("damping", [0.6, 1.6])
def test_a_wall_with_a_held_torque_grows_or_decays_as_its_friction_says(damping: float) -> None:
    for angle in (0.05, 0.15, 0.25, 0.4):
        for lag in (0, 1):
            seen = found(0.01, *ringing(0.01, angle, damping, lag))
            assert seen.worst.name == ("GROWING" if damping < 1.0 else "DECAYING"), (angle, lag)
            assert (seen.growth[seen.worst_at] > 0.0) == (damping < 1.0)
            assert math.isnan(seen.first_alarm_s) == (damping > 1.0)


K = np.arange(1500)
WAVE = np.cos(0.1 * K)


@pytest.mark.parametrize(
    ("positions", "state"),
    [
        (0.1 * np.exp(-5e-4 * K) * WAVE + 3.0 + 2e-4 * K, "decaying"),  # offset and drift
        (0.1 * WAVE + 0.015 * np.cos(0.37 * K), "sustained"),  # two frequencies
        (0.01 * np.exp(1e-3 * K) * WAVE + 4e-4 * np.sin(K * K), "growing"),  # noise
        (np.where(K < 700, 0.0, 0.1 * np.exp(5e-4 * (700 - K)) * WAVE), "decaying"),
        (np.where(K < 700, 0.0, 0.1 * WAVE), "sustained"),  # rests, then rings
        (np.minimum(0.1, 2e-3 * np.exp(5e-3 * K)) * WAVE, "growing"),  # saturates
        ((0.1 * np.exp(-2e-3 * K) * WAVE)[:190], "decaying"),  # three cycles
        (4.0 * math.tau / 4096 * WAVE, "sustained"),  # four counts
        (0.5 * np.sin(3e-3 * K) + 0.05 * np.sin(7.1e-3 * K), "quiet"),  # a slow hand
    ],
)
def test_unkind_motions(positions: FloatArray, state: str) -> None:
    counted = rounded(positions, math.tau / 4096)
    for torques in (-2.0 * counted, None):
        if torques is None or state != "quiet":
            seen = found(1e-3, counted, torques)
            assert seen.worst.name.lower() == state
            assert math.isnan(seen.first_alarm_s) == (state in ("quiet", "decaying"))
