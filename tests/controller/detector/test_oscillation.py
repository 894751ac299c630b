"""The detector on motion whose truth is known: sinusoids by formula, single simulated walls."""

import math
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.detection import detect, position_step
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings, State
from haptic_wall.controller.theory.checks import FloatArray

PERIOD = 1e-3
COUNT = 2.0 * math.pi / 4096
MX64 = {"inertia": 0.011951, "damping": 0.011692, "coulomb": 0.0}


def settings(**known: Any) -> DetectorSettings:
    return DetectorSettings(PERIOD, **{**MX64, "position_step": COUNT, **known})


def free_oscillation(
    frequency: float, growth: float, amplitude: float, seconds: float, step: float = COUNT
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A free oscillation, and the torque that makes it by Newton's law, acting at once."""
    t = np.arange(float(round(seconds / PERIOD))) * PERIOD
    w = 2.0 * math.pi * frequency
    wave = amplitude * np.exp(growth * t)
    x = wave * np.cos(w * t)
    v = wave * (growth * np.cos(w * t) - w * np.sin(w * t))
    a = wave * ((growth * growth - w * w) * np.cos(w * t) - 2.0 * growth * w * np.sin(w * t))
    torque = MX64["inertia"] * a + MX64["damping"] * v
    if step:
        x = np.rint(x / step) * step
    return t, x, torque


def watched(detector: Detector, x: FloatArray, torque: FloatArray) -> int | None:
    """Feed it; the states seen and the sample of the first alarm."""
    mean = 0.5 * (torque + np.concatenate([[0.0], torque[:-1]]))
    first = None
    for k, (position, acting) in enumerate(zip(x.tolist(), mean.tolist(), strict=True)):
        detector.update(position, acting)
        if detector.alarm and first is None:
            first = k
    return first


@pytest.mark.parametrize("frequency", [2.0, 9.0, 28.0])
@pytest.mark.parametrize("counts", [4.0, 40.0])
def test_sustained_oscillation_is_seen_with_its_frequency_and_amplitude(
    frequency: float, counts: float
) -> None:
    detector = Detector(settings())
    detector.stiffness = MX64["inertia"] * (2.0 * math.pi * frequency) ** 2
    _, x, torque = free_oscillation(frequency, 0.0, counts * COUNT, 40.0 / frequency)
    assert watched(detector, x, torque) is not None
    assert detector.state == State.SUSTAINED
    assert detector.frequency_hz == pytest.approx(frequency, rel=0.03)
    assert detector.amplitude == pytest.approx(counts * COUNT, rel=0.2)


def test_oscillation_of_a_count_is_sustained_but_no_alarm() -> None:
    # A wall without friction keeps it up at any stiffness, by the encoder's steps alone.
    detector = Detector(settings())
    detector.stiffness = MX64["inertia"] * (2.0 * math.pi * 9.0) ** 2
    _, x, torque = free_oscillation(9.0, 0.0, 1.4 * COUNT, 6.0)
    assert watched(detector, x, torque) is None
    assert detector.state == State.SUSTAINED


def test_growing_oscillation_is_seen_before_it_doubles_and_its_rate_measured() -> None:
    detector = Detector(settings())
    detector.stiffness = MX64["inertia"] * (2.0 * math.pi * 10.0) ** 2
    t, x, torque = free_oscillation(10.0, 1.5, 20 * COUNT, 1.0)
    first = watched(detector, x, torque)
    assert t[first] < math.log(2.0) / 1.5
    assert detector.state == State.GROWING
    # Six counts in a hundred at each end of two cycles.


def test_rest_and_flicker_of_a_count_are_quiet() -> None:
    detector = Detector(settings())
    detector.stiffness = 10.0
    detector.balance.surface = 0.0
    flicker = np.where(np.random.default_rng(1).random(5000) < 0.5, COUNT, 0.0)
    assert watched(detector, flicker, -10.0 * flicker) is None
    assert detector.state == State.QUIET
    assert detector.amplitude == 0.0
    assert math.isnan(detector.frequency_hz)


def test_alarm_ends_when_the_motion_ends() -> None:
    detector = Detector(settings())
    detector.stiffness = MX64["inertia"] * (2.0 * math.pi * 10.0) ** 2
    _, x, torque = free_oscillation(10.0, 1.5, 20 * COUNT, 1.0)
    watched(detector, x, torque)
    assert detector.alarm
    for _ in range(400):
        detector.update(float(x[-1]), 0.0)
    assert not detector.alarm
    assert detector.state == State.QUIET


def test_lost_samples_count_as_the_periods_that_passed() -> None:
    detector = Detector(settings())
    detector.stiffness = MX64["inertia"] * (2.0 * math.pi * 5.0) ** 2
    _, x, torque = free_oscillation(5.0, 0.0, 40 * COUNT, 6.0)
    kept = np.flatnonzero(np.random.default_rng(2).random(x.size) > 0.05)
    last = 0
    for k in kept.tolist():
        mean = float(np.mean(torque[last : k + 1]))
        detector.update(float(x[k]), mean, max(1, k - last))
        last = k
    assert detector.state == State.SUSTAINED
    assert detector.frequency_hz == pytest.approx(5.0, rel=0.03)


class TestActingTorque:
    @pytest.mark.parametrize("lag", [0.0, 0.25, 1.0, 2.7])
    def test_is_the_mean_of_what_was_held(self, lag: float) -> None:
        # Oracle: the held torque on a fine grid, shifted and averaged.
        fine = 1000
        sent = np.random.default_rng(3).normal(size=40)
        held = np.concatenate([np.zeros(round(lag * fine)), np.repeat(sent, fine)])
        acting = ActingTorque(lag)
        found = [acting.push(u) for u in sent.tolist()]
        wanted = [0.0, *(held[fine * (k - 1) : fine * k].mean() for k in range(1, 40))]
        assert found == pytest.approx(wanted, abs=1e-12)

    def test_skipped_periods_hold_the_last_torque(self) -> None:
        skipping, steady = ActingTorque(1.5), ActingTorque(1.5)
        skipping.push(1.0)
        found = skipping.push(2.0, 4)
        each = [steady.push(1.0), *(steady.push(1.0) for _ in range(3)), steady.push(2.0)]
        assert found == pytest.approx(sum(each[1:]) / 4)

    def test_lag_may_grow_while_it_runs(self) -> None:
        acting = ActingTorque(0.0)
        for value in range(1, 50):
            acting.push(float(value))
        acting.lag = 10.0
        assert acting.push(50.0) == 39.0
        acting.lag = 90.0
        assert acting.push(51.0) == 0.0


class TestRecord:
    def test_without_torque_the_motion_alone_is_judged(self) -> None:
        t, x, _ = free_oscillation(6.0, 0.0, 30 * COUNT, 6.0)
        found = detect(t, x, None, DetectorSettings(PERIOD))
        assert found.worst == State.SUSTAINED
        assert found.frequency_hz[found.worst_at] == pytest.approx(6.0, rel=0.03)
        assert found.amplitude[found.worst_at] == pytest.approx(30 * COUNT, rel=0.2)

    def test_without_a_model_the_wall_must_at_least_pay(self) -> None:
        t, x, torque = free_oscillation(6.0, 0.8, 30 * COUNT, 3.0)
        assert detect(t, x, torque, DetectorSettings(PERIOD)).worst == State.GROWING
        absorbed = -2.0 * x - 0.05 * np.gradient(x, PERIOD)
        assert detect(t, x, absorbed, DetectorSettings(PERIOD)).worst == State.QUIET

    def test_nan_and_gaps_are_left_out(self) -> None:
        t, x, torque = free_oscillation(6.0, 0.8, 30 * COUNT, 3.0)
        x[100:140:7] = math.nan
        keep = np.ones(t.size, dtype=bool)
        keep[1000:1030] = False
        found = detect(t[keep], x[keep], torque[keep], settings())
        assert found.worst == State.GROWING
        assert math.isfinite(found.first_alarm_s)
        assert np.isfinite(found.amplitude).all()

    def test_finds_the_encoders_count(self) -> None:
        _, x, _ = free_oscillation(6.0, 0.0, 30 * COUNT, 2.0)
        assert position_step(np.round(x, 6)) == pytest.approx(COUNT, rel=1e-3)
        noisy = x + 1e-15 * np.arange(x.size) % 3e-15  # as sums and products leave it
        assert position_step(noisy) == pytest.approx(COUNT, rel=1e-6)
        _, smooth, _ = free_oscillation(6.0, 0.0, 30 * COUNT, 2.0, step=0.0)
        assert position_step(smooth) == 0.0


def test_a_shaft_that_comes_in_with_a_speed_as_the_wall_comes_on_is_no_alarm() -> None:
    """The torque begins during the motion: it seems to take less than the spring stores."""
    stiffness = 24.0
    detector = Detector(settings(coulomb=0.0615))
    detector.stiffness, detector.balance.surface, detector.balance.lag = stiffness, 0.0, 1.3e-3
    sent = [0.0, 0.0]
    for k in range(300):
        depth = 20.0 * COUNT + 1.5 * 0.02 * (1.0 - math.exp(-k / 20.0))  # a hand slows it down
        position = round(depth / COUNT) * COUNT
        detector.update(position, sent[-2])
        assert not detector.alarm
        sent.append(-stiffness * position)
