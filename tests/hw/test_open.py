"""From settings to a servo: the right one, or an error; never another one."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import pytest

from haptic_wall.hw.clock import MonotonicClock, SimulatedClock
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.errors import PortError, ServoMissingError, UnfitServoError
from haptic_wall.hw.open import cut_torque, open_bus, open_port
from haptic_wall.hw.servo import Outcome
from haptic_wall.hw.settings import ServoSettings
from haptic_wall.hw.simulated import SimulatedBus
from haptic_wall.hw.truth import TrueServo
from tests.hw.conftest import Terminal
from tests.typed import not_none

TRUE = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09, position=-0.3)


def settings(
    port: str = "", true: TrueServo | None = None, servo_id: int = 1, model: str = "XM430-W350"
) -> ServoSettings:
    return ServoSettings(port, 4_000_000, servo_id, model, true=true, backend="dynamixel")


def test_simulated_settings_are_a_simulated_servo() -> None:
    assert isinstance(open_bus([ServoSettings(true=TRUE)], SimulatedClock()), SimulatedBus)


def test_a_refused_servo_leaves_the_port_to_the_next(terminal: Terminal) -> None:
    fussy = replace(settings(terminal.path), torque_limit=1e-9)
    for _ in range(2):
        with pytest.raises(UnfitServoError, match="smallest torque"):
            open_bus([fussy], MonotonicClock())
    os.close(not_none(open_port([settings(terminal.path)])))


def test_a_bus_in_memory_needs_the_simulated_clock() -> None:
    with pytest.raises(PortError, match=r"loop\.clock=simulated"):
        open_bus([settings(true=TRUE)], MonotonicClock())


@pytest.mark.parametrize("open_it", [open_port, lambda s: open_bus(s, MonotonicClock())])
def test_no_port_is_an_error_and_never_a_simulated_servo(open_it: Callable[..., object]) -> None:
    with pytest.raises(PortError, match=r"No serial port is configured: set servo\.port"):
        open_it([settings()])
    with pytest.raises(PortError, match="does not exist"):
        open_it([settings("/dev/ttyNOWHERE")])


def test_a_port_with_nobody_on_it_is_a_missing_servo(terminal: Terminal) -> None:
    servo = open_bus([settings(terminal.path)], MonotonicClock())
    with pytest.raises(ServoMissingError, match=rf"id 1 at 4000000 baud on {terminal.path}"):
        servo.start()
    servo.close()


def test_cutting_on_a_silent_port_does_not_claim_that_torque_is_off(terminal: Terminal) -> None:
    descriptor = not_none(open_port([settings(terminal.path)]))
    assert cut_torque([settings(terminal.path)], descriptor, MonotonicClock()) is False
    os.fstat(descriptor)  # still open
    os.close(descriptor)


def test_whoever_opens_a_port_can_cut_the_torque_and_loads_nothing_then(terminal: Terminal) -> None:
    """Loading it when the loop has died cost 10 ms, with the torque on."""
    program = (
        "import sys\n"
        "from haptic_wall.hw.clock import MonotonicClock\n"
        "from haptic_wall.hw.open import cut_torque, open_port\n"
        "from haptic_wall.hw.settings import ServoSettings\n"
        f"settings = ServoSettings({terminal.path!r}, 4_000_000, 1, 'XM430-W350',"
        " backend='dynamixel')\n"
        "port = open_port([settings])\n"
        "before = set(sys.modules)\n"
        "cut_torque([settings], port, MonotonicClock())\n"
        "sys.exit(', '.join(set(sys.modules) - before))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], stderr=subprocess.PIPE, text=True, check=False
    )
    assert ended.stderr.strip() == ""


def test_several_servos_are_one_bus_and_the_hands_wait_for_the_last() -> None:
    clock = SimulatedClock()
    true = replace(TRUE, hand="lean")
    servos = [replace(settings(true=true), id=id_) for id_ in (4, 2, 3, 1)]
    bus = open_bus(servos, clock)
    assert isinstance(bus, DynamixelGroup)
    assert [facts.name[-11:-10] for facts in bus.facts] == ["4", "2", "3", "1"]
    assert all(check.ok for checks in bus.start() for check in checks)
    bus.request()
    readings = bus.collect(clock.now_ns() + 1_000_000)
    assert [reading.outcome for reading in readings] == [Outcome.OK] * 4
    assert [reading.position for reading in readings] == pytest.approx([-0.3] * 4, abs=0.02)
    assert bus.stop()
    bus.close()


def test_a_simulated_servo_has_no_port_and_ends_with_its_process() -> None:
    settings = ServoSettings(true=TrueServo(0.01))
    assert open_port([settings]) is None
    assert cut_torque([settings], None, SimulatedClock()) is True


def test_a_real_servo_without_a_port_is_never_said_to_be_off() -> None:
    assert cut_torque([settings()], None, MonotonicClock()) is False
