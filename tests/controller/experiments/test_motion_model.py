import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.experiments.identify.fit import NAMES
from haptic_wall.controller.experiments.identify.motion import Motion, motion_of, pieces_of
from haptic_wall.controller.experiments.identify.motion_model import simulated
from haptic_wall.controller.runtime.telemetry import ROW
from haptic_wall.controller.theory.checks import FloatArray, IntArray
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo

MS = 1_000_000


def moved(
    true: TrueServo,
    torques: FloatArray,
    jitter: IntArray | None = None,
    ticks: IntArray | None = None,
) -> tuple[Motion, FloatArray]:
    """A mechanism under torques sent at each sample, or up to some time after it."""
    mechanism = Mechanism(true, 0)
    sampled, position, sent, speed = [], [], [], []
    for k, torque in enumerate(torques):
        at = (k if ticks is None else ticks[k]) * MS
        mechanism.advance(at)
        sampled.append(at * 1e-9)
        position.append(mechanism.measured()[0])
        speed.append(mechanism.velocity)
        late = 0 if jitter is None else int(jitter[k])
        mechanism.command(float(torque), at + late)
        sent.append((at + late) * 1e-9)
    return Motion(*(np.array(a) for a in (sampled, position, sent, torques))), np.array(speed)


def model(true: TrueServo, *more: float) -> dict[str, FloatArray]:
    """The values of a servo, and those of variants in which all of them are larger by a factor."""
    values = {name: getattr(true, name) for name in NAMES}
    return {name: np.array([[v], *([v * by] for by in more)]) for name, v in values.items()}


def shown(motion: Motion, true: TrueServo, begin: int, end: int, speed: FloatArray) -> FloatArray:
    pieces = pieces_of(motion, [(begin, end)])
    positions: FloatArray = simulated(pieces, model(true), np.array([[speed[begin]]]))[0, 0]
    return positions


@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.0052])
@pytest.mark.parametrize("coulomb", [0.0, 0.013])
def test_it_moves_as_the_exact_plant_does(delay: float, coulomb: float) -> None:
    random = np.random.default_rng(3)
    true = TrueServo(0.0018, 0.0037, coulomb, counts_per_rev=0, delay=delay, torque_limit=1.0)
    torques = np.repeat(random.uniform(-0.06, 0.06, 60), 10)
    motion, speed = moved(true, torques)
    assert np.ptp(motion.position) > 0.02
    for begin, end in ((0, 600), (123, 480)):
        expected = motion.position[begin:end] - motion.position[begin]
        assert shown(motion, true, begin, end, speed) == pytest.approx(expected, abs=1e-9)


def test_it_moves_as_a_real_servo_does() -> None:
    """Load friction, a dead band, another damping each way: held over a sample, so not exact."""
    random = np.random.default_rng(3)
    true = TrueServo(0.0018, 0.0037, 0.008, counts_per_rev=0, delay=0.0007, torque_limit=1.0)
    true = replace(true, load_friction=0.1, dead_band=0.004, damping_back=0.0029)
    torques = np.repeat(random.uniform(-0.06, 0.06, 60), 10)
    motion, speed = moved(true, torques)
    one = np.ones((1, 1))
    real = {
        **model(replace(true, damping=0.0033)),
        "gear": 0.1 * one,
        "uneven": 0.0004 * one,
        "dead_band": 0.004 * one,
    }
    pieces = pieces_of(motion, [(123, 480)])
    found = simulated(pieces, real, np.array([[speed[123]]]))[0, 0]
    assert found == pytest.approx(motion.position[123:480] - motion.position[123], abs=2e-5)
    ideal = shown(motion, true, 123, 480, speed)
    assert np.max(np.abs(ideal - found)) > 1e-3


def test_torques_act_when_they_were_sent_and_lost_periods_are_longer_steps() -> None:
    random = np.random.default_rng(4)
    true = TrueServo(0.0018, 0.0037, 0.013, counts_per_rev=0, delay=0.0013, torque_limit=1.0)
    jitter = random.integers(0, 900_000, 300)
    ticks = np.cumsum(random.choice([1, 1, 1, 2, 5], 300))
    motion, speed = moved(true, random.uniform(-0.2, 0.2, 300), jitter, ticks)
    expected = motion.position[40:] - motion.position[40]
    assert shown(motion, true, 40, 300, speed) == pytest.approx(expected, abs=1e-9)


def test_play_lags_behind_at_each_turn() -> None:
    true = TrueServo(0.0018, 0.0037, 0.013, counts_per_rev=0, backlash=0.01, torque_limit=1.0)
    torques = 0.06 * np.sin(math.tau * 3.0 * np.arange(1500) * 1e-3)
    motion, speed = moved(true, torques)
    begin = 500 + int(np.argmax(np.abs(speed[500:700])))
    found = shown(motion, true, begin, 1500, speed)
    expected = motion.position[begin:] - motion.position[begin]
    assert found - found[0] == pytest.approx(expected, abs=1e-9)


def test_a_failed_reading_is_no_sample_but_its_torque_was_sent() -> None:
    rows = np.zeros(4, ROW)
    rows["sampled_ns"] = [10 * MS, 11 * MS, 11 * MS, 13 * MS]
    rows["age_ns"] = [MS // 2, MS // 2, 3 * MS // 2, MS // 2]
    rows["outcome"] = [0, 0, 1, 0]
    rows["position"] = [1.0, 2.0, 2.0, 4.0]
    rows["torque"] = [0.1, 0.2, 0.3, 0.4]
    motion = motion_of(rows)
    assert motion.sampled == pytest.approx([0.0, 0.001, 0.003])
    assert motion.position == pytest.approx([1.0, 2.0, 4.0])
    assert motion.sent == pytest.approx([0.0005, 0.0015, 0.0025, 0.0035])
