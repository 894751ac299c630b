"""Of made-up hits each that did what it must not is found, and none is invented."""

import math
from dataclasses import replace

import pytest

from scripts.run_faults import FAULTS, Fault
from scripts.studies.kill_times import Hit, as_wanted

NAMED = {fault.name: fault for fault in FAULTS}
RECORDER, LOOP = NAMED["recorder: SIGKILL"], NAMED["loop: SIGKILL"]
SUPERVISOR = NAMED["supervisor: SIGKILL"]
WENT_ON = Hit(None, "nothing, the run goes on", 130, 0, 0, 5.0)
ENDED = Hit(40.3, "Bus Watchdog", 3, 0, 0, 5.0)


@pytest.mark.parametrize(
    ("fault", "hit", "wanted"),
    [
        (RECORDER, WENT_ON, True),
        (RECORDER, replace(WENT_ON, time_ms=40.3), False),
        (RECORDER, replace(WENT_ON, time_ms=math.inf), False),
        (RECORDER, replace(WENT_ON, status=3), False),
        (RECORDER, replace(WENT_ON, status=None), False),
        (RECORDER, replace(WENT_ON, lost=1), False),
        (RECORDER, replace(WENT_ON, left=1), False),
        (LOOP, ENDED, True),
        (LOOP, replace(ENDED, time_ms=60.1), False),
        (LOOP, replace(ENDED, left=1), False),
        (LOOP, replace(ENDED, lost=250), True),  # some must be: who would write them is dead
        (SUPERVISOR, replace(ENDED, time_ms=77.1, status=-9), True),  # the loop renders until then
        (SUPERVISOR, replace(ENDED, time_ms=math.inf, status=-9), False),
    ],
)
def test_a_run_goes_on_whole_or_its_torque_ends_in_time(
    fault: Fault, hit: Hit, wanted: bool
) -> None:
    assert as_wanted(fault, hit) == wanted
