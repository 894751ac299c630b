"""Describes the machine and the versions, and the processor time that the host took."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall import __version__
from haptic_wall.controller.bench import cyclictest

_PACKAGES = ("scipy", "control", "dynamixel-sdk", "loop-rate-limiters", "numba", "rustypot")
_STAT = Path("/proc/stat")
_STEAL = 7
"""Index of the steal time among a processor's times"""


def machine() -> dict[str, str | int | None]:
    """Return processor, available cores, system and kernel."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None,
        "system": f"{platform.system()} {platform.release()}",
        "kernel": platform.version(),
    }


def versions() -> dict[str, str | None]:
    """Return the versions of this program, Python, NumPy, SciPy and the peers; None: missing."""
    path = cyclictest.installed()
    return {
        "haptic-wall": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        **{package: _installed(package) for package in _PACKAGES},
        "cyclictest": None if path is None else cyclictest.version(path) or "of unknown version",
    }


class ProcessorTime(NamedTuple):
    """Time of all processors together since the start of the machine [ticks of the kernel]."""

    total: int
    stolen: int
    """Time that the host gave to other virtual machines while this one was ready to run"""


def processor_time(stat: Path = _STAT) -> ProcessorTime | None:
    """Return the processor time counted by the kernel so far; None: it is not reported."""
    try:
        words = stat.read_text(encoding="ascii").partition("\n")[0].split()
    except OSError:
        return None
    # The user time already includes the guest time, which follows.
    times = [int(word) for word in words[1 : _STEAL + 2]]
    return ProcessorTime(sum(times), times[_STEAL]) if len(times) > _STEAL else None


def stolen_percent(before: ProcessorTime | None, after: ProcessorTime | None) -> float | None:
    """Return the time the host took between two readings, in percent of all processors' time."""
    if before is None or after is None or after.total <= before.total:
        return None
    return 100.0 * (after.stolen - before.stolen) / (after.total - before.total)


def load_average() -> list[float] | None:
    """Return the number of processes that ran or waited, over the last 1, 5 and 15 minutes."""
    try:
        return [round(load, 2) for load in os.getloadavg()]
    except OSError:
        return None


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())
