"""Runs one loop, or one simulated wall, with the package that PYTHONPATH names: a child process.

    python -m scripts.loop_turn loop NAME PORT SECONDS RATE
    python -m scripts.loop_turn rows CASE
    python -m scripts.loop_turn about

It writes one JSON object on standard output.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from haptic_wall.controller.bench.loops import LOOPS, Ran
from haptic_wall.hw.errors import ServoError
from scripts.whole_program import ROOT

SOURCES = ROOT / ".src"


@dataclass(frozen=True, slots=True)
class Side:
    """An interpreter with a copy of the package."""

    python: str = sys.executable
    place: Path = SOURCES
    """Folder that holds the package"""
    packages: str = ""
    """Folder with the packages that this interpreter has not itself; empty: it has all"""

    @property
    def path(self) -> str:
        """Return its ``PYTHONPATH``."""
        return os.pathsep.join(filter(None, (str(self.place), str(ROOT), self.packages)))

    def tell(self, *words: str) -> dict[str, Any]:
        """Run this module there, and return what it tells.

        Raises:
            ServoError: It failed.
        """
        done = subprocess.run(
            [self.python, "-P", "-m", "scripts.loop_turn", *words],
            check=False,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": self.path},
        )
        if done.returncode:
            raise ServoError(f"{' '.join(words)} failed: {(done.stdout + done.stderr)[-500:]}")
        told: dict[str, Any] = json.loads(done.stdout)
        return told

    def loop(self, name: str, port: str, seconds: float, rate_hz: float) -> Ran:
        """Run a loop of ``LOOPS`` on the bus at a port.

        Raises:
            ServoError: It failed.
        """
        return Ran(**self.tell("loop", name, port, str(seconds), str(rate_hz)))


def about(modules: Sequence[str]) -> dict[str, Any]:
    """Return this interpreter's version and speed, and which of the modules are compiled."""
    return {
        "version": platform.python_version(),
        "plain_ms": 1e3 * min(_plain_s() for _ in range(7)),
        "compiled": [
            name
            for name in modules
            if not str(importlib.import_module(f"haptic_wall.{name}").__file__).endswith(".py")
        ],
    }


def _plain_s() -> float:
    """Return the processor time of a fixed piece of plain Python [s]."""
    began, value = time.process_time(), 0.5
    for k in range(100_000):
        value = 0.999 * value + (0.001 if value < k else 0.002)
    return time.process_time() - began


def main(words: Sequence[str]) -> None:
    """Do as the words say."""
    kind, *rest = words
    found: object
    if kind == "loop":
        name, port, seconds, rate_hz = rest
        found = asdict(LOOPS[name](port, float(seconds), float(rate_hz)))
    elif kind == "rows":
        from scripts.same_rows import line_of, ran
        from scripts.same_rows_cases import CASES

        found = {"line": str(line_of(rest[0], ran(CASES[rest[0]])))}
    else:
        found = about(rest)
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1:])
