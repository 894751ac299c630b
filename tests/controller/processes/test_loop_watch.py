"""Who watches the loop ends one that hangs, and never a healthy one because he slept himself."""

import pytest

from haptic_wall.controller.processes.loop_watch import END_S, LoopWatch
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from tests.typed import not_none

LOOK_S = 0.02
HEARTBEAT_S = 0.1


class Loop:
    """A loop that beats until it is told not to, watched on a clock of its own."""

    def __init__(self, state: int) -> None:
        self.words = Telemetry.create().words
        self.words[Word.STATE] = state
        self.now = 100.0
        self.beats = True
        self.beat()
        self.watch = LoopWatch(self.words, HEARTBEAT_S, self.now)

    def beat(self) -> None:
        if self.beats:
            self.words[Word.HEARTBEAT_NS] = round(self.now * 1e9)

    def after(self, seconds: float, step: float = LOOK_S) -> str | None:
        """Look every ``step`` for so long; when it was found overdue, and of what."""
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += step
            self.beat()
            if overdue := self.watch.overdue(self.now):
                return overdue
        return None


def test_a_loop_that_waits_for_its_emulated_bus_is_alive_and_one_that_hangs_is_not() -> None:
    loop = Loop(LoopState.RUNNING)
    loop.beats = False
    for _ in range(100):  # it takes the time out of its clock, as long as it lives
        loop.words[Word.OFFSET_NS] += round(LOOK_S * 1e9)
        assert loop.after(LOOK_S) is None
    assert loop.after(1.0) is not None


def test_a_silent_loop_is_overdue_after_its_heartbeat() -> None:
    loop = Loop(LoopState.RUNNING)
    assert loop.after(10.0) is None
    loop.beats = False
    assert loop.after(HEARTBEAT_S) is None
    assert "no sign of life for 0.1" in not_none(loop.after(2 * LOOK_S))


def test_a_watcher_that_slept_gives_a_loop_that_slept_with_it_its_time() -> None:
    loop = Loop(LoopState.RUNNING)
    loop.now += 5.0  # both were stopped, and it looks before the loop could beat
    assert loop.watch.overdue(loop.now) is None
    assert loop.after(10.0) is None
    loop.beats = False
    loop.now += 5.0
    assert loop.after(HEARTBEAT_S) is None, "one that does not come back has no more than that"
    assert "no sign of life" in not_none(loop.after(2 * LOOK_S))


@pytest.mark.parametrize("ask", ["stop", "bus"])
def test_a_loop_that_beats_but_does_not_end_when_asked_is_overdue(ask: str) -> None:
    loop = Loop(LoopState.RUNNING)
    loop.after(1.0)
    if ask == "stop":
        loop.words[Word.STOP] = 1
    else:
        loop.watch.asked()
    assert loop.after(END_S) is None
    assert "did not end within 2 s of being asked" in not_none(loop.after(3 * LOOK_S))
