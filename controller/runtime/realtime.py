"""Applies the loop's Linux process settings: wanted, granted, and how to have them granted."""

from __future__ import annotations

import ctypes
import gc
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from haptic_wall.controller.errors import UserError
from haptic_wall.hw.servo import Check

LOOP_PRIORITY = 80
"""Priority of the loop under SCHED_FIFO"""
Profile = Literal["off", "best-effort", "strict"]

_PR_SET_PDEATHSIG = 1
_PR_SET_TIMERSLACK = 29
_PR_GET_TIMERSLACK = 30
_MCL_CURRENT_AND_FUTURE = 3
_LIBC = ctypes.CDLL(None, use_errno=True)
_DMA_LATENCY = Path("/dev/cpu_dma_latency")


def die_with_parent(parent: int, signal_number: int) -> None:
    """Have the kernel send this process a signal when its parent ends.

    Args:
        parent: Process id of the expected parent: if it has already ended, the signal is sent at
            once.
        signal_number: The signal.
    """
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal_number, 0, 0, 0)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal_number)


def stand_back() -> None:
    """Take a low priority: the kernel threads that carry the loop's bytes need a core too.

    It is a tenth of the normal one, enough to write a log on a busy machine. The lowest would not
    be, and raising the priority again needs rights that few users have.
    """
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.nice(10)


def pick_cores(wanted: int | None = None) -> tuple[int, set[int]]:
    """Return the core for the loop, and the cores for everything else.

    By default the loop gets the last available core (the first one serves most interrupts); with a
    single core everything shares it.

    Args:
        wanted: The loop's core; None: chosen here.

    Raises:
        UserError: This process may not use that core.
    """
    allowed = os.sched_getaffinity(0)
    core = max(allowed) if wanted is None else wanted
    if core not in allowed:
        raise UserError(
            f"found {core}",
            field="realtime.core",
            wanted=f"one of the cores this process may use: {', '.join(map(str, sorted(allowed)))}",
        )
    return core, allowed - {core} or allowed


def _scheduler(priority: int) -> str:
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    return f"SCHED_FIFO {priority}, reset on fork"


def _memory() -> str:
    if _LIBC.mlockall(_MCL_CURRENT_AND_FUTURE) != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return "all memory locked"


def _core(cores: set[int]) -> str:
    os.sched_setaffinity(0, cores)
    return _names(cores)


def _timer_slack() -> str:
    _LIBC.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    return f"{_LIBC.prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0)} ns"


_held: list[int] = []


def _cpu_latency() -> str:
    descriptor = os.open(_DMA_LATENCY, os.O_WRONLY)
    os.write(descriptor, (0).to_bytes(4, "little"))
    _held.append(descriptor)  # the request lasts as long as the descriptor is open
    return "0 µs"


def _attempt(name: str, wanted: str, action: Callable[[], str], remedy: str) -> Check:
    try:
        return Check(name, True, action(), wanted)
    except OSError as error:
        return Check(name, False, f"refused: {error.strerror}", wanted, remedy)


def text_of(path: Path) -> str:
    """Return the content of a file of the kernel; empty: there is none."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def apply(profile: Profile, priority: int, cores: set[int]) -> list[Check]:
    """Apply the settings of a profile to this process, as far as they are granted.

    Args:
        profile: ``off`` applies only the core.
        priority: Priority of SCHED_FIFO, 1 to 99.
        cores: Cores for this process.

    Returns:
        Wanted against granted, one each. With ``strict`` the caller refuses to go on unless all
        required ones (scheduler, memory) are ok.
    """
    core = _attempt("core", _names(cores), lambda: _core(cores), "")
    if profile == "off":
        return [core]
    setup = "`sudo scripts/setup-testbed` and log in again, or"
    return [
        core,
        _attempt(
            "scheduler",
            f"SCHED_FIFO {priority}",
            lambda: _scheduler(priority),
            f"{setup} once: `sudo prlimit --rtprio=95 --pid $$`",
        ),
        _attempt(
            "memory",
            "all memory locked",
            _memory,
            f"{setup} once: `sudo prlimit --memlock=unlimited --pid $$`",
        ),
        _attempt("timer slack", "1 ns", _timer_slack, ""),
        _attempt(
            "cpu latency",
            "0 µs",
            _cpu_latency,
            f"{setup} until the next boot: `sudo chmod o+w /dev/cpu_dma_latency`",
        ),
    ]


def missing_for_strict(settings: Sequence[Check]) -> list[Check]:
    """Return the settings that a strict profile requires and did not get."""
    return [s for s in settings if s.name in ("scheduler", "memory") and not s.ok]


def freeze_garbage() -> None:
    """Collect garbage once, then disable collection: one takes milliseconds."""
    gc.collect()
    gc.freeze()
    gc.disable()


def _names(cores: set[int]) -> str:
    return "core " + ", ".join(map(str, sorted(cores)))
