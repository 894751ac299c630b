"""At rest, without a hand, encoder noise commands at most its share of the torque limit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.reasons import explain
from haptic_wall.controller.guard.types import Decision, GuardSettings, Request, Situation
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory.checks import FloatArray
from tests.cases import sampled
from tests.support.beliefs import belief

T = 1e-3
NOISE = 0.34
"""Largest noise of the encoder that the promise covers [counts rms]"""
SETTINGS = GuardSettings()
STEPS, KEPT = 4, 32


def servo(
    inertia: float, damping: float, torque_limit: float, step: float, device: float = 0.0
) -> Situation:
    known = belief(inertia=inertia, damping=damping, delay=device)
    return Situation(known, T, torque_limit, step)


def one(request: Request, where: Situation, settings: GuardSettings = SETTINGS) -> Decision:
    return decide(request, settings, where, [0.0])[0]


Cases = list[tuple[Decision, Situation]]


def torque_rms(cases: Cases, noise: FloatArray, seed: int) -> FloatArray:
    """The rms of each commanded torque, at quarters of a period; the plant propagated exactly."""
    random = np.random.default_rng(seed)

    def each(of: Callable[[Decision, Situation], float]) -> FloatArray:
        return np.array([of(d, s) for d, s in cases])

    b = each(lambda _, s: s.belief.damping.value)
    rate = b / each(lambda _, s: s.belief.inertia.value)
    q, limit = each(lambda _, s: s.position_step), each(lambda _, s: s.torque_limit)
    stiffness, damping = each(lambda d, _: d.stiffness), each(lambda d, _: d.damping)
    samples = each(lambda d, _: d.request.velocity_samples)
    late = np.rint(each(lambda d, _: d.delay) / (T / STEPS)).astype(int)
    n = np.arange(len(cases))
    decay = np.exp(-rate * T / STEPS)
    x, v, acting, offset = (
        np.zeros(len(n)),
        np.zeros(len(n)),
        np.zeros(len(n)),
        random.random(len(n)),
    )
    seen, sent = np.zeros((KEPT, len(n))), np.zeros((KEPT, len(n)))
    squares, ticks = np.zeros(len(n)), 1500
    for k in range(ticks):
        seen[k % KEPT] = np.floor(x / q + offset + noise * random.standard_normal(len(n))) * q
        velocity = (seen[k % KEPT] - seen[(k - samples) % KEPT, n]) / (samples * T)
        velocity = velocity if k > samples.max() else 0.0 * velocity
        away = seen[k % KEPT] + (0.5 - offset) * q
        torque = np.clip(-stiffness * away - damping * velocity, -limit, limit)
        squares += torque**2 if k >= ticks // 4 else 0.0
        for step in range(STEPS):
            now = STEPS * k + step
            if step == 0:
                sent[(now + late) % KEPT, n] = torque
            acting = np.where((now - late) % STEPS == 0, sent[now % KEPT], acting)
            x = x + acting / b * T / STEPS + (v - acting / b) * (1.0 - decay) / rate
            v = acting / b + (v - acting / b) * decay
    rms: FloatArray = np.sqrt(squares / (ticks - ticks // 4))
    return rms


def test_noise_at_rest_commands_less_than_its_share(thorough: bool, wholly: bool) -> None:
    random = np.random.default_rng(4)
    cases: Cases = []
    for i in range(3000 if thorough else 200 if wholly else 15):
        inertia = 10 ** random.uniform(-3.5, -1)
        where = servo(
            inertia,
            inertia * 10 ** random.uniform(-0.5, 1.2),
            1.0,
            2 * np.pi / random.choice([1024, 4096, 16384]),
            random.choice([0.0, 0.25, 0.5, 1.0, 2.0, 3.0]) * T,
        )
        samples = int(random.choice([1, 1, 2, 4, 8]))
        request = Request(
            1e9 if i % 2 else 0.0, 1e9 if i % 3 else -1e9 if i % 9 else 0.0, "both", samples
        )
        # a torque limit around that at which 0.8 of the encoder's bound binds before the ceiling
        free = one(request, replace(where, position_step=0.0)).damping
        count = max(abs(free), 1e-4) * where.position_step / (samples * T)
        where = replace(where, torque_limit=10 / 0.8 * count * 10 ** random.uniform(-1.5, 0.7))
        cases.append((one(request, where), where))
    share = SETTINGS.quantisation_share * np.array([s.torque_limit for _, s in cases])
    noise = random.uniform(0, NOISE, len(cases))
    assert np.max(torque_rms(cases, noise, 5) / share) < 1.0
    asked = [d for d, _ in cases if d.request.damping]
    assert 0.3 < np.mean([d.is_coarse for d in asked]) < 0.9


@pytest.mark.parametrize("side", sampled(["above", "below", "both"], 3))
@pytest.mark.parametrize("stiffness", [0.0, 8.0])
def test_damping_above_the_share_is_clamped_either_way_with_its_reason(
    side: Side, stiffness: float
) -> None:
    where = servo(0.012, 10.0, 4.1, 2 * np.pi / 4096)  # a damping of which -5 is a part
    for asked, samples in ((5.0, 1), (-5.0, 1), (5.0, 4)):
        request = Request(stiffness, asked, side, samples)
        decision = explain(one(request, where), SETTINGS, where)
        assert abs(decision.damping) == pytest.approx(0.8 * 0.267 * samples, rel=0.02)
        assert decision.damping * asked > 0
        assert decision.stiffness == stiffness, "some torque is left for a spring"
        reason = decision.reasons[0]
        for part in (f"{decision.damping:.4g} instead of {asked:g}", "0.41 N·m", "velocity over"):
            assert part in reason
    assert one(request, replace(where, position_step=0.0)).damping == asked
    assert one(request, where, replace(SETTINGS, mode="off")).damping == asked


def test_a_longer_served_interval_does_not_make_a_count_smaller() -> None:
    where = replace(servo(0.012, 0.01, 4.1, 2 * np.pi / 4096), period=4 * T, sampled=T)
    assert one(Request(0.0, 5.0, "both"), where).damping < 0.268


@pytest.mark.parametrize("preset", ["simulated", "emulated-xm430", "xm430-w350"])
def test_usual_damping_is_not_clamped_by_the_encoder(preset: str) -> None:
    config = load_config(preset, []).config
    facts = config.true_servo() if config.servo.kind != "hardware" else None
    where = Situation(config.belief(), T, 4.1, 2 * np.pi / 4096)
    assert facts is None or facts.torque_limit == 4.1
    for asked in (0.02, 0.1, 0.2):
        assert one(replace(config.request(None), damping=asked), where).damping == asked
