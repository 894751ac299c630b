"""The whole program behind an adapter that keeps replies back: it runs, softer, and says why.

In memory on the simulated clock; what the shaft did is the emulated bus's own record.
"""

from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.theory.checks import IntArray
from haptic_wall.hw.servo import Outcome
from tests.cases import whole_only
from tests.support.memory_session import run_in_memory
from tests.typed import not_none

MS = 1_000_000
TIMER_MS = 16
FREE_WALL = (
    "wall.side=both",
    "wall.damping=0.05",
    "servo.hand=none",
    "servo.kick=0.3",
    "servo.coulomb=0",
    "model.coulomb=0",
    "safety.max_speed=50",
)
"""A wall that also pulls, on a shaft without friction that starts beside it: nothing but the loop
decides whether it comes to rest."""


def swings(found: Any) -> list[float]:
    """The largest distance from the wall in each fifth of the run with the wall on [rad]."""
    begun = int(found.ticks["deadline_ns"][np.flatnonzero(found.ticks["stiffness"] > 0)[0]])
    ended = int(found.ticks["deadline_ns"][-1])
    truth = [
        abs(row.state.position)
        for row in found.truth
        if row.event == "state" and begun <= row.time_ns <= ended
    ]
    return [float(max(part)) for part in np.array_split(np.array(truth), 5)]


@pytest.mark.parametrize(
    ("rate_hz", "schedule"),
    [
        (1000, "pipelined"),
        (500, "immediate"),
        whole_only(1000, "immediate"),
        whole_only(500, "pipelined"),
    ],
)
def test_in_every_phase_it_runs_to_the_end_softer_and_says_why(
    rate_hz: int, schedule: str, thorough: bool, wholly: bool
) -> None:
    alone = ("servo.hand=none", "loop.warm_up_s=0.3")  # nobody moves the shaft into the wall
    sets = (f"loop.rate_hz={rate_hz}", f"servo.schedule={schedule}", *alone)
    phases = range(0, 32) if thorough else (1, 12, 23) if wholly else (12,)
    for phase in phases:
        found = run_in_memory(
            sets, 0.5, adapter=(TIMER_MS * MS, 62), shift_ns=phase * MS // 2 + 37_000
        )
        result = found.result
        assert result.stop_reason == "duration"
        assert result.torque_off
        assert (
            not_none(result.bus)["lost"],
            not_none(result.bus)["late"],
            not_none(result.bus)["corrupt"],
        ) == (
            0,
            0,
            0,
        )
        on = found.ticks[found.ticks["stiffness"] > 0]
        # The sample in use is one timer old when it comes and two when the next one does.
        assert np.max(on["age_ns"]) <= (2 * TIMER_MS + 2000 / rate_hz) * MS
        commanded = not_none(result.guard)["commanded"]["stiffness"]
        assert 0 < commanded < 0.2 * not_none(result.guard)["requested"]["stiffness"]
        assert np.ptp(on["stiffness"]) == 0, "lowered from the first tick on"
        (why,) = (
            reason for reason in not_none(result.guard)["reasons"] if "sample's age" in reason
        )
        assert "% of the total delay" in why
        assert "set its latency timer to 1 ms" in why
        assert "K could be about" in why


@pytest.mark.whole
def test_what_the_guard_allows_comes_to_rest_and_twice_its_limit_does_not() -> None:
    """So the delay that is counted with is the true one, neither short nor far too long."""
    sets = (*FREE_WALL, "wall.stiffness=8")
    calm = run_in_memory(sets, 6.0, adapter=(TIMER_MS * MS, 62), shift_ns=5 * MS)
    assert calm.result.stop_reason == "duration"
    swung = swings(calm)
    assert swung[0] <= 0.31
    assert swung == sorted(swung, reverse=True)
    assert swung[-1] < 0.3 * swung[0]
    twice = 2 * not_none(calm.result.guard)["limit"]["exact"]
    wild = run_in_memory(
        (*FREE_WALL, "guard.mode=off", f"wall.stiffness={twice}"),
        6.0,
        adapter=(TIMER_MS * MS, 62),
        shift_ns=5 * MS,
    )
    assert max(swings(wild)) > 2 * 0.3, "until its early alarm"


@pytest.mark.whole
def test_a_quarter_of_the_replies_lost_is_a_quarter_for_the_trip() -> None:
    """Ticks in which none was due are neither good nor lost."""
    sets = ("safety.max_loss=0.15", "loop.warm_up_s=0.3")
    found = run_in_memory(
        sets, 10.0, adapter=(TIMER_MS * MS, 62), faults=["drop:every=4,way=reply"]
    )
    assert found.result.stop_reason == "trip:loss_rate"
    calm = run_in_memory(
        ("safety.max_loss=0.5", "loop.warm_up_s=0.3"),
        2.0,
        adapter=(TIMER_MS * MS, 62),
        faults=["drop:every=4,way=reply"],
    )
    assert calm.result.stop_reason == "duration"
    assert not_none(calm.result.bus)["lost"] >= 20
    lost = np.count_nonzero(calm.ticks["outcome"] == Outcome.LOST)
    assert lost == pytest.approx(not_none(calm.result.bus)["lost"], abs=2), "one loss each"


@pytest.mark.whole
def test_replies_that_stay_away_end_the_run_at_the_third() -> None:
    """Each takes longer than the silence that is allowed, and one or two are no reason to end."""
    sets = ("safety.max_silence_s=0.015", "safety.max_loss=1", "loop.warm_up_s=0.3")
    adapter = (TIMER_MS * MS, 62)
    found = run_in_memory(sets, 1.5, adapter=adapter, faults=["drop:way=reply,at=0.9"])
    assert found.result.stop_reason == "trip:losses_in_row"
    assert not_none(found.result.bus)["lost"] == 3
    calm = run_in_memory(sets, 1.5, adapter=adapter, faults=["drop:way=reply,at=0.9,times=2"])
    assert calm.result.stop_reason == "duration"


def test_a_quick_adapter_is_untouched() -> None:
    found = run_in_memory((), 0.3, adapter=(1 * MS, 62))
    outcome: IntArray = found.ticks["outcome"]
    age: IntArray = found.ticks["age_ns"]
    assert Outcome.WAITING not in outcome
    assert np.percentile(age, 99) <= 2 * MS
    assert not any("latency timer" in reason for reason in not_none(found.result.guard)["reasons"])
