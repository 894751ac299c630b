"""Our own servos keep the contract that other people's backends are held to."""

import pytest

from haptic_wall.controller.pytest_plugin.servo_contract import Rig, ServoContract
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.open import open_servo
from haptic_wall.hw.settings import ServoSettings
from haptic_wall.hw.truth import TrueServo

PERIOD_NS = 1_000_000
LOADED = TrueServo(
    inertia=0.012,
    damping=0.012,
    coulomb=0.09,
    delay=0.4e-3,
    load_inertia=0.003,
    transmission_stiffness=2000.0,
    transmission_damping=1.0,  # so much that nothing vibrates after the stop
)


class TestSimulated(ServoContract):
    def make_rig(self) -> Rig:
        clock = SimulatedClock(start_ns=7 * PERIOD_NS)
        true = TrueServo(
            inertia=0.012, damping=0.012, coulomb=0.09, torque_step=0.001, delay=0.4e-3
        )
        return Rig(open_servo(ServoSettings(true=true), clock), clock)


class TestSimulatedWithALoad(ServoContract):
    def make_rig(self) -> Rig:
        clock = SimulatedClock(start_ns=7 * PERIOD_NS)
        return Rig(open_servo(ServoSettings(true=LOADED), clock), clock)


class TestSimulatedWithoutEncoder(ServoContract):
    def make_rig(self) -> Rig:
        clock = SimulatedClock()
        true = TrueServo(inertia=0.012, counts_per_rev=0)
        return Rig(open_servo(ServoSettings(true=true), clock), clock)


class TestDynamixelInMemory(ServoContract):
    def make_rig(self) -> Rig:
        clock = SimulatedClock(start_ns=7 * PERIOD_NS)
        true = TrueServo(inertia=0.012, damping=0.012, coulomb=0.09)
        settings = ServoSettings("", 4_000_000, 1, "XM430-W350", true=true, backend="dynamixel")
        return Rig(open_servo(settings, clock), clock)


@pytest.mark.whole
class TestDynamixelWithALoad(ServoContract):
    def make_rig(self) -> Rig:
        clock = SimulatedClock(start_ns=7 * PERIOD_NS)
        settings = ServoSettings("", 4_000_000, 1, "XM430-W350", true=LOADED, backend="dynamixel")
        return Rig(open_servo(settings, clock), clock)
