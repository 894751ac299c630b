"""The dead man that a page holds: silence, and answers that are late, let go."""

from __future__ import annotations

from haptic_wall.controller.live.dead_man import SILENCE_NS, DeadMan
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, Telemetry, Word
from tests.controller.runtime.test_cycle import Rig, on

MS = 1_000_000
PAGE, OTHER = "a page", "another page"


class Held:
    """A dead man, on times that a test tells [ms]."""

    def __init__(self) -> None:
        self.words = Telemetry.create().words
        self.words[Word.HELD_NS] = 0
        self.man = DeadMan(self.words)

    def answer(self, beat: int, now: int, page: str = PAGE) -> float:
        """Until when it is held [ms]."""
        self.man.answer(page, beat, now * MS)
        return self.words[Word.HELD_NS] / MS


def test_the_torque_is_out_150_ms_after_the_last_beat_that_was_answered() -> None:
    """On the simulated clock, in ticks of 1 ms."""
    rig = on(Rig([0.1] * 400, stiffness=10.0))
    rig.telemetry.words[Word.HELD_NS] = 0
    man = DeadMan(rig.telemetry.words)
    for _ in range(3):
        now_ns = rig.clock.now_ns()
        man.answer(PAGE, man.beat(now_ns), now_ns)
        rig.run(33)
    assert all(rig.bus.sent)
    rig.run(200)
    off = [bool(flags & FLAG_OFF) for flags in rig.rows["flags"]]
    assert 66 + 150 <= off.index(True) <= 66 + 152
    assert not any(rig.bus.sent[off.index(True) :])


def test_an_answer_that_was_under_way_for_long_holds_for_the_rest_of_its_time() -> None:
    held = Held()
    assert held.answer(1000, 1100) == 1150
    assert held.answer(1000, 1200) == 1150, "it renews nothing"
    held.man.release(PAGE)
    assert held.answer(1000, 1151) == 0
    assert held.answer(10**30, 2000) == 2000 + SILENCE_NS / MS, "no page knows the future"


def test_one_page_holds_it_and_only_that_one_lets_go() -> None:
    held = Held()
    held.answer(1000, 1000)
    assert held.answer(1100, 1100, OTHER) == 1150
    held.man.release(OTHER)
    assert held.words[Word.HELD_NS] == 1150 * MS
    assert held.answer(1151, 1151, OTHER) == 1301, "the first has been silent"
    held.man.release(PAGE)
    assert held.words[Word.HELD_NS] == 1301 * MS
    held.man.release(OTHER)
    assert held.words[Word.HELD_NS] == 0
