"""An adapter that hands replies over once a millisecond: the pipelined schedule holds its rate."""

import numpy as np
import pytest

from haptic_wall.controller.theory.checks import IntArray
from scripts.memory_session import LIMITS_OF_HARDWARE, run_in_memory
from scripts.studies.adapter_phases import WALL, mistaken

MS_NS = 1_000_000
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
