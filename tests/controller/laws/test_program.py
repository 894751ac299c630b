import math
from collections.abc import Sequence

import pytest

from haptic_wall.controller.laws.program import Phase, Program

T = 1e-3


def play(program: Program, positions: Sequence[float]) -> list[float]:
    return [program.torque(x, 0.0) for x in positions]


def test_positions_count_from_where_the_shaft_was() -> None:
    program = Program([Phase(0.01, stiffness=10.0, center=0.1)], T, 5.0)
    assert play(program, [2.0, 2.05]) == pytest.approx([1.0, 0.5])
    assert program.position == pytest.approx(2.1)


def test_a_phase_lasts_as_many_periods_as_it_was_given() -> None:
    program = Program([Phase(0.003, torque=1.0), Phase(0.002, torque=2.0)], T, 5.0)
    assert play(program, [0.0] * 7) == [1.0, 1.0, 1.0, 2.0, 2.0, 0.0, 0.0]
    assert program.done


def test_the_limit_holds_whatever_a_phase_asks() -> None:
    program = Program([Phase(0.01, stiffness=1e6, torque=3.0)], T, 0.5)
    assert play(program, [0.0, 1.0, -1.0]) == [0.5, -0.5, 0.5]


def test_the_centre_travels_at_its_speed_and_arrives() -> None:
    program = Program([Phase(1.0, stiffness=1.0, center=-0.0025, speed=1.0)], T, 5.0)
    assert play(program, [0.0] * 4) == pytest.approx([-0.001, -0.002, -0.0025, -0.0025])


def test_too_far_and_at_rest_end_a_phase() -> None:
    phases = [Phase(1.0, reach=0.2), Phase(1.0, still_s=0.005, still_band=0.001), Phase(1.0)]
    program = Program(phases, T, 5.0)
    play(program, [0.0, 0.19, 0.21])
    assert program.phase == 1
    play(program, [0.21 + 0.002 * k for k in range(50)])
    assert program.phase == 1, "it moves"
    play(program, [0.35] * 4)
    assert program.phase == 1
    play(program, [0.35])
    assert program.phase == 2


def test_a_sine_sweeps_evenly_between_its_frequencies() -> None:
    seconds, low, high = 2.0, 5.0, 25.0
    program = Program([Phase(seconds, torque=1.0, wave="sine", from_hz=low, to_hz=high)], T, 5.0)
    torques = play(program, [0.0] * 2000)
    exact = [
        math.sin(math.tau * (low + (high - low) * t / (2 * seconds)) * t)
        for t in (k * T for k in range(2000))
    ]
    # The phase is summed period by period: half a step of its frequency behind, at most.
    assert torques == pytest.approx(exact, abs=math.tau * (high - low) * T / 2 + 1e-6)


def test_no_phase_is_no_program() -> None:
    with pytest.raises(ValueError, match="at least one phase"):
        Program([], T, 1.0)
