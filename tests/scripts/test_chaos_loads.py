"""What runs beside a run: since when a core is held, and which others run at real-time priority."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any, cast

import pytest

from scripts.chaos import faults
from scripts.chaos.loads import others, ran_at_real_time
from scripts.chaos.stage import Stage


@pytest.mark.parametrize(
    ("says", "from_s", "seconds"),
    [("12.5", 12.5, pytest.approx(0.2, abs=0.1)), ("", None, 0.0)],
)
def test_a_core_is_held_from_when_who_holds_it_says_so(
    monkeypatch: pytest.MonkeyPatch,
    says: str,
    from_s: float | None,
    seconds: object,
) -> None:
    """One that is refused the priority says nothing, and holds nothing."""

    def load(*arguments: str, output: int) -> subprocess.Popen[bytes]:
        assert arguments[:2] == ("hog", "1")
        return subprocess.Popen([sys.executable, "-c", f"print(end={says!r})"], stdout=output)

    monkeypatch.setattr(faults, "load", load)
    lasting = faults.hog(0.1, 0.3)(cast(Stage, SimpleNamespace(core=1, random=Random(1))))
    lasting.undo()
    assert (lasting.from_s, lasting.seconds) == (from_s, seconds)


OURS, FIFO = 10, 1


@dataclass
class Proc:
    """A /proc of made-up processes."""

    folder: Path

    def __call__(
        self,
        pid: int,
        *,
        parent: int = 1,
        ticks: tuple[int, int] = (0, 0),
        start: int = 500,
        memory: int = 4096,
        policy: int = FIFO,
    ) -> None:
        words = ["S", *["0"] * 49]
        words[1], words[19], words[20], words[38] = map(str, (parent, start, memory, policy))
        words[11:13] = map(str, ticks)
        (self.folder / str(pid)).mkdir(exist_ok=True)
        (self.folder / str(pid) / "stat").write_text(f"{pid} (a name) with) {' '.join(words)}")


@pytest.fixture
def proc(tmp_path: Path) -> Proc:
    put = Proc(tmp_path)
    put(OURS, policy=0)
    put(OURS + 1, parent=OURS, ticks=(500, 500))
    (tmp_path / "meminfo").touch()
    return put


def test_a_real_time_program_of_others_counts_only_while_it_runs(proc: Proc) -> None:
    proc(20, ticks=(100, 7))
    before = others(OURS, proc.folder)
    assert not ran_at_real_time(before, others(OURS, proc.folder))
    proc(20, ticks=(100, 8))
    assert ran_at_real_time(before, others(OURS, proc.folder))
    proc(20, ticks=(101, 7))
    assert ran_at_real_time(before, others(OURS, proc.folder))


@pytest.mark.parametrize(
    "harmless",
    [
        {"policy": 0},  # an ordinary one
        {"memory": 0},  # the kernel's
        {"parent": OURS + 1},  # ours
    ],
)
def test_what_is_no_real_time_program_of_others_may_run(
    proc: Proc, harmless: dict[str, Any]
) -> None:
    proc(20, **harmless)
    before = others(OURS, proc.folder)
    proc(20, ticks=(9, 9), **harmless)
    assert not ran_at_real_time(before, others(OURS, proc.folder))


def test_a_real_time_program_that_took_over_a_pid_has_run_since_its_own_start(proc: Proc) -> None:
    proc(20, ticks=(1000, 0), start=500)
    before = others(OURS, proc.folder)
    proc(20, ticks=(1, 0), start=900)
    assert ran_at_real_time(before, others(OURS, proc.folder))
