"""The table of rules: a start refuses by it what `doctor` calls wrong, in the same words."""

from __future__ import annotations

import random

import pytest

from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.rules import RULES, Verdict, judge, judge_model, read_servo
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.errors import UnfitServoError
from tests.cases import sampled
from tests.hw.dynamixel.bench import BAUD, Bench

CHOICES = {
    "torque_enable": (0, 1),
    "hardware_error_status": (0, 1, 0x20, 0x40),
    "drive_mode": range(16),
    "startup_configuration": range(4),
    "return_delay_time": (0, 250),
    "secondary_id": (9, 252, 253, 255),
    "shutdown": (0, 52, 53),
    "current_limit": (0, 1, 1193, 1194, 0x7FFF),
    "pwm_limit": (0, 400, 885),
    "min_voltage_limit": (95, 121, 160),
    "max_voltage_limit": (95, 119, 160),
    "temperature_limit": (20, 40, 80),
}


@pytest.mark.parametrize("seed", sampled(range(400), 25))
def test_a_start_refuses_by_the_table_and_by_nothing_else(seed: int) -> None:
    draw = random.Random(seed)
    bench = Bench(probe_torque=0.0, firmware=draw.choice((38, 44, 48)))
    model = MODELS["XM430-W350"]
    table = Table.on(bench.line, BAUD, 1, "memory", model)
    table.registers = model.registers_at(bench.truth.firmware)
    names = sorted(CHOICES.keys() & table.registers.keys())
    for name in draw.sample(names, draw.choice((0, 1, 1, 2, len(names)))):
        bench.truth.memory[name] = draw.choice(CHOICES[name])
    before = {name: bench.truth.memory[name] for name in names}
    seen = read_servo(table, model, 4.1 / 2.3, 0.0)
    judged = list(judge(seen))
    assert {name: bench.truth.memory[name] for name in names} == before, "judging only reads"
    refused = [check for rule, check in judged if rule.refuses and not check.ok]
    try:
        checks = bench.servo.start()
    except UnfitServoError as error:
        assert refused, error
        assert all(fault.fix in str(error) for fault in refused)
        assert bench.truth.memory["torque_enable"] == 0
        for name in before.keys() - {"torque_enable"}:
            assert bench.truth.memory[name] == before[name], "what a person set stays"
        return
    assert refused == []
    assert all(check.ok for check in checks)


def test_every_fault_has_a_remedy_and_every_repair_is_of_a_register_that_is_read() -> None:
    registers = MODELS["XM430-W350"].registers
    for rule in RULES:
        assert set(rule.reads) <= registers.keys()
        assert not rule.register or rule.register in rule.reads
    assert Verdict("2", "1", "It has two", "take one").check("count").fix == "It has two: take one"
    assert Verdict("1", "1", advice="have two").check("count").ok


@pytest.mark.parametrize(
    ("model", "way"),
    [
        ("XL330-M288", "make a new file, `haptic-wall init FILE --from xl330-m288`"),
        ("XM540-W270", "set servo.model=XM540-W270 and its own values (`haptic-wall identify`)"),
    ],
)
def test_another_model_has_its_own_belief_and_torque_limit(model: str, way: str) -> None:
    check = judge_model(MODELS[model].number, "XM430-W350")
    told = "model.* and servo.torque_limit belong to a model too"
    assert not check.ok
    assert check.fix.endswith(f"connect an XM430-W350, or {way}: {told}")


def test_a_torque_limit_that_the_model_cannot_give_is_told() -> None:
    bench = Bench(probe_torque=0.0)
    model = MODELS["XM430-W350"]
    table = Table.on(bench.line, BAUD, 1, "memory", model)
    for limit, said in ((4.1, ""), (5.8, "an XM430-W350 gives at most 5.7 N·m at 12 V")):
        checks = {
            check.name: check for _, check in judge(read_servo(table, model, 4.1 / 2.3, limit))
        }
        assert checks["current limit"].ok
        assert said in checks["current limit"].fix
        assert bool(said) == bool(checks["current limit"].fix)
