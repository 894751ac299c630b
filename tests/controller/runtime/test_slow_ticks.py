"""Ticks that cost more than a period: the guard counts the interval that is really served."""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.checks import IntArray
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_bus
from haptic_wall.hw.servo import Bus
from tests.cases import sampled
from tests.support.simulated_run import Rows, session
from tests.typed import not_none

PERIOD = 1e-3
INERTIA, DAMPING, VIRTUAL = 0.011951, 0.011692, 0.03
TWO_SIDED = (
    "servo.coulomb=0",
    "servo.hand=none",
    "servo.counts_per_rev=0",
    "servo.torque_step=0",
    "servo.torque_limit=100",
    "servo.delay=0",
    "servo.kick=0.01",
    "wall.side=both",
    "wall.stiffness=1e6",
    f"wall.damping={VIRTUAL}",
    "safety.on_oscillation=report",
    "safety.max_speed=1e6",
)


class SlowBus:
    """A simulated bus after whose ``write`` the tick goes on for some time."""

    def __init__(self, bus: Bus, clock: SimulatedClock, costs: Iterator[float]) -> None:
        self._bus, self._clock, self._costs = bus, clock, costs

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bus, name)

    def write(self, torques: Sequence[float]) -> Sequence[float]:
        sent = self._bus.write(torques)
        self._clock.wait_until(self._clock.now_ns() + round(next(self._costs) * PERIOD * 1e9))
        return sent


def run(
    costs: Iterator[float], *sets: str, duration: float = 4.0, preset: str = "simulated"
) -> tuple[Result, Rows]:
    """A run whose ticks cost what is drawn [periods]; its result and its rows with the wall on."""
    clock = SimulatedClock()

    def opener(*arguments: Any) -> SlowBus:
        return SlowBus(open_bus(*arguments), clock, costs)

    return session(preset, *TWO_SIDED, *sets, duration=duration, clock=clock, opener=opener)


def always(cost: float) -> Iterator[float]:
    while True:
        yield cost


def drawn(choices: Sequence[float], weights: Sequence[float], seed: int) -> Iterator[float]:
    random = np.random.default_rng(seed)
    while True:
        yield float(random.choice(choices, p=weights))


def heights(rows: Rows) -> tuple[float, float]:
    """Largest distance from the wall: half a second after the start, and at the end [rad]."""
    distance = np.abs(rows["position"])
    part = len(distance) // 8
    return distance[part : 2 * part].max(), distance[-part:].max()


def true_limit(interval: float) -> float:
    return float(critical_stiffness(INERTIA, DAMPING, VIRTUAL, interval * PERIOD, 0.0))


@pytest.mark.parametrize("cost", [1.5, 2.0, 2.6])
def test_the_wall_of_a_slow_loop_is_that_of_its_true_rate(cost: float) -> None:
    result, rows = run(always(cost))
    guard = not_none(result.guard)
    sampled: IntArray = rows["sampled_ns"]
    served = float(np.diff(sampled).mean()) * 1e-9 / PERIOD
    assert served == pytest.approx(cost, rel=0.2)
    assert guard["commanded"]["stiffness"] < 0.81 * true_limit(served)
    assert guard["commanded"]["stiffness"] > 0.5 * true_limit(served), "and no more than it needs"
    assert guard["interval_s"] >= 0.97 * served * PERIOD
    first, last = heights(rows)
    assert last < 0.75 * first, "it decays"


@pytest.mark.parametrize("seed", sampled(range(3), 3))
def test_ticks_of_random_cost_keep_the_wall_stable(seed: int) -> None:
    result, rows = run(drawn([0.3, 1.3, 2.2], [0.5, 0.3, 0.2], seed))
    assert not_none(result.guard)["interval_s"] > PERIOD
    first, last = heights(rows)
    assert last < 0.75 * first


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("cost", [1.75, 1.95])
def test_the_damping_stays_whole_where_every_second_tick_is_late(cost: float, samples: int) -> None:
    """The torque of the late tick is held longest: its velocity is over hardly any time."""
    sets = [f"wall.velocity_samples={samples}"]
    _, rows = run(itertools.cycle([cost, 0.01]), *sets)
    first, last = heights(rows)
    assert last < 0.75 * first


