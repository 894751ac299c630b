"""The cache warm-up: it has no effect, and it has its time or is left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn

import pytest

from haptic_wall.controller.runtime import cache_warm_up, deadlines
from haptic_wall.controller.runtime.assembly import cache_warm_up_of, guard_schedule, most_injected
from haptic_wall.controller.runtime.cache_warm_up import CacheWarmUp, StandInClock
from haptic_wall.controller.runtime.deadlines import SpinWaiter
from haptic_wall.controller.runtime.session import Surroundings, run_session
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.open import open_servo
from haptic_wall.hw.settings import ServoSettings
from tests.cases import sampled
from tests.typed import not_none

PERIOD_NS = 1_000_000
RUNS = {
    "in the process": ("simulated", "wall.passivity_control=true", "servo.backlash=0.002"),
    "deceived": (
        "simulated",
        "wall.side=both",
        "servo.coulomb=0",
        "servo.hand=none",
        "servo.kick=-0.05",
        "servo.delay=0.006",
        "model.delay=0.002",
        "wall.stiffness=10",
    ),
    "pipelined on a bad bus": (
        "emulated-ideal",
        "servo.schedule=pipelined",
        "servo.faults=drop:p=0.02",
        "safety.max_loss=0.9",
        "servo.hand=tap",
    ),
}


class WarmedUp:
    """A servo before whose every request the caches are warmed up: in the midst of a real tick."""

    def __init__(self, servo: Any, warm_up: CacheWarmUp) -> None:
        self._servo, self._warm_up = servo, warm_up

    def __getattr__(self, name: str) -> Any:
        return getattr(self._servo, name)

    def request(self) -> None:
        self._warm_up(PERIOD_NS)
        assert not self._warm_up.fault
        self._servo.request()


def rows_of(preset: str, *sets: str, warmed_up: bool) -> tuple[bytes, str, Any, Any]:
    config = load_config(preset, ("loop.clock=simulated", *sets)).config
    ran: list[object] = []

    def opener(settings: ServoSettings, clock: Clock, port: int | None) -> Any:
        servo = open_servo(settings, clock, port)
        if not warmed_up:
            return servo
        schedule = guard_schedule(config, servo, True)
        made = not_none(
            cache_warm_up_of(config, servo, schedule, most_injected(config, servo, schedule), ())
        )
        tick = made._run
        made._run = lambda *deadline: ran.append(tick(*deadline))
        made.need_ns = made._most_ns = 0  # whatever time it takes: nobody waits for it
        return WarmedUp(servo, made)

    telemetry = Telemetry.create()
    result = run_session(
        config, SimulatedClock(), telemetry, 1.0, surroundings=Surroundings(open_servo=opener)
    )
    assert len(ran) >= 1000 * warmed_up, "it did take place"
    return telemetry.read(0)[0].tobytes(), result.stop_reason, result.oscillation, result.bus


@pytest.mark.whole
@pytest.mark.parametrize("name", sampled(RUNS, 2))
def test_a_run_with_cache_warm_ups_is_the_same_to_the_bit(name: str) -> None:
    run = RUNS[name]
    assert rows_of(*run, warmed_up=True) == rows_of(*run, warmed_up=False)


class Machine:
    """Time that passes by being looked at and by sleeping, in place of the module ``time``."""

    def __init__(self) -> None:
        self.now = self.oversleeps_ns = 0
        self.naps: list[int] = []

    def monotonic_ns(self) -> int:
        self.now += 100
        return self.now

    def sleep(self, seconds: float) -> None:
        self.naps.append(round(seconds * 1e9))
        self.now += self.naps[-1] + self.oversleeps_ns


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    machine = Machine()
    monkeypatch.setattr(deadlines, "time", machine)
    monkeypatch.setattr(cache_warm_up, "time", machine)
    return machine


def made(machine: Machine, cost_ns: int | Callable[[], int], began: list[int]) -> CacheWarmUp:
    """A cache warm-up with a tick that takes ``cost_ns``, or what ``cost_ns()`` says."""

    def tick(deadline_ns: int, woke_ns: int, missed: int) -> None:  # noqa: ARG001
        began.append(machine.now)
        machine.now += cost_ns() if callable(cost_ns) else cost_ns

    return CacheWarmUp(tick, StandInClock(), PERIOD_NS, lambda: None)


def test_it_wakes_earlier_by_what_it_needs_and_is_still_on_time(machine: Machine) -> None:
    began: list[int] = []
    warm_up = made(machine, 60_000, began)
    assert warm_up.practise(500_000)
    waiter = SpinWaiter(50_000, warm_up)
    begun = deadline = machine.now
    for _ in range(200):
        deadline += PERIOD_NS
        began.clear()
        woke = waiter.wait(deadline)
        assert 0 <= woke - deadline < 500
        assert len(began) == 1
        assert began[0] <= deadline - 60_000
    needed = (machine.now - begun - sum(machine.naps[-200:])) / 200
    assert needed < 50_000 + 1.2 * 60_000, "no more of the period is spent than that"


def test_an_error_ends_the_warm_ups_and_nothing_else(machine: Machine) -> None:
    def tick(*_: object) -> NoReturn:
        raise ZeroDivisionError("by design")

    warm_up = CacheWarmUp(tick, StandInClock(), PERIOD_NS, lambda: None)
    assert not warm_up.practise(500_000)
    assert warm_up.fault == "ZeroDivisionError: by design"
    waiter = SpinWaiter(50_000, warm_up)
    deadline = machine.now + PERIOD_NS
    assert 0 <= waiter.wait(deadline) - deadline < 500
    assert machine.naps[-1] > 900_000, "nothing is set aside for it any more"


def test_damping_put_in_stays_below_the_ceiling_of_a_vibration() -> None:
    link = ("servo.load_inertia=0.003", "servo.transmission_stiffness=200",
            "servo.transmission_damping=0.0277", "servo.counts_per_rev=0")  # fmt: skip
    config = load_config("simulated", ("loop.clock=simulated", *link)).config
    servo = open_servo(config.servo_settings(), SimulatedClock(), None)
    schedule = guard_schedule(config, servo, True)
    for most, decision in zip(
        most_injected(config, servo, schedule), schedule.decisions, strict=True
    ):
        assert 0.0 < decision.damping + most < 0.71 * decision.damping_ceiling
