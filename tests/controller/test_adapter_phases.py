"""An adapter that hands replies over once a millisecond: the pipelined schedule holds its rate."""

import numpy as np
import pytest

from haptic_wall.controller.theory.checks import IntArray
from tests.cases import whole_only
from tests.support.memory_session import LIMITS_OF_HARDWARE, mistaken, run_in_memory

MS_NS = 1_000_000
WALL = ("servo.hand=tap", "wall.stiffness=30", "wall.damping=0.02")
"""A knock every second: at 5 rad/s a sample of the period before is three counts off"""
AUTO = (*LIMITS_OF_HARDWARE, *WALL, "loop.rate_hz=1000")
PIPELINED = (*LIMITS_OF_HARDWARE, *WALL, "loop.rate_hz=1000", "servo.schedule=pipelined")


@pytest.mark.parametrize("shift_us", [whole_only(0), 450, whole_only(900)])
def test_no_phase_makes_every_pipelined_reply_miss_its_tick(shift_us: int) -> None:
    # Blocks of 62 bytes move the timer's grid at every look at the servo's health, which is longer:
    # also into the phases where a request sent after a loss would miss its tick again, for ever.
    run = run_in_memory(PIPELINED, 0.5, adapter=(MS_NS, 62), shift_ns=shift_us * 1000)
    assert run.result.stop_reason == "duration"
    assert run.result.missed == 0
    age: IntArray = run.ticks["age_ns"]
    assert np.percentile(age, 99) <= 2 * MS_NS
    assert mistaken(run) == 0


@pytest.mark.whole
@pytest.mark.parametrize("timer_ms", [0, 1])
@pytest.mark.parametrize(
    "phase",
    [n if n % 5 == 0 else pytest.param(n, marks=pytest.mark.thorough) for n in range(20)],
)
def test_by_default_the_schedule_suits_the_adapter_at_every_phase(
    timer_ms: int, phase: int
) -> None:
    """As the better explicit one; without an adapter as ``immediate``."""
    adapter = (timer_ms * MS_NS, 510) if timer_ms else None
    shift_ns = phase * max(timer_ms, 1) * MS_NS // 20
    run = run_in_memory(AUTO, 0.3, adapter=adapter, shift_ns=shift_ns)
    assert run.result.stop_reason == "duration"
    explicit = f"servo.schedule={'pipelined' if timer_ms == 1 else 'immediate'}"
    same = run_in_memory((*AUTO, explicit), 0.3, adapter=adapter, shift_ns=shift_ns)
    for name in ("age_ns", "torque", "position", "outcome"):
        np.testing.assert_array_equal(run.ticks[name], same.ticks[name])
