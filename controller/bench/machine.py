"""Describes the machine and the versions."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from haptic_wall import __version__
from haptic_wall.controller.bench import cyclictest

_PACKAGES = ("scipy", "control", "dynamixel-sdk", "loop-rate-limiters", "numba", "rustypot")


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
