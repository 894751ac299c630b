"""The checked start: what is refused, what is set up, and that torque is proved before it is used.

Over the emulated bus in memory, on the simulated clock; the servo's registers and its true state
are looked at from outside.
"""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

from haptic_wall.hw.dynamixel.codec import ErrorCode, Instruction, Parser
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.errors import (
    ServoError,
    ServoLostError,
    ServoMissingError,
    UnfitServoError,
)
from haptic_wall.hw.plant.mechanism import OPERATOR_WAIT_S
from tests.cases import sampled
from tests.hw.dynamixel.bench import TRUE, Bench
from tests.support.one_servo import OneServo

COUNT = 2 * 3.141592653589793 / 4096


def refused(bench: Bench, *, match: str) -> None:
    """Starting raises, and leaves torque off, at rest, and without a goal."""
    with pytest.raises(UnfitServoError, match=match):
        bench.servo.start()
    assert bench.truth.memory["torque_enable"] == 0
    assert bench.state.torque == 0.0
    with pytest.raises(RuntimeError):
        bench.servo.write(0.1)


def test_a_servo_fresh_from_the_factory_is_set_up_and_checked_in_order() -> None:
    bench = Bench()
    checks = bench.servo.start()
    assert all(check.ok for check in checks)
    assert all(check.found for check in checks)
    warm = {"temperature"}  # it rises in use
    assert [(check.name, check.found) for check in checks[:-2] if check.name not in warm] == [
        ("model", "XM430-W350 (1020)"),
        ("status return level", "2"),
        ("firmware", "48"),
        ("torque at the start", "off"),
        ("hardware error", "none"),
        ("drive mode", "normal"),
        ("start-up configuration", "0"),
        ("current limit", "1193 (5.72 N·m)"),
        ("supply", "12 V"),
        ("operating mode", "3, set to 0"),
        ("return delay", "250, set to 0"),
        ("goal current", "0"),
        ("goal pwm", "885"),
        ("bus watchdog", "0, set to 2"),
        ("position", f"{-196 * COUNT:.3f} rad"),
        ("adapter reply", "0.1 ms, longest 0.1 ms"),
        ("torque", "off, set to on"),
    ]
    assert checks[-2].name == "torque sign"
    watched = "torque enable, bus watchdog, supply, temperature every 0.2 s"
    assert (checks[-1].name, checks[-1].found) == ("watched while it runs", watched)
    bench.wait(0.001)  # the last goal arrives
    assert bench.state.torque == 0.0
    assert bench.truth.memory["torque_enable"] == 1
    assert bench.truth.memory["goal_current"] == 0
    assert bench.servo.facts.torque_limit == pytest.approx(1193 * 2.69e-3 * 4.1 / 2.3)


