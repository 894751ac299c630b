"""Faults on a configuration's emulated bus: said in words, checked, and on both kinds of bus."""

import json

import pytest

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.processes.emulator import emulator_arguments
from haptic_wall.controller.runtime.session import run_session
from haptic_wall.controller.runtime.session_result import Result
from haptic_wall.controller.runtime.telemetry import Telemetry
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.errors import UnfitServoError
from haptic_wall.hw.truth import TrueServo
from tests.cases import sampled
from tests.typed import not_none

EMULATED = "emulated-ideal"


def faults(*sets: str) -> tuple[str, ...]:
    return load_config(EMULATED, [f"servo.faults={text}" for text in sets]).config.servo.faults


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("drop:p=0.01", ("drop:p=0.01",)),
        ("late:ms=3,p=.1", ("late:ms=3,p=.1",)),
        ("drop:p=0.01 late:ms=3,p=.1", ("drop:p=0.01", "late:ms=3,p=.1")),
        ('["late:ms=3,p=.1", stuck]', ("late:ms=3,p=.1", "stuck")),
        ("[]", ()),
    ],
)
def test_one_fault_or_several_as_people_write_them(text: str, found: tuple[str, ...]) -> None:
    assert faults(text) == found


@pytest.mark.parametrize(
    ("source", "change", "words"),
    [
        (EMULATED, "servo.faults=drp:p=1", ["servo.faults", "did you mean drop?"]),
        (EMULATED, "servo.faults=stuck:id=7", ["has the id 7", "ids here are 1"]),
        (EMULATED, "servo.faults=5", ["found 5, wanted a list of texts"]),
        (EMULATED, "servo.faults=[1]", ["found [1], wanted a list of texts"]),
        ("simulated", "servo.faults=drop", ["no bus", "emulated-xm430"]),
        ("xm430-w350", "servo.faults=drop", ["servo.port", "is a real one"]),
        ("xm430-w350", "servo.gravity=0.1", ["servo.port", "is a real one"]),
    ],
)
def test_what_cannot_happen_is_refused_by_name(source: str, change: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as refused:
        load_config(source, [change])
    (problem,) = refused.value.problems
    for word in words:
        assert word in problem


def test_they_travel_between_processes_and_to_the_emulator() -> None:
    sets = ["servo.faults=drop:p=0.01 jump:counts=5", "servo.fault_seed=3"]
    sets += ["servo.load_inertia=0.003", "servo.transmission_stiffness=200"]
    loaded = load_config(EMULATED, sets).config
    config = Config.model_validate_json(loaded.model_dump_json())
    plan = json.loads(emulator_arguments(config.servos())[-1])
    assert (plan["faults"], plan["seed"]) == (["drop:p=0.01", "jump:counts=5"], 3)
    true = config.true_servo()
    assert TrueServo(**plan["own"]["1"]) == true
    assert true.load_inertia == 0.003


def simulated(*sets: str) -> Result:
    config = load_config(EMULATED, ["loop.clock=simulated", *sets]).config
    return run_session(config, SimulatedClock(), Telemetry.create(), 1.0)


@pytest.mark.whole
def test_they_happen_on_the_bus_in_memory_as_the_seed_says() -> None:
    counts = []
    for seed in (0, 0, 1):
        found = simulated("servo.faults=corrupt:p=0.05,way=reply", f"servo.fault_seed={seed}")
        assert found.stop_reason == "duration"
        bus = not_none(found.bus)
        counts.append((bus["corrupt"], bus["lost"]))
        assert 0.02 < sum(counts[-1]) / bus["cycles"] < 0.09
    assert counts[0] == counts[1] != counts[2]


def test_a_supply_outside_the_servo_s_limits_is_found_before_the_torque_is_on() -> None:
    with pytest.raises(UnfitServoError, match="supplied with 9 V"):
        simulated("servo.faults=supply:volts=9")


@pytest.mark.parametrize(("gap_s", "ended"), [(0.008, "duration"), (0.02, "trip:losses_in_row")])
def test_a_gap_far_below_the_watchdog_s_time_costs_no_run(gap_s: float, ended: str) -> None:
    """With the limits of hardware: 15 ms without a reading, a Bus Watchdog of 40 ms."""
    limits = ("safety.max_silence_s=0.015", "safety.max_loss=0.05", "servo.watchdog_s=0.04")
    found = simulated(f"servo.faults=drop:at=0.9,for={gap_s},way=reply", *limits)
    assert found.stop_reason == ended


@pytest.mark.parametrize("schedule", ["immediate", "pipelined"])
@pytest.mark.parametrize("rate_hz", sampled([1000, 50, 100, 200, 250, 2000], 3))
def test_a_servo_that_falls_silent_ends_the_run_within_the_watchdog_s_time(
    rate_hz: int, schedule: str
) -> None:
    telemetry = Telemetry.create()
    sets = (
        f"loop.rate_hz={rate_hz}",
        f"servo.schedule={schedule}",
        "safety.max_silence_s=0.015",
        "safety.max_loss=0.5",
        "servo.watchdog_s=0.04",
        "servo.faults=drop:at=1.2,way=reply",
    )
    config = load_config(EMULATED, ["loop.clock=simulated", *sets]).config
    found = run_session(config, SimulatedClock(), telemetry, 5.0)
    assert found.stop_reason in ("trip:losses_in_row", "trip:servo_lost")
    rows = telemetry.read(0)[0][:, 0]
    heard_ns = rows["sampled_ns"][-1]
    assert rows["deadline_ns"][-1] - heard_ns <= 40_000_000
