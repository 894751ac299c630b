"""An adapter that hands replies over once a millisecond: the pipelined schedule holds its rate."""

import numpy as np
import pytest

from haptic_wall.controller.theory.checks import IntArray
from tests.support.memory_session import LIMITS_OF_HARDWARE, mistaken, run_in_memory

MS_NS = 1_000_000
WALL = ("servo.hand=tap", "wall.stiffness=30", "wall.damping=0.02")
"""A knock every second: at 5 rad/s a sample of the period before is three counts off"""
PIPELINED = (*LIMITS_OF_HARDWARE, *WALL, "loop.rate_hz=1000", "servo.schedule=pipelined")


@pytest.mark.parametrize("shift_us", [0, 450, 900])
def test_no_phase_makes_every_pipelined_reply_miss_its_tick(shift_us: int) -> None:
    # Blocks of 62 bytes move the timer's grid at every look at the servo's health, which is longer:
    # also into the phases where a request sent after a loss would miss its tick again, for ever.
    run = run_in_memory(PIPELINED, 0.5, adapter=(MS_NS, 62), shift_ns=shift_us * 1000)
    assert run.result.stop_reason == "duration"
    assert run.result.missed == 0
    age: IntArray = run.ticks["age_ns"]
    assert np.percentile(age, 99) <= 2 * MS_NS
    assert mistaken(run) == 0
