"""Runs ``cyclictest`` of rt-tests, where it is installed: the reference for wake-up lateness."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np

from haptic_wall.controller.errors import PlatformError
from haptic_wall.controller.theory.checks import IntArray

PRIORITY = 80
_RANGE_US = 20_000
"""It only counts the lateness values from here on [µs]"""
_PATIENCE_S = 20.0
_ALSO_IN = ("/usr/local/sbin", "/usr/sbin", "/sbin")
"""Folders that packages use and users' PATH often lacks"""
_BIN = re.compile(r"^(\d+)\s+(\d+)\s*$", re.MULTILINE)


def installed() -> str | None:
    """Return its path, or None."""
    for folder in (None, *_ALSO_IN):
        if (path := shutil.which("cyclictest", path=folder)) is not None:
            return path
    return None


def options(core: int, ticks: int) -> list[str]:
    """Return the options for one SCHED_FIFO thread on one core, woken every millisecond."""
    placed = ["-a", str(core), "-t", "1", "-p", str(PRIORITY), "-m"]
    return [*placed, "-i", "1000", "-d", "0", "-q", "-l", str(ticks), "-h", str(_RANGE_US)]


def lateness_us(path: str, core: int, ticks: int) -> IntArray:
    """Run it; return the lateness of each wake-up [µs, rounded down], rising.

    Raises:
        PlatformError: It failed, mostly for lack of real-time rights.
    """
    try:
        done = subprocess.run(
            [path, *options(core, ticks)],
            capture_output=True,
            text=True,
            check=False,
            timeout=_PATIENCE_S + 2e-3 * ticks,
            process_group=0,  # this process handles a Ctrl-C and kills the child
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PlatformError(f"cyclictest could not be run: {error}") from error
    if done.returncode:
        said = " ".join(line for line in done.stderr.split("\n") if line and "WARN" not in line)
        raise PlatformError(f"cyclictest ended with {done.returncode}: {said or 'no reason given'}")
    return parsed(done.stdout)


def parsed(text: str) -> IntArray:
    """Return the lateness values of its histogram [µs, rounded down], rising.

    Those beyond its range count as its end, which is their lower bound.

    Args:
        text: Output of ``cyclictest -q -h``.

    Raises:
        PlatformError: It is no such histogram, or not the whole of it.
    """
    total = _stated(text, "Total")
    beyond = _stated(text, "Histogram Overflows")
    bins = [(int(late), int(count)) for late, count in _BIN.findall(text)]
    late, counts = np.array(bins, dtype=np.int64).reshape(-1, 2).T
    if total is None or beyond is None or not bins or int(counts.sum()) != total:
        raise PlatformError(
            "cyclictest: found output that is not one thread's histogram with its totals; wanted"
            " that of rt-tests 1.0 or newer",
            advice="install another version, or take it from PATH",
        )
    return np.concatenate([np.repeat(late, counts), np.full(beyond, late[-1] + 1)])


def version(path: str) -> str | None:
    """Return the version that the tool reports."""
    try:
        said = subprocess.run(
            [path, "--help"], capture_output=True, text=True, check=False, timeout=_PATIENCE_S
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    found = re.search(r"cyclictest V (\S+)", said.stdout + said.stderr)
    return None if found is None else found[1]


def _stated(text: str, label: str) -> int | None:
    """Return the single thread's number on a line of the summary."""
    found = re.search(rf"^# {label}:\s*(\d+)\s*$", text, re.MULTILINE)
    return None if found is None else int(found[1])
