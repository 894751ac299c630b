"""What the figures were measured on, and with which versions."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from controller import __version__


def machine() -> dict[str, str | int | None]:
    """Processor, cores that may be used, and system."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None,
        "system": f"{platform.system()} {platform.release()}",
    }


def versions() -> dict[str, str | None]:
    """Of this program, Python, NumPy and python-control; None: not installed."""
    try:
        control = version("control")
    except PackageNotFoundError:
        control = None
    return {
        "haptic-wall": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "control": control,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())
