"""The whole program as a user starts it, for studies that measure it."""

import contextlib
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.dynamixel.tables import MODELS, Model

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = [sys.executable, "-m", "haptic_wall.controller.cli.main"]
CHILDREN = {
    "loop": "processes.loop_process",
    "recorder": "processes.recorder",
    "dial": "processes.dial",
    "page": "live.process",
}
"""Modules that the children of a run are, by name"""


@dataclass(frozen=True, slots=True)
class Bus:
    """An emulated bus in a process of its own."""

    process: subprocess.Popen[str]
    port: str

    def inject(self, *faults: str) -> None:
        """Change its faults."""
        assert self.process.stdin is not None
        self.process.stdin.write("\n".join([*faults, ""]))
        self.process.stdin.flush()


def with_sets(settings: tuple[str, ...]) -> list[str]:
    """Settings as options."""
    return [word for setting in settings for word in ("--set", setting)]


@contextlib.contextmanager
def emulated_bus(*options: str | Path) -> Iterator[Bus]:
    """An emulated bus, as long as it is needed; afterwards its record is whole."""
    process = subprocess.Popen(
        [*PROGRAM, "emulate", *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    try:
        yield Bus(process, process.stdout.readline().strip())
    finally:
        process.terminate()
        process.communicate()


def hardware_of(config: Config) -> tuple[Model, float]:
    """Model and torque limit [N·m] of a preset that names both."""
    assert config.servo.model is not None and config.servo.torque_limit is not None
    return MODELS[config.servo.model], config.servo.torque_limit


def children_of(pid: int) -> dict[str, int]:
    """The children of a run that are there, each by a name of ``CHILDREN``."""
    found: dict[str, int] = {}
    with contextlib.suppress(OSError):
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            with contextlib.suppress(OSError):
                words = Path(f"/proc/{child}/cmdline").read_text()
                found |= {name: int(child) for name, module in CHILDREN.items() if module in words}
    return found


def wall_run(folder: Path, *options: str, may_oscillate: bool = False) -> dict[str, Any]:
    """Return the report of one ``haptic-wall run``; its log and picture go to a folder.

    Args:
        folder: For its files.
        options: Options of the command.
        may_oscillate: The wall is unstable on purpose: ended by that trip it has shown enough.
    """
    done = _run(folder, *options, "--plot", folder / "run.png")
    report = json.loads(done.stdout) if done.stdout else {}
    oscillated = may_oscillate and report.get("stop_reason") == Trip.OSCILLATION
    if done.returncode and not oscillated:
        sys.exit(f"a run ended with {done.returncode}: {done.stdout or done.stderr}")
    return report


def run_report(folder: Path, *options: str | Path) -> dict[str, Any]:
    """Return the report of one ``haptic-wall run``, however it ended; its log goes to a folder.

    Args:
        folder: For its log; there is no picture.
        options: Options of the command.

    Raises:
        RuntimeError: The run did not start.
    """
    done = _run(folder, *options, "--no-plot")
    with contextlib.suppress(ValueError):
        report: dict[str, Any] = json.loads(done.stdout)
        if "stop_reason" in report:
            return report
    words = " ".join(map(str, options))
    raise RuntimeError(f"{words} did not run: {done.stdout}{done.stderr}")


def _run(folder: Path, *options: str | Path) -> subprocess.CompletedProcess[str]:
    words = [*PROGRAM, "run", *options, "--log", folder / "run.hwlog", "--json"]
    return subprocess.run(words, check=False, capture_output=True, text=True)


def missed_share(report: dict[str, Any]) -> float:
    """Fraction of a run's periods that had no tick [1]."""
    ticks, missed = report["ticks"], report["missed_ticks"]
    return missed / (ticks + missed) if ticks else 0.0


def middle_and_most(values: Sequence[float], form: str) -> str:
    """Upper median and largest of the values for a table, formatted with ``form``."""
    ordered = sorted(values)
    return f"{ordered[len(ordered) // 2]:{form}}, {ordered[-1]:{form}}"
