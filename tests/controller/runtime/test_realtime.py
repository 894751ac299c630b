"""Real time: the loop's core, what the kernel refuses, and what of the machine could be better."""

import os

import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.runtime.machine_setup import start_text
from haptic_wall.controller.runtime.realtime import pick_cores
from haptic_wall.hw.servo import Check

CORE = Check("core", True, "core 1", "core 1")
FIFO = Check("scheduler", True, "SCHED_FIFO 80, reset on fork", "SCHED_FIFO 80")
REFUSED = Check("memory", False, "refused: no rights", "all memory locked", "sudo prlimit")
SHARED = Check("core isolation", True, "core 1 is shared", "a core of its own", "isolcpus=1")
WELL = Check("kernel", True, "PREEMPT_RT", "PREEMPT_RT")


@pytest.mark.parametrize(
    ("allowed", "wanted", "core", "others"),
    [
        ({0, 1, 2}, None, 2, {0, 1}),
        ({0, 1, 2}, 0, 0, {1, 2}),
        ({3, 5}, 5, 5, {3}),
        ({4}, None, 4, {4}),
    ],
)
def test_everything_else_stays_off_the_loops_core(
    allowed: set[int],
    wanted: int | None,
    core: int,
    others: set[int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(allowed))
    assert pick_cores(wanted) == (core, others)


def test_a_core_that_may_not_be_used_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    with pytest.raises(UserError, match=r"realtime\.core: found 99, wanted one of .*: 0, 1"):
        pick_cores(99)


def test_all_granted_is_one_line() -> None:
    assert start_text([CORE, FIFO], [WELL]) == (
        "real time: 2 of 2 granted (core 1, SCHED_FIFO 80, reset on fork)"
    )


def test_a_refusal_is_told_with_its_remedy() -> None:
    assert start_text([CORE, REFUSED], [WELL, SHARED]).splitlines() == [
        "real time: 1 of 2 granted",
        "  memory: wanted all memory locked, refused: no rights; to grant it: sudo prlimit",
        "  could be better: core 1 is shared",
    ]
