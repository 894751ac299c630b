"""The guard against random plants: no more than is safe, no less than was promised.

A thousand of them with ``--thorough``, an eighth with ``--whole``, otherwise forty.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.reasons import explain
from haptic_wall.controller.guard.types import (
    OF_ENCODER,
    Decision,
    GuardSettings,
    Request,
    Situation,
)
from haptic_wall.controller.laws.wall import Side
from haptic_wall.controller.theory import max_virtual_damping
from tests.support.beliefs import belief
from tests.theory.oracles import Loop, bounce, radius

MARGIN, CAP = 0.8, 0.7
SIDES: tuple[Side, ...] = ("above", "below", "both")


@dataclass(frozen=True)
class Case:
    """One decision, and all that it was made from."""

    decision: Decision
    situation: Situation
    before_device: float

    def loop(self, inertia: float, damping: float, gain: float, device: float) -> Loop:
        """The loop with the commanded wall on a true servo of these properties."""
        d = self.decision
        return Loop(
            inertia,
            damping,
            gain * d.stiffness,
            gain * d.damping,
            self.situation.period,
            self.before_device + device,
            d.request.velocity_samples,
        )

    def at_corner(self) -> Loop:
        b = self.situation.belief
        return self.loop(b.inertia.low, b.damping.low, b.torque_gain.high, b.delay.high)

    def at_random(self, random: np.random.Generator, corners: bool) -> Loop:
        """A true servo within the bounds; with ``corners`` each property at one of its ends."""

        def draw(bounded: Bounded) -> float:
            share = float(random.integers(0, 2)) if corners else random.random()
            return bounded.low + share * (bounded.high - bounded.low)

        b = self.situation.belief
        return self.loop(
            draw(b.inertia), draw(b.damping), draw(b.torque_gain), max(draw(b.delay), 0.0)
        )


def random_belief(random: np.random.Generator, period: float) -> Belief:
    """Servos from the smallest to a robot's joint, known to within up to a factor of two."""

    def around(value: float) -> Bounded:
        width = random.uniform(1, 1.5)
        return Bounded(value, value / width, value * width)

    inertia = 10 ** random.uniform(-3, -0.5)
    damping = 10 ** random.uniform(-3.5, -1.3) * inertia / period
    return belief(
        inertia=around(inertia),
        damping=around(damping),
        delay=around(random.choice([0.0, random.uniform(0, 2)]) * period),
        torque_gain=around(1.0),
    )


@pytest.fixture(scope="module")
def cases(thorough: bool, wholly: bool) -> list[Case]:
    random = np.random.default_rng(20)
    settings = GuardSettings("stable", MARGIN, CAP)
    found = []
    for i in range(1000 if thorough else 125 if wholly else 15):
        period = float(random.choice([0.5e-3, 1e-3, 2e-3]))
        situation = Situation(
            belief=random_belief(random, period),
            period=period,
            torque_limit=random.uniform(0.5, 10),
            position_step=float(random.choice([0.0, 0.0, 2 * np.pi / 4096])),
        )
        late = float(random.integers(0, 6) if i % 2 else random.uniform(0, 6))
        b, samples = situation.belief, int(random.choice([1, 1, 1, 2, 4]))
        ceiling = max_virtual_damping(
            b.inertia.low, b.damping.low, period, late * period + b.delay.high, samples
        )
        request = Request(
            stiffness=1e6,
            damping=float(random.uniform(0, 3) * ceiling / b.torque_gain.high),
            side=SIDES[i % 3],
            velocity_samples=samples,
        )
        (decision,) = decide(request, settings, situation, [late * period])
        if i % 5 == 0:  # reasons have tests of their own, and take two thirds of the time
            decision = explain(decision, settings, situation)
        found.append(Case(decision, situation, late * period))
    return found


def test_commanded_is_margin_times_the_smallest_limit_and_no_less(cases: list[Case]) -> None:
    for case in cases:
        d = case.decision
        names = ("linear", "exact", "one_sided", "quantisation")
        values = [d.limits[name] for name in names]
        least = min(v for v in values if v is not None)
        assert d.stiffness == pytest.approx(MARGIN * least, rel=1e-3)
        assert d.binding is not None
        assert d.limits[d.binding] == least


def test_commanded_damping_is_what_was_asked_or_the_share_of_the_ceiling_or_of_a_count(
    cases: list[Case],
) -> None:
    b = [case.situation.belief for case in cases]
    ceiling = max_virtual_damping(
        [x.inertia.low for x in b],
        [x.damping.low for x in b],
        [case.situation.period for case in cases],
        [case.decision.delay for case in cases],
        [case.decision.request.velocity_samples for case in cases],
    ) / [x.torque_gain.high for x in b]
    asked = np.array([case.decision.request.damping for case in cases])
    given = np.array([case.decision.damping for case in cases])
    most = OF_ENCODER * np.array([case.decision.encoder_damping for case in cases])
    np.testing.assert_allclose(given, np.min([asked, CAP * ceiling, most], axis=0), rtol=1e-3)
    assert 0.2 < np.mean(given < asked) < 0.9


def test_limits_are_on_the_edge_for_an_independent_model(cases: list[Case]) -> None:
    # a guard that commands too little is as wrong: at its own exact limit the loop is critical
    for case in cases[::5]:
        loop = case.at_corner()
        exact = case.decision.limits["exact"]
        assert exact is not None
        scale = exact / case.decision.stiffness if case.decision.stiffness else 0.0
        if scale:
            assert radius(loop._replace(stiffness=loop.stiffness * scale * (1 - 1e-3))) < 1
            assert radius(loop._replace(stiffness=loop.stiffness * scale * (1 + 1e-3))) > 1


def test_poles_are_inside_the_circle_whatever_the_true_servo(cases: list[Case]) -> None:
    random = np.random.default_rng(21)
    for case in cases:
        # where quantisation leaves no stiffness, one pole is at 1 and the device stays where it is
        edge = 1.0 if case.decision.stiffness else 1.0 + 1e-9
        assert radius(case.at_corner()) < edge
        assert radius(case.at_random(random, corners=False)) < edge
        assert radius(case.at_random(random, corners=True)) < edge


def test_one_sided_walls_return_no_device_faster_than_it_came(cases: list[Case]) -> None:
    random = np.random.default_rng(22)
    pushing = [c for c in cases if c.decision.request.side != "both" and c.decision.stiffness]
    assert len(pushing) > 0.4 * len(cases)
    # a missed sample is the worst phase nearly always; the others are spread
    phases = np.array([1e-9, 0.35, 0.7, 1.0])
    loops = [case.at_corner() for case in pushing]
    loops += [case.at_random(random, corners=bool(i % 2)) for i, case in enumerate(pushing)]
    assert np.max(bounce(loops, phases)) <= 1.0
