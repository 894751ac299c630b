"""A virtual wall on the simulated servo: it must grow and decay as its poles say."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.theory.boundary import chain_ceiling
from haptic_wall.controller.theory.chain import two_masses
from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.simulated import SimulatedBus
from haptic_wall.hw.truth import EncoderSide, TrueServo
from tests.support.one_servo import OneServo
from tests.theory.oracles import LinkedLoop, Loop, linked_radius, radius

PERIOD = 1e-3
PERIOD_NS = 1_000_000


def wall_motion(
    true: TrueServo, stiffness: float, virtual_damping: float, ticks: int
) -> NDArray[np.float64]:
    """Sampled positions of a two-sided wall at 0 on the backward difference, with no delay."""
    clock = SimulatedClock()
    servo = OneServo(SimulatedBus([true], clock))
    servo.start()
    before = true.position
    positions = []
    for tick in range(ticks):
        clock.wait_until(tick * PERIOD_NS)
        servo.request()
        position = servo.collect(clock.now_ns()).position
        servo.write(-stiffness * position - virtual_damping * (position - before) / PERIOD)
        positions.append(position)
        before = position
    servo.close()
    return np.array(positions)


def growth_per_second(positions: NDArray[np.float64]) -> float:
    """Rate of the one oscillation that is left, from x[k+2] = 2 r cos(w) x[k+1] - r² x[k]."""
    fit, *_ = np.linalg.lstsq(
        np.column_stack([positions[1:-1], positions[:-2]]), positions[2:], rcond=None
    )
    return 0.5 * math.log(-fit[1]) / PERIOD


def linear_servo(inertia: float, damping: float, delay: float) -> TrueServo:
    """Neither encoder nor friction, and nothing that saturates."""
    return TrueServo(
        inertia=inertia,
        damping=damping,
        delay=delay,
        counts_per_rev=0,
        torque_limit=1e300,
        position=0.01,
    )


@pytest.mark.parametrize("delay_samples", [0.0, 0.3, 1.0, 1.5, 2.0, 5.0])
@pytest.mark.parametrize("share", [0.8, 0.97, 1.03, 1.3])
@pytest.mark.parametrize("virtual_damping", [0.0, 0.05])
def test_motion_grows_as_the_dominant_pole(
    delay_samples: float, share: float, virtual_damping: float
) -> None:
    inertia, damping, delay = 0.011951, 0.011692, delay_samples * PERIOD
    stiffness = share * (damping + virtual_damping) / (PERIOD / 2 + delay)
    loop = Loop(inertia, damping, stiffness, virtual_damping, PERIOD, delay)
    expected = math.log(radius(loop)) / PERIOD
    motion = wall_motion(linear_servo(inertia, damping, delay), stiffness, virtual_damping, 1200)
    # By the second half the faster poles have died out.
    assert growth_per_second(motion[600:]) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(("encoder", "beyond"), [("motor", 1.02), ("output", 1.2)])
def test_two_masses_grow_beyond_their_ceiling_as_their_poles_say(
    encoder: EncoderSide, beyond: float
) -> None:
    true = linked_servo(encoder)
    servo = (true.inertia, true.damping, true.load_inertia, 200.0, true.transmission_damping)
    ceiling = float(chain_ceiling(*two_masses(*servo, encoder=encoder), PERIOD, 0.0))
    loop = LinkedLoop(*servo, PERIOD, 0.0, 1, encoder)
    for share in (1.0 / beyond, beyond):
        positions = wall_motion(true, 2.0, share * ceiling, 3000)
        growth = math.log(linked_radius(loop, 2.0, share * ceiling)) / PERIOD
        assert (growth > 0.0) == (share > 1.0)
        if share > 1.0:
            assert growth_per_second(positions[-500:]) == pytest.approx(growth, rel=0.02)
        else:
            bends = np.abs(np.diff(positions, 2))
            assert bends[-300:].max() < 0.4 * bends[:300].max()


def linked_servo(encoder: EncoderSide) -> TrueServo:
    """A load of 0.003 kg·m² that vibrates at 46 Hz with a damping ratio of 2 %."""
    return replace(
        linear_servo(0.011951, 0.011692, 0.0),
        load_inertia=0.003,
        transmission_stiffness=200.0,
        transmission_damping=0.0277,
        encoder=encoder,
    )