def test_one_stall_does_not_soften_the_wall() -> None:
    costs = iter([0.1] * 1000 + [20.0] + [0.1] * 4000)
    result, rows = run(costs)
    assert rows["missed"].max() == 19
    assert not_none(result.guard)["interval_s"] == pytest.approx(PERIOD)
    assert rows["stiffness"].min() == rows["stiffness"].max()


def test_a_stall_just_before_the_end_is_told() -> None:
    stalled = iter([0.1] * 1900 + [7.0] + [0.1] * 400)
    assert run(stalled, duration=2.0)[0].stalled == "this computer stalled for 7 ms"
    long_before = iter([0.1] * 500 + [7.0] + [0.1] * 1800)
    assert run(long_before, duration=2.0)[0].stalled == ""


@pytest.mark.parametrize("waited", [False, True])
def test_what_an_elastic_clock_takes_out_is_in_the_row_all_the_same(waited: bool) -> None:
    """A tick of 7 ms, as its own work or as a wait for the bus."""
    clock, telemetry = SimulatedClock(), Telemetry.create()
    words = telemetry.words

    class Stalling(SlowBus):
        def write(self, torques: Sequence[float]) -> Sequence[float]:
            if words[Word.HEAD] == 699:
                words[Word.OFFSET_NS] += 7_000_000
                words[Word.WAITED_NS] += 7_000_000 * waited
            return self._bus.write(torques)

    def opener(*arguments: Any) -> SlowBus:
        return Stalling(open_bus(*arguments), clock, always(0.0))

    result, rows = session(
        "emulated-ideal",
        duration=0.5,
        telemetry=telemetry,
        clock=clock,
        opener=opener,
        warm_up=True,
    )
    usual_ns = int(rows[690]["bus_ns"])
    assert int(rows[700]["work_ns"]) == 7_000_000 * (not waited)
    assert int(rows[700]["bus_ns"]) == usual_ns + 7_000_000 * waited
    assert result.missed == 0


def test_a_wall_made_softer_by_slow_ticks_is_restored_after_five_windows_at_the_surface() -> None:
    costs = iter([0.1] * 500 + [1.5] * 500 + [0.1] * 9000)
    result, rows = run(costs, "servo.kick=0.0005", duration=9.0)
    assert rows["stiffness"].min() < 0.8 * rows["stiffness"].max()
    assert not_none(result.guard)["commanded"]["stiffness"] == rows["stiffness"].max()
    assert not_none(result.guard)["interval_s"] == pytest.approx(PERIOD)


@pytest.mark.parametrize("profile", ["off", "best-effort"])
def test_the_report_says_what_interval_was_counted_and_why(profile: str) -> None:
    result, _ = run(always(1.5), f"realtime.profile={profile}", duration=2.0)
    assert result.stop_reason == "duration"
    assert not_none(result.guard)["interval_s"] == pytest.approx(1.5 * PERIOD)
    assert any(
        "counts a period of 1.5 ms instead of 1 ms" in why
        for why in not_none(result.guard)["reasons"]
    )
    assert "safety.max_missed (20%)" in result.warnings[0]
    assert math.isclose(not_none(result.delay)["total"], not_none(result.delay)["inserted"])


def test_the_delay_is_the_sum_of_its_parts_where_ages_share_a_decision() -> None:
    result, _ = run(always(1.5), "servo.counts_per_rev=4096", preset="emulated-ideal")
    delay = not_none(result.delay)
    assert delay["measured"] > 0
    parts = ("inserted", "device", "measured")
    assert delay["total"] == pytest.approx(sum(delay[part] for part in parts))


def test_strict_ends_the_run_where_too_many_periods_are_missed() -> None:
    result, rows = run(always(1.5), "realtime.profile=strict")
    assert result.stop_reason == "trip:missed_periods"
    assert result.message == "20.2% of the periods of 0.5 s; at most 20% is allowed"
    assert rows["torque"][-1] == 0.0
    assert len(rows) < 350, "within half a second"
