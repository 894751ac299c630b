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
    """Of this program, Python, NumPy and the peers; None: not installed."""
    return {
        "haptic-wall": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        **{peer: _installed(peer) for peer in ("control", "dynamixel-sdk", "rustypot")},
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
