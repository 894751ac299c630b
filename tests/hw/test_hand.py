"""A person's hand on a simulated servo: it pulls by its spring, and lets go by itself."""

import math
from collections.abc import Iterator

import pytest

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.hand import EVERY_NS, FASTEST, MOST_STIFFNESS, SILENCE_NS, SharedHand
from haptic_wall.hw.simulated import SimulatedBus
from haptic_wall.hw.truth import TrueServo
from tests.hw.dynamixel.emulated_client import Client

TICK_NS = 1_000_000


@pytest.fixture
def hand() -> Iterator[SharedHand]:
    made = SharedHand.create()
    yield made
    made.close()


class Held:
    """A servo without friction at rest, moved tick by tick."""

    def __init__(self, hand: SharedHand, load: float = 0.0) -> None:
        self.clock = SimulatedClock(5_000_000_000)
        true = TrueServo(
            inertia=0.01,
            damping=0.01,
            counts_per_rev=0,
            load_inertia=load,
            transmission_stiffness=200.0 if load else 0.0,
        )
        self.servo = SimulatedBus([true], self.clock)
        self.servo.take_hand(SharedHand(hand.descriptor))  # as another process sees it
        self.servo.start()

    def run(self, seconds: float) -> float:
        position = 0.0
        for _ in range(round(seconds * 1000)):
            self.clock.wait_until(self.clock.now_ns() + TICK_NS)
            self.servo.request()
            position = self.servo.collect(0)[0].position
            self.servo.write([0.0])
        return position


@pytest.mark.parametrize("load", [0.0, 0.005])
def test_it_brings_the_shaft_to_where_it_is(hand: SharedHand, load: float) -> None:
    held, position = Held(hand, load), 0.0
    assert held.run(0.1) == 0.0
    for _ in range(60):
        hand.hold(0.3, 4.0, position, held.clock.now_ns())
        position = held.run(0.05)
    assert position == pytest.approx(0.3, abs=1e-3)


def test_each_shaft_has_its_own_hand() -> None:
    hand = SharedHand.create([(1, 0.0), (1, 0.0)])
    true = TrueServo(inertia=0.01, damping=0.01, counts_per_rev=0)
    clock = SimulatedClock(5_000_000_000)
    bus = SimulatedBus([true, true], clock)
    bus.take_hand(SharedHand(hand.descriptor))
    bus.start()
    hand.of(1).hold(0.3, 4.0, 0.0, clock.now_ns())
    bus.request()
    bus.write([0.0, 0.0])
    clock.wait_until(clock.now_ns() + EVERY_NS)
    bus.request()
    first, second = bus.collect(0)
    hand.close()
    assert first.position == 0.0
    assert second.position > 0.01


def test_silence_lets_go(hand: SharedHand) -> None:
    held = Held(hand)
    hand.hold(0.3, 4.0, 0.0, held.clock.now_ns())
    begun_ns = held.clock.now_ns()
    assert hand.look(begun_ns + SILENCE_NS - 1) is not None
    assert hand.look(begun_ns + SILENCE_NS) is None
    held.run(SILENCE_NS * 1e-9)
    free = held.run(0.001)
    speed = (held.run(0.1) - free) / 0.1
    assert speed > 0.0
    assert held.run(0.1) - free == pytest.approx(0.2 * speed, rel=0.15), "it moves on by itself"


def test_the_emulated_servo_is_held_and_let_go_in_the_same_way(hand: SharedHand) -> None:
    """Through its bus: what the plant makes of the hand is read as a position."""
    client = Client(true=TrueServo(inertia=0.01, damping=0.01, position=1.0, torque_limit=10.0))
    servo = client.servos[1]
    servo.take_hand(SharedHand(hand.descriptor))
    client.enable_current_mode()

    def run(seconds: float) -> float:
        for _ in range(round(seconds * 1000)):
            client.pass_time(TICK_NS)
            client.read(1, 132, 4)
        return client.position()

    assert run(0.1) == 1.0
    position = 1.0
    for _ in range(60):
        hand.hold(1.3, 4.0, position, client.clock.now_ns())
        position = run(0.05)
    assert position == pytest.approx(1.3, abs=1e-3)
    hand.hold(1.6, 4.0, position, client.clock.now_ns())
    let_go_ns = client.clock.now_ns() + SILENCE_NS
    client.pass_time(let_go_ns - client.clock.now_ns())  # a bus that nobody uses meanwhile
    assert servo.mechanism.time_ns < let_go_ns
    run(0.001)
    begin = servo.state(client.clock.now_ns())
    client.pass_time(100 * TICK_NS)
    end = servo.state(client.clock.now_ns())
    assert begin.velocity != 0.0
    assert end.velocity == pytest.approx(begin.velocity * math.exp(-0.1), rel=1e-6), "it is free"


def test_it_moves_evenly_not_faster_than_an_arm_and_lets_go_at_once(hand: SharedHand) -> None:
    hand.hold(100.0, 1e9, 0.1, 1000)
    grasp = hand.look(1000)
    assert grasp is not None
    assert grasp.stiffness == MOST_STIFFNESS
    assert grasp.position(1000) == 0.1
    assert grasp.position(1000 + EVERY_NS // 2) == pytest.approx(0.1 + FASTEST * 0.025)
    hand.hold(0.0, 4.0, 7.0, 1000 + EVERY_NS // 2)  # where the shaft is no longer matters
    again = hand.look(1000 + EVERY_NS)
    assert again is not None
    assert again.origin == pytest.approx(0.1 + FASTEST * 0.025)
    hand.release()
    assert hand.look(2000) is None