@pytest.mark.parametrize("busy_ms", [2, 10, 40, 80])
def test_a_servo_that_is_silent_while_it_stores_eeprom_is_waited_for(
    busy_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(probe_torque=0.0)
    stored, store = [], bench.truth.write

    def slow(address: int, data: bytes, now_ns: int) -> ErrorCode:
        if address < 64:
            stored.append(address)
            bench.truth.answers_from_ns = now_ns + busy_ms * 1_000_000
        return store(address, data, now_ns)

    monkeypatch.setattr(bench.truth, "write", slow)
    assert all(check.ok for check in bench.servo.start())
    assert stored == [11, 9], "each once: mode, return delay"


@pytest.mark.parametrize("timer_ms", [0, 1])
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_replies_under_another_id_are_never_used(timer_ms: int, share: float) -> None:
    bench = Bench(timer_ms=timer_ms)
    bench.bus.inject(f"wrong-id:to=7,way=reply,p={share}", bench.clock.now_ns())
    with pytest.raises(ServoError, match=r"No servo answers|answered before|answers single"):
        for _ in range(9):
            bench.servo.start()
    assert bench.truth.memory["torque_enable"] == 0 or share < 1.0


def test_a_servo_that_is_set_up_is_not_written_to_again() -> None:
    """EEPROM wears."""
    bench = Bench(probe_torque=0.0)
    bench.servo.start()
    bench.servo.stop()
    assert bench.found("operating mode") == "0"
    assert bench.found("return delay") == "0"


def test_the_start_never_makes_more_torque_than_the_probe_may() -> None:
    """The mode change sets the goal to Current Limit: it must be zeroed before torque is on."""
    bench = Bench(probe_torque=0.2)
    bench.servo.start()
    assert max(abs(state.torque) for state in bench.line.states) <= 0.2 + 0.0048


@pytest.mark.parametrize(
    ("settings", "current_limit", "allowed"),
    [({"torque_limit": 0.1}, 1193, 0.1), ({}, 25, 25 * 0.0048)],
)
def test_the_probe_keeps_to_every_limit(
    settings: dict[str, Any], current_limit: int, allowed: float
) -> None:
    """A goal beyond Current Limit would be refused without a word."""
    bench = Bench(replace(TRUE, coulomb=0.25), **settings)
    bench.truth.memory["current_limit"] = current_limit
    refused(bench, match=r"did not move at 0\.\d+ N·m")
    pushed = max(abs(state.torque) for state in bench.line.states)
    assert allowed - 0.0048 <= pushed <= allowed


def torque_was_enabled(bench: Bench) -> bool:
    frames = [frame for data in bench.line.frames for frame in Parser().feed(data)]
    return any(frame.params == bytes([64, 0, 1, 0, 1, 1]) for frame in frames)


# What is refused


@pytest.mark.parametrize(
    ("register", "value", "message"),
    [
        ("min_voltage_limit", 130, r"supplied with 12 V, wanted 13 to 16 V: check the supply"),
        ("temperature_limit", 20, r"has \d+ °C, wanted at most 18 °C .*let it cool"),
    ],
)
def test_a_servo_out_of_its_own_limits_is_refused(register: str, value: int, message: str) -> None:
    bench = Bench()
    bench.truth.memory[register] = value
    refused(bench, match=message)


def written(bench: Bench) -> list[int]:
    """The instructions sent that change a servo."""
    frames = [frame for data in bench.line.frames for frame in Parser().feed(data)]
    asking = (Instruction.PING, Instruction.READ)
    return [frame.instruction for frame in frames if frame.instruction not in asking]


def test_nothing_is_written_to_a_servo_whose_control_table_is_not_known() -> None:
    """Where we have Torque Enable, it may have anything: in a Dynamixel-P an indirect address."""
    bench = Bench()
    bench.truth.model = replace(bench.truth.model, number=2020)
    with pytest.raises(
        UnfitServoError,
        match=r"model number 2020 is not known, .*nothing was written to it: "
        r"connect an XM430-W350.*switch its power off",
    ):
        bench.servo.start()
    assert bench.servo.stop() is False
    bench.servo.close()
    assert written(bench) == []


def test_nothing_is_written_to_a_servo_that_never_answered() -> None:
    bench = Bench(id=2)
    with pytest.raises(ServoMissingError, match=r"as id 2 at 4000000 baud.*wall scan`.*doctor"):
        bench.servo.start()
    assert bench.servo.stop() is False
    assert written(bench) == []


def test_torque_goes_off_too_where_a_known_model_is_not_the_configured_one() -> None:
    bench = Bench(model="XM430-W210")
    bench.truth.memory["torque_enable"] = 1
    refused(bench, match="XM430-W350")


def test_a_model_without_current_mode_is_refused_by_its_name() -> None:
    bench = Bench()
    bench.truth.model = replace(bench.truth.model, number=1060)
    refused(bench, match=r"XL430-W250 \(model number 1060\), which has no current mode")
    assert written(bench) == []
    with pytest.raises(UnfitServoError, match=r"XL430-W250 is no known model.*one of XL330-M077"):
        OneServo.driven(replace(bench.settings, model="XL430-W250"), bench.line)


def test_a_firmware_without_watchdog_is_refused() -> None:
    refused(Bench(firmware=37), match=r"firmware 37 has no Bus Watchdog \(38 or later has\)")


@pytest.mark.parametrize(
    ("register", "value", "match"),
    [
        ("hardware_error_status", 0x20, r"hardware error \(overload\).*reboot"),
        ("hardware_error_status", 0x05, r"hardware error \(input voltage, overheating\)"),
        ("drive_mode", 0x01, r"is reverse:.*--fix` clears these bits of Drive Mode \(10\)"),
        ("drive_mode", 0x02, r"is slave of a dual joint:.*--fix` clears these bits"),
        ("drive_mode", 0x08, r"is torque on by goal update:.*--fix` clears these bits"),
        ("startup_configuration", 1, r"torque on at power-up.*Startup Configuration \(60\)"),
        ("startup_configuration", 2, r"old goals restored.*Startup Configuration \(60\)"),
        ("current_limit", 0, r"raise Current Limit \(38\)"),
        ("current_limit", 1194, r"Current Limit \(38\) reads 1194,.*at most 1193.*start again"),
        ("current_limit", 0x7FFF, r"Current Limit \(38\) reads 32767,.*replace"),
    ],
)
def test_what_only_a_person_may_change_is_refused(register: str, value: int, match: str) -> None:
    bench = Bench()
    bench.truth.memory[register] = value
    refused(bench, match=match)
    assert bench.truth.memory[register] == value
    assert not torque_was_enabled(bench)


def test_a_dangerous_servo_keeps_its_settings_and_never_gets_a_goal() -> None:
    """With torque-on-by-goal-update even a goal of zero would switch the torque on."""
    bench = Bench()
    bench.truth.memory["drive_mode"] = 0x08
    refused(bench, match="torque on by goal update")
    assert bench.truth.memory["operating_mode"] == 3
    written = [
        int.from_bytes(frame.params[:2], "little")
        for data in bench.line.frames
        for frame in Parser().feed(data)
        if frame.instruction in (Instruction.WRITE, Instruction.SYNC_WRITE)
    ]
    assert set(written) == {68, 64}  # that it replies; torque off, by the refusal


def test_an_older_firmware_is_not_asked_for_a_register_that_it_does_not_have() -> None:
    bench = Bench(firmware=44)
    checks = bench.servo.start()
    assert all(check.ok for check in checks)
    assert "start-up configuration" not in {check.name for check in checks}
    frames = [frame for data in bench.line.frames for frame in Parser().feed(data)]
    asked = {
        int.from_bytes(frame.params[:2], "little")
        for frame in frames
        if frame.instruction == Instruction.READ
    }
    assert 6 in asked, "the firmware"
    assert 60 not in asked, "where Startup Configuration would be"


def test_an_adapter_that_returns_what_is_sent_harms_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench()
    write, read, sent = bench.line.write, bench.line.read, bytearray()

    def echoing_write(data: bytes) -> None:
        sent.extend(data)
        write(data)

    def echoed_read() -> bytes:
        echo = bytes(sent)
        sent.clear()
        return echo + read()

    monkeypatch.setattr(bench.line, "write", echoing_write)
    monkeypatch.setattr(bench.line, "read", echoed_read)
    wait = bench.line.wait
    monkeypatch.setattr(bench.line, "wait", lambda until: bool(sent) or wait(until))
    assert all(check.ok for check in bench.servo.start())
    bench.cycle(0.3)
    assert bench.servo.counts.lost == 0
    assert bench.servo.stop() is True


# What is set up


@pytest.mark.parametrize(
    ("register", "value", "check", "found"),
    [
        ("torque_enable", 1, "torque at the start", "on, set to off"),
        ("status_return_level", 0, "status return level", "0, set to 2"),
        ("status_return_level", 1, "status return level", "1, set to 2"),
    ],
)
def test_what_a_start_needs_otherwise_is_set_first(
    register: str, value: int, check: str, found: str
) -> None:
    """With the torque on EEPROM is locked, and with it the mode."""
    bench = Bench(probe_torque=0.0)
    bench.truth.memory[register] = value
    assert bench.found(check) == found
    assert bench.truth.memory["operating_mode"] == 0


def test_a_tripped_watchdog_is_cleared() -> None:
    bench = Bench()
    bench.servo.start()
    bench.wait(1.0)
    assert bench.state.torque == 0.0
    assert bench.truth.table.tripped
    bench.servo.stop()
    assert bench.servo.start()[-1].ok


# The torque's sign

FRICTIONS = [(0.0, 0.0), (0.0, 0.012), (0.005, 0.0), (0.02, 0.012), (0.09, 0.012), (0.25, 0.0)]


@pytest.mark.parametrize("direction", [-1, 1])
@pytest.mark.parametrize("inertia", sampled([0.012, 0.001, 0.1], 3))
@pytest.mark.parametrize(("coulomb", "damping"), sampled(FRICTIONS, 3))
def test_the_probe_moves_a_little_and_leaves_the_shaft_nearly_at_rest(
    inertia: float, coulomb: float, damping: float, direction: int
) -> None:
    true = replace(TRUE, inertia=inertia, coulomb=coulomb, damping=damping)
    bench = Bench(true, probe_direction=direction)
    assert bench.found("torque sign").startswith("-3" if direction < 0 else "+3")
    travel = [(state.position - true.position) * direction for state in bench.line.states]
    # Three counts prove it; stopping a free shaft takes about as far again and half.
    assert max(travel) < 10 * COUNT
    assert min(travel) > -1 * COUNT
    begun = bench.state.position
    for _ in range(200):
        bench.cycle(0.0)
    assert abs(bench.state.position - begun) < 6 * COUNT


@pytest.mark.parametrize("kinetic", sampled([0.05, 0.1, 0.2], 3))
@pytest.mark.parametrize("direction", [-1, 1])
def test_a_shaft_that_sticks_more_than_it_rubs_is_not_driven_back(
    kinetic: float, direction: int
) -> None:
    """Gears do: the torque that breaks them loose is more than moving them needs, so that a brake
    measured by the push would turn the shaft round, toward the wall."""
    sticking = replace(TRUE, coulomb=0.28)
    bench = Bench(sticking, probe_direction=direction)
    write = bench.line.write

    def write_and_break_loose(data: bytes) -> None:
        write(data)
        if abs(bench.truth.state(bench.clock.now_ns()).velocity) > 0.0:
            mechanism = bench.truth.mechanism
            mechanism.mechanics = mechanism.mechanics._replace(coulomb=kinetic, static=kinetic)

    bench.line.write = write_and_break_loose  # type: ignore[method-assign]
    assert bench.found("torque sign").endswith("N·m")
    travel = [(state.position - sticking.position) * direction for state in bench.line.states]
    assert max(travel) < 15 * COUNT
    assert min(travel) > -1 * COUNT
    begun = bench.state.position
    for _ in range(100):
        bench.cycle(0.0)
    assert (bench.state.position - begun) * direction > -15 * COUNT


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_reversed_position_is_found_by_the_probe_alone(direction: int) -> None:
    """As if the servo had not told of it in its Drive Mode."""
    bench = Bench(replace(TRUE, coulomb=0.0), probe_direction=direction)
    bench.line.wrong_way = True
    refused(bench, match="moved the wrong way")


def losing_the_end_of_the_push(bench: Bench, times: int) -> None:
    """The first goals of zero after the push are lost."""
    write = bench.memory_line.write
    pushed: list[bool] = []
    lost: list[bool] = []

    def lose(data: bytes) -> None:
        (frame,) = Parser().feed(data)
        to_goal = frame.params[:1] == bytes([102])
        if to_goal and frame.params[5:] != bytes(2):
            pushed.append(True)
        elif to_goal and pushed and len(lost) < times:
            lost.append(True)
            return
        write(data)

    bench.memory_line.write = lose  # type: ignore[method-assign]


def test_a_lost_frame_does_not_leave_the_pushs_torque_on() -> None:
    bench = Bench()
    losing_the_end_of_the_push(bench, 1)
    assert bench.servo.start()[-1].ok
    bench.wait(0.001)
    assert bench.truth.memory["goal_current"] == 0
    assert bench.state.torque == 0.0


def test_a_push_whose_end_is_never_confirmed_ends_with_torque_off() -> None:
    bench = Bench(watchdog_s=2.54)
    losing_the_end_of_the_push(bench, 1000)
    with pytest.raises(ServoLostError, match=r"not confirmed its goal of zero torque.*cable"):
        bench.servo.start()
    assert bench.truth.memory["torque_enable"] == 0
    assert bench.state.torque == 0.0


def test_a_blocked_shaft_is_refused() -> None:
    bench = Bench(replace(TRUE, coulomb=2.0))
    begun = bench.clock.now_ns()
    refused(bench, match=r"did not move at 0\.3 N·m: free it.*servo\.probe_torque; 0 skips")
    assert bench.clock.now_ns() - begun < 2.1e9  # three pushes of half a second


def test_the_probe_can_be_skipped() -> None:
    bench = Bench(replace(TRUE, coulomb=2.0), probe_torque=0.0)
    assert bench.found("torque sign") == "not probed"
    assert bench.truth.memory["torque_enable"] == 1


@pytest.mark.parametrize("start_s", sampled([0.0, 0.3, 0.7, 1.0, 1.4, 2.0, 2.6, 3.2, 3.9, 4.5], 5))
def test_a_hand_that_comes_and_goes_does_not_falsify_the_probe(start_s: float) -> None:
    """The push moves at 0.6 rad/s half of the time."""
    bench = Bench(replace(TRUE, hand="push", position=-0.5))
    bench.truth.mechanism.engage_operator(bench.clock.now_ns())
    bench.wait(OPERATOR_WAIT_S + start_s)
    assert bench.servo.start()[-1].ok


def stalling(bench: Bench, stalls: int) -> None:
    """The machine stalls for 60 ms just after torque went on, so many times."""
    wait = bench.line.wait
    left = [stalls]

    def stall(deadline_ns: int) -> bool:
        armed = bench.truth.watchdog_ns is not None
        if armed and left[0]:
            left[0] -= 1
            bench.wait(0.06)
        return wait(deadline_ns)

    bench.line.wait = stall  # type: ignore[method-assign]


def test_torque_is_never_on_without_the_watchdog_when_that_is_armed_again() -> None:
    """Clearing it may bring back the goal at which it tripped, and the machine may stall again."""
    bench = Bench()
    stalling(bench, 1)
    unguarded = bench.spy_unguarded()
    assert bench.found("torque sign").startswith("-3 counts"), "the stall is got over"
    assert not any(unguarded)
    assert bench.truth.memory["torque_enable"] == 1
    assert bench.truth.memory["bus_watchdog"] == 2


def test_a_machine_that_always_stalls_is_told_apart_from_a_blocked_shaft() -> None:
    bench = Bench()
    stalling(bench, 1000)
    refused(bench, match=r"Bus Watchdog \(40 ms\) ended the probe.*servo\.watchdog_s")


@pytest.mark.parametrize("name", sampled(MODELS, 7))
def test_every_model_that_can_make_torque_starts(name: str) -> None:
    constant = 0.0 if MODELS[name].torque_constant else 2.0
    bench = Bench(replace(TRUE, torque_constant=constant), model=name)
    settings = replace(bench.settings, model=name, torque_constant=constant)
    servo = OneServo.driven(settings, bench.line)
    assert all(check.ok for check in servo.start())
    assert servo.stop()


def add_twin(bench: Bench, delay: int, *, position: float = 1.0, tick: int = 999) -> EmulatedServo:
    """Another servo with the same id, and this Return Delay Time [2 us]."""
    true, now_ns = replace(TRUE, position=position), bench.clock.now_ns()
    model, baud = bench.truth.model, bench.truth.baud
    twin = EmulatedServo(model, 1, 48, true, start_ns=now_ns, baud=baud, tick=tick)
    twin.memory["return_delay_time"] = delay
    bench.bus.servos += (twin,)
    return twin


@pytest.mark.parametrize("seed", sampled(range(100), 10))
def test_two_servos_with_one_id_get_no_torque(seed: int) -> None:
    """Unless they send the same bytes at the same time: the same delay, clock and position."""
    chance = random.Random(seed)
    baud = chance.choice([57_600, 1_000_000, *3 * [4_000_000]])
    probe_torque, timer_ms = chance.choice([0.0, 0.3]), chance.choice([0, 1, 16])
    bench = Bench(
        baud=baud, bus_baud=baud, timer_ms=timer_ms, period_s=0.02, probe_torque=probe_torque
    )
    if fault := chance.choice(["", "", "duplicate:p=0.5", "drop:p=0.05", "late:ms=20,p=0.1"]):
        bench.bus.inject(fault, bench.clock.now_ns())
    first, other = chance.choice([0, chance.randrange(255)]), chance.randrange(255)
    bench.truth.memory["return_delay_time"] = first
    other = chance.choice([first, other, other])
    position = chance.choice([-0.3, 1.0])
    twin = add_twin(bench, other, position=position, tick=12_345 if position == 1.0 else 999)
    chance.choice([bench.truth, twin]).memory["drive_mode"] = chance.choice([0, 1])
    silent = chance.choice([bench.truth, twin])
    silent.memory["status_return_level"] = chance.choice([0, 1, 2, 2, 2])
    with pytest.raises(ServoError) as refusal:
        bench.servo.start()
    assert "must not be driven" in str(refusal.value) or any(
        said in str(refusal.value) for said in ("Two servos answer", "a second servo with this id")
    )
    assert bench.truth.memory["torque_enable"] == twin.memory["torque_enable"] == 0
    apart_s, reply_s = abs(first - other) * 2e-6, 39 * 10 / baud
    if not fault and apart_s > reply_s + 2e-6:
        named = ("Two servos answer as id 1", "a second servo with this id")
        assert any(said in str(refusal.value) for said in named)


@pytest.mark.parametrize(("position", "tick"), [(TRUE.position, 999), (1.0, 12_345)])
def test_two_servos_with_one_id_and_the_same_settings_are_named(position: float, tick: int) -> None:
    """What they are set to is read without a fault; their clocks or positions collide."""
    bench = Bench()
    twin = add_twin(bench, bench.truth.memory["return_delay_time"], position=position, tick=tick)
    with pytest.raises(UnfitServoError, match="Two servos answer as id 1 "):
        bench.servo.start()
    assert bench.truth.memory["torque_enable"] == twin.memory["torque_enable"] == 0
