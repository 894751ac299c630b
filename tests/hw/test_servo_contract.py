"""Our own buses of 1, 2 and 6 servos keep the contract that other people's are held to."""

from dataclasses import replace

import pytest

from haptic_wall.controller.pytest_plugin.servo_contract import BusContract, Rig
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.simulated import SimulatedBus
from haptic_wall.hw.truth import TrueServo
from tests.support.buses import TRUE, emulated_bus

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
WITHOUT_ENCODER = TrueServo(inertia=0.012, counts_per_rev=0)


class TestSimulated(BusContract):
    trues: tuple[TrueServo, ...] = (replace(TRUE, torque_step=0.001, delay=0.4e-3),)

    def make_rig(self) -> Rig:
        clock = SimulatedClock(start_ns=7 * PERIOD_NS)
        return Rig(SimulatedBus(self.trues, clock), clock)


class TestSimulatedTwoWithALoadAndWithoutEncoder(TestSimulated):
    trues = (LOADED, WITHOUT_ENCODER)


@pytest.mark.whole
class TestSimulatedSix(TestSimulated):
    trues = (*TestSimulated.trues, LOADED, WITHOUT_ENCODER) * 2


class TestEmulated(BusContract):
    trues: tuple[TrueServo, ...] = (TRUE,)

    def make_rig(self) -> Rig:
        clock = SimulatedClock(start_ns=7 * PERIOD_NS)
        period_ns = PERIOD_NS if len(self.trues) < 6 else 2 * PERIOD_NS  # their replies take long
        return Rig(emulated_bus(self.trues, clock), clock, period_ns)


class TestEmulatedTwoWithALoad(TestEmulated):
    trues = (TRUE, LOADED)


@pytest.mark.whole
class TestEmulatedSix(TestEmulated):
    trues = (TRUE,) * 6
