"""When the wall may come on: tick by tick, on positions alone."""

import math
from collections.abc import Sequence

import pytest

from haptic_wall.controller.laws.engagement import Engagement, engage_torque

COUNT = math.tau / 4096


def gate_of(start_room: float = 0.0) -> Engagement:
    return Engagement(torque=0.1, position_step=COUNT, periods=50, start_room=start_room)


def ready_after(gate: Engagement, stiffness: float, penetrations: Sequence[float]) -> int | None:
    """The first tick in which the wall may come on; None: in none."""
    for tick, penetration in enumerate(penetrations, start=1):
        gate.sample(stiffness, penetration)
        if gate.ready:
            return tick
    return None


@pytest.mark.parametrize(
    ("penetration", "tick"),
    [(0.0, 50), (0.0099, 50), (-0.0099, 50), (0.0101, None), (-0.0101, None), (18.8, None)],
)
def test_the_wall_comes_on_after_fifty_unloaded_ticks(penetration: float, tick: int | None) -> None:
    assert ready_after(gate_of(), 10.0, [penetration] * 1000) == tick


def test_one_loaded_tick_begins_the_rest_anew() -> None:
    assert ready_after(gate_of(), 10.0, [*[0.0] * 49, 0.02, *[0.0] * 60]) == 100


def test_two_counts_of_any_stiffness_are_no_load() -> None:
    """Else a stiff wall could not come on at all: a reading may be a count off."""
    assert ready_after(gate_of(), 1e6, [2.0 * COUNT] * 50) == 50
    assert ready_after(gate_of(), 1e6, [2.01 * COUNT] * 50) is None
    assert gate_of().room(1e6) == 2.0 * COUNT
    assert gate_of().room(10.0) == pytest.approx(0.01)
    assert gate_of().room(0.0) == math.inf


@pytest.mark.parametrize("start_room", [0.0, 0.5])
def test_an_unknown_position_is_no_rest(start_room: float) -> None:
    assert ready_after(gate_of(start_room), 10.0, [math.nan] * 100) is None


def test_a_kick_is_allowed_at_the_start_and_within_its_room_only() -> None:
    assert ready_after(gate_of(0.5), 10.0, [0.6] * 100) is None
    gate = gate_of(0.5)
    assert ready_after(gate, 10.0, [0.4] * 100) == 50
    gate.restart()
    assert ready_after(gate, 10.0, [0.4] * 100) is None


def test_only_the_rise_of_the_stiffness_counts() -> None:
    gate = gate_of()
    assert gate.may_rise(1.0, 0.1)
    assert not gate.may_rise(1.1, 0.1)
    assert gate.may_rise(-5.0, 1.0), "a fall takes energy out"
    assert not gate.may_rise(1.0, math.nan)


@pytest.mark.parametrize(
    ("stall", "torque"), [(4.1, 0.1), (0.52, 0.026), (math.inf, 0.1), (2.0, 0.1), (1.9, 0.095)]
)
def test_the_torque_is_small_beside_the_servos(stall: float, torque: float) -> None:
    assert engage_torque(None, stall) == pytest.approx(torque)
    assert engage_torque(0.3, stall) == 0.3
