"""What is told at the start: wanted against got, and what of the machine could be better."""

from pathlib import Path

import pytest

from haptic_wall.controller.runtime.machine_setup import machine_setup, start_text
from haptic_wall.hw.servo import Check

CORE = Check("core", True, "core 1", "core 1")
FIFO = Check("scheduler", True, "SCHED_FIFO 80, reset on fork", "SCHED_FIFO 80")
REFUSED = Check("memory", False, "refused: no rights", "all memory locked", "sudo prlimit")
SHARED = Check("core isolation", True, "core 1 is shared", "a core of its own", "isolcpus=1")
WELL = Check("kernel", True, "PREEMPT_RT", "PREEMPT_RT")


def put(root: Path, **files: str) -> None:
    for path, text in files.items():
        place = root / path.replace("__", "/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)


def by_name(root: Path, core: int = 1) -> dict[str, Check]:
    return {row.name: row for row in machine_setup(core, root)}


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


@pytest.mark.parametrize(
    ("runtime", "found", "well"),
    [("950000", "after 95 % of 1 s", True), ("-1", "never", True), ("100000", "10 %", False)],
)
def test_throttling_matters_where_it_leaves_little(
    tmp_path: Path, runtime: str, found: str, well: bool
) -> None:
    kernel = "proc__sys__kernel__sched_rt"
    put(tmp_path, **{f"{kernel}_runtime_us": runtime, f"{kernel}_period_us": "1000000"})
    row = by_name(tmp_path)["throttling"]
    assert found in row.found
    assert (row.fix == "") is well
