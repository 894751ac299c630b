"""The detector on motion whose truth is known: sinusoids by formula, single simulated walls."""

import math

import numpy as np
import pytest

from haptic_wall.controller.detector.acting import ActingTorque
from haptic_wall.controller.detector.detection import Known, detect, position_step
from haptic_wall.controller.detector.settings import WatchSettings
from haptic_wall.controller.detector.state import State
from haptic_wall.controller.detector.watch import Watch
from haptic_wall.controller.laws.wall import Wall
from haptic_wall.controller.theory.checks import FloatArray
from tests.typed import not_none

PERIOD = 1e-3
COUNT = 2.0 * math.pi / 4096
MX64 = {"inertia": 0.011951, "damping": 0.011692, "coulomb": 0.0}


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


def heard(x: FloatArray, torque: FloatArray) -> tuple[Watch, int | None]:
    """The watch of a run that only reports, and the sample of the first alarm."""
    inertia = MX64["inertia"]
    watch = Watch(WatchSettings(PERIOD, COUNT, light=inertia, heavy=inertia))
    law, first = Wall(10.0, 0.0, 0.0, "both"), None
    for k, (position, sent) in enumerate(zip(x.tolist(), torque.tolist(), strict=True)):
        watch.sample(position, law, math.nan, 1)
        watch.sent(sent)
        if watch.alarm and first is None:
            first = k
    return watch, first


@pytest.mark.parametrize("frequency", [2.0, 9.0, 14.0])
@pytest.mark.parametrize("counts", [15.0, 40.0])
def test_sustained_oscillation_is_seen_with_its_frequency_and_amplitude(
    frequency: float, counts: float
) -> None:
    _, x, torque = free_oscillation(frequency, 0.0, counts * COUNT, 15.0 / frequency)
    watch, _ = heard(x, torque)
    assert watch.state == watch.current == State.SUSTAINED
    assert watch.frequency_hz == pytest.approx(frequency, rel=0.03)
    assert watch.amplitude == pytest.approx(counts * COUNT, rel=0.2)


def test_growing_oscillation_is_seen_before_it_doubles() -> None:
    t, x, torque = free_oscillation(10.0, 1.5, 20 * COUNT, 1.0)
    watch, first = heard(x, torque)
    assert t[not_none(first)] < math.log(2.0) / 1.5
    assert watch.state == State.GROWING


def test_the_same_growth_under_a_hands_torque_is_quiet() -> None:
    _, x, torque = free_oscillation(10.0, 1.5, 20 * COUNT, 1.0)
    watch, first = heard(x[:600], 0.3 * torque[:600])
    assert (watch.state, first) == (State.QUIET, None)


def test_rest_and_flicker_of_a_count_are_quiet() -> None:
    flicker = np.where(np.random.default_rng(1).random(5000) < 0.5, COUNT, 0.0)
    watch, first = heard(flicker, -10.0 * flicker)
    assert (watch.state, first) == (State.QUIET, None)
    assert watch.amplitude == 0.0
    assert math.isnan(watch.frequency_hz)


class TestActingTorque:
    @pytest.mark.parametrize("lag", [0.0, 0.25, 1.0, 2.7])
    def test_is_the_mean_of_what_was_held(self, lag: float) -> None:
        # Oracle: the held torque on a fine grid, shifted and averaged.
        fine = 1000
        sent = np.random.default_rng(3).normal(size=40)
        held = np.concatenate([np.zeros(round(lag * fine)), np.repeat(sent, fine)])
        acting = ActingTorque(lag)
        found = []
        for torque in sent.tolist():
            found.append(acting.acted())
            acting.send(torque)
        wanted = [0.0, *(held[fine * (k - 1) : fine * k].mean() for k in range(1, 40))]
        assert found == pytest.approx(wanted, abs=1e-12)


class TestRecord:
    def test_without_torque_the_motion_alone_is_judged(self) -> None:
        t, x, _ = free_oscillation(6.0, 0.0, 30 * COUNT, 6.0)
        found = detect(t, x, None, Known(PERIOD))
        assert found.worst == State.SUSTAINED
        assert found.frequency_hz[found.worst_at] == pytest.approx(6.0, rel=0.03)
        assert found.amplitude[found.worst_at] == pytest.approx(30 * COUNT, rel=0.2)

    def test_without_a_model_the_wall_must_at_least_pay(self) -> None:
        t, x, torque = free_oscillation(6.0, 0.8, 30 * COUNT, 3.0)
        assert detect(t, x, torque, Known(PERIOD)).worst == State.GROWING
        absorbed = -2.0 * x - 0.05 * np.gradient(x, PERIOD)
        assert detect(t, x, absorbed, Known(PERIOD)).worst == State.QUIET

    def test_nan_and_gaps_are_left_out(self) -> None:
        t, x, torque = free_oscillation(6.0, 0.8, 30 * COUNT, 3.0)
        x[100:140:7] = math.nan
        keep = np.ones(t.size, dtype=bool)
        keep[1000:1030] = False
        found = detect(t[keep], x[keep], torque[keep], Known(PERIOD, MX64["inertia"], COUNT))
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
