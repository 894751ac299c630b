"""The servo in time: when a torque acts, what becomes of it, and what the encoder sees."""

import math
import statistics
from typing import Any

import pytest

from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo
from tests.support.exact_servo import State, step

MS = 1_000_000
FREE = TrueServo(inertia=0.01, damping=0.0, counts_per_rev=0)


def servo(**settings: Any) -> TrueServo:
    return TrueServo(**{"inertia": 0.01, "counts_per_rev": 0, **settings})


def test_a_torque_acts_its_delay_later_to_the_nanosecond() -> None:
    mechanism = Mechanism(servo(delay=1.234567e-3), 5 * MS)
    mechanism.command(1.0, 5 * MS)
    mechanism.advance(5 * MS + 1_234_566)
    assert mechanism.torque == 0.0
    assert mechanism.velocity == 0.0
    mechanism.advance(5 * MS + 1_234_567)
    assert mechanism.torque == 1.0
    assert mechanism.velocity == 0.0
    mechanism.advance(8 * MS)
    # The velocity is u t / m over the time that was left.
    assert mechanism.velocity == pytest.approx(100.0 * (3 * MS - 1_234_567) * 1e-9, rel=1e-12)


def test_the_encoder_rounds_to_the_nearest_count_over_turns() -> None:
    count = 2 * math.pi / 4096
    for position, expected in [
        (0.0, 0),
        (0.49 * count, 0),
        (0.51 * count, 1),
        (-0.49 * count, 0),
        (-0.51 * count, -1),
        (6 * math.pi, 3 * 4096),
        (-200 * math.pi, -100 * 4096),
    ]:
        mechanism = Mechanism(servo(counts_per_rev=4096, position=position), 0)
        assert mechanism.measured()[1] == expected
        assert mechanism.measured()[0] == pytest.approx(expected * count, rel=1e-15)


def test_backlash_hides_motion_within_the_play_and_follows_beyond_it() -> None:
    mechanism = Mechanism(servo(damping=1.0, backlash=0.1), 0)

    def go(target: float) -> float:
        # With a damping of 1 N·m·s/rad it comes to rest its momentum, 0.2 u, further on.
        now = mechanism.time_ns
        mechanism.command((target - mechanism.position) / 0.2, now)
        mechanism.command(0.0, now + 200 * MS)
        mechanism.advance(now + 2_000 * MS)
        assert mechanism.position == pytest.approx(target, abs=1e-9)
        return mechanism.measured()[0]

    assert go(0.04) == 0.0
    assert go(-0.04) == 0.0
    assert go(0.25) == pytest.approx(0.20)
    assert go(0.16) == pytest.approx(0.20)
    assert go(0.05) == pytest.approx(0.10)
    assert go(0.14) == pytest.approx(0.10)


def test_a_turn_between_two_looks_moves_the_encoder_through_the_play() -> None:
    # Up and down again within one step: the encoder stays behind at the turn less half the play.
    mechanism = Mechanism(servo(backlash=0.002), 0)
    mechanism.command(1.0, 0)
    mechanism.command(-1.0, 10 * MS)
    mechanism.advance(30 * MS)
    turn = step(step(State(0.0, 0.0), FREE, 1.0, 0.01), FREE, -1.0, 0.01).position
    assert mechanism.position == pytest.approx(turn - 0.005, abs=1e-12)
    assert mechanism.measured()[0] == pytest.approx(turn - 0.005 + 0.001, abs=1e-12)
    mechanism.command(1.0, 30 * MS)
    # The velocity of -1 rad/s is stopped after 10 ms, 5 mrad lower; 20 ms later it is back there.
    mechanism.advance(50 * MS)
    assert mechanism.measured()[0] == pytest.approx(turn - 0.010 + 0.005 - 0.001, abs=1e-12)


def test_an_eccentric_encoder_errs_once_a_turn_and_keeps_count_of_turns() -> None:
    for turns in (0, 3, -100):
        for angle in (0.0, 0.7, 2.0, 4.0):
            position = turns * math.tau + angle
            mechanism = Mechanism(
                servo(encoder_eccentricity=0.01, encoder_phase=0.3, position=position), 0
            )
            assert mechanism.position == position
            error = mechanism.measured()[0] - position
            assert error == pytest.approx(0.01 * math.sin(angle + 0.3), abs=1e-11)
            counting = Mechanism(
                servo(
                    counts_per_rev=4096,
                    encoder_eccentricity=0.01,
                    encoder_phase=0.3,
                    position=position,
                ),
                0,
            )
            assert counting.measured()[1] == round((position + error) * 4096 / math.tau)


def test_noise_has_its_size_and_belongs_to_the_time_and_the_seed() -> None:
    def readings(seed: int, *, twice: bool = False) -> list[int]:
        mechanism = Mechanism(servo(counts_per_rev=4096, encoder_noise=2.0, noise_seed=seed), 7)
        found = []
        for k in range(4000):
            mechanism.advance(7 + k * MS)
            if twice:
                mechanism.measured()[1]
            found.append(mechanism.measured()[1])
        return found

    found = readings(1)
    # Rounding adds a twelfth of a count squared; the standard error of 4000 is 1.1 %.
    assert statistics.pstdev(found) == pytest.approx(math.sqrt(4.0 + 1 / 12), rel=0.05)
    assert statistics.mean(found) == pytest.approx(0.0, abs=0.15)
    neighbours = statistics.correlation(found[:-1], found[1:])
    assert abs(neighbours) < 0.06
    assert readings(1, twice=True) == found
    assert abs(statistics.correlation(found, readings(2))) < 0.06
