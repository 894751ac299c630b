"""Loads that chaos starts beside a run, each in a process of its own that dies with its parent.

busy CORE; hog CORE SECONDS; memory MB SECONDS; clock STEP SECONDS; watch CORE; strangers
"""

import contextlib
import ctypes
import ctypes.util
import mmap
import os
import signal
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from haptic_wall.controller.runtime import realtime

HOG_PRIORITY, WATCH_PRIORITY = 85, 99
"""Above the loop's; above everything"""
WATCH_S = 0.005
"""How often the machine is asked for a sign of life [s]"""
STRANGERS_S = 1.0
"""How often others' real-time programs are looked for [s]"""
RAN_MS = 10
"""Least processor time of another real-time program between two looks [ms]"""
_PARENT, _USER, _SYSTEM, _START, _VIRTUAL_SIZE, _POLICY = 1, 11, 12, 19, 20, 38
"""Places in /proc/PID/stat, counted from the state on"""
_REAL_TIME = (str(os.SCHED_FIFO), str(os.SCHED_RR))
LEAST_S = 0.005
"""Shorter stalls are not written down [s]"""


def busy(core: int) -> None:
    """An ordinary process that never rests, until it is ended."""
    os.sched_setaffinity(0, {core})
    while True:
        pass


def hog(core: int, seconds: float) -> None:
    """Hold a core at real-time priority, ahead of all below it; say since when [s]."""
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(HOG_PRIORITY))
    held_s = time.monotonic()
    print(f"{held_s:.6f}", flush=True)
    while time.monotonic() < held_s + seconds:
        pass


def memory(megabytes: int, seconds: float) -> None:
    """Touch every page of so much memory, keep it for a while, give it back."""
    Path("/proc/self/oom_score_adj").write_text("1000")  # rather this than anybody else
    end = time.monotonic() + seconds
    with mmap.mmap(-1, megabytes << 20) as pages:
        for at in range(0, len(pages), mmap.PAGESIZE):
            pages[at] = 1
        while time.monotonic() < end:
            time.sleep(0.05)


def clock(step_s: float, seconds: float) -> None:
    """Set the system's clock wrong for a while, then right again, whatever happens meanwhile.

    Right is what the monotonic clock says of the time that has passed.
    """
    stopped = False

    def stop(_number: int, _frame: object) -> None:
        nonlocal stopped
        stopped = True

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    realtime.die_with_parent(os.getppid(), signal.SIGTERM)
    offset = time.clock_gettime(time.CLOCK_REALTIME) - time.monotonic()
    end = time.monotonic() + seconds
    try:
        time.clock_settime(time.CLOCK_REALTIME, time.monotonic() + offset + step_s)
        while time.monotonic() < end and not stopped:
            time.sleep(0.02)
    finally:
        time.clock_settime(time.CLOCK_REALTIME, time.monotonic() + offset)


def watch(core: int) -> None:
    """Ask for a sign of life every few milliseconds; say when none came: from and until [s]."""
    os.sched_setaffinity(0, {core})
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(WATCH_PRIORITY))
    libc = ctypes.CDLL(ctypes.util.find_library("c"))
    libc.mlockall(3)
    last = time.monotonic()
    while True:
        time.sleep(WATCH_S)
        now = time.monotonic()
        if now - last >= WATCH_S + LEAST_S:
            print(f"{last:.6f} {now:.6f}", flush=True)
        last = now


def strangers(ours: int) -> None:
    """Look out for real-time programs of others that run; say when: from and until [s]."""
    os.nice(10)
    last, before = time.monotonic(), others(ours)
    while True:
        time.sleep(STRANGERS_S)
        now, seen = time.monotonic(), others(ours)
        if ran_at_real_time(before, seen):
            print(f"{last:.6f} {now:.6f}", flush=True)
        last, before = now, seen


@dataclass(frozen=True, slots=True)
class Other:
    """A program that no process of ours has started."""

    real_time: bool
    """It may run ahead of ordinary ones, which most of these hardly ever do"""
    ran_ms: int
    """Processor time since it began [ms]"""


def others(ours: int, proc: Path = Path("/proc")) -> dict[tuple[int, str], Other]:
    """The programs of others, each by its pid and its start: pids are given again."""
    parents, found = {}, {}
    for folder in proc.iterdir():
        with contextlib.suppress(OSError, ValueError):
            pid = int(folder.name)
            words = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[pid] = int(words[_PARENT])
            ticks = int(words[_USER]) + int(words[_SYSTEM])
            # Kernel threads have no memory of their own.
            real_time = words[_POLICY] in _REAL_TIME and words[_VIRTUAL_SIZE] != "0"
            ran_ms = 1000 * ticks // os.sysconf("SC_CLK_TCK")
            found[pid, words[_START]] = Other(real_time, ran_ms)
    return {key: other for key, other in found.items() if not _descends(key[0], ours, parents)}


def ran_at_real_time(
    before: Mapping[tuple[int, str], Other], now: Mapping[tuple[int, str], Other]
) -> bool:
    """Whether a real-time program of others has had the processor between two looks."""
    unborn = Other(real_time=False, ran_ms=0)
    return any(
        other.real_time and other.ran_ms - before.get(key, unborn).ran_ms >= RAN_MS
        for key, other in now.items()
    )


def _descends(pid: int, ancestor: int, parents: dict[int, int]) -> bool:
    while pid > 1:
        if pid == ancestor:
            return True
        pid = parents.get(pid, 0)
    return False


def own_mounts() -> bool:
    """Give this process mounts of its own, which end with it; whether that was granted."""
    libc = ctypes.CDLL(None, use_errno=True)
    clone_newns, ms_rec, ms_private = 0x20000, 0x4000, 0x40000
    if libc.unshare(clone_newns):
        return False
    return not libc.mount(b"none", b"/", None, ctypes.c_ulong(ms_rec | ms_private), None)


def may_set_clock() -> bool:
    """Whether this process has the right to set the system's clock."""
    cap_sys_time = 25
    status = Path("/proc/self/status").read_text()
    (effective,) = (line for line in status.splitlines() if line.startswith("CapEff"))
    return bool(int(effective.split()[1], 16) >> cap_sys_time & 1)


def main() -> None:
    """Do what the arguments say."""
    kind, *numbers = sys.argv[1:]
    if kind != "clock":
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started it ends it
        realtime.die_with_parent(os.getppid(), signal.SIGKILL)
    match kind:
        case "busy":
            busy(int(numbers[0]))
        case "hog":
            hog(int(numbers[0]), float(numbers[1]))
        case "memory":
            memory(int(numbers[0]), float(numbers[1]))
        case "clock":
            clock(float(numbers[0]), float(numbers[1]))
        case "watch":
            watch(int(numbers[0]))
        case "strangers":
            strangers(os.getppid())


if __name__ == "__main__":
    main()
