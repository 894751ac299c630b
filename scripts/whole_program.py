"""The whole program as a user starts it, for studies that measure it."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = [sys.executable, "-m", "haptic_wall.controller.cli.main"]
CHILDREN = {
    "loop": "processes.loop_process",
    "recorder": "processes.recorder",
    "door": "live.door",
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


def children_of(pid: int) -> dict[str, int]:
    """The children of a run that are there, each by a name of ``CHILDREN``."""
    found: dict[str, int] = {}
    with contextlib.suppress(OSError):
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            with contextlib.suppress(OSError):
                words = Path(f"/proc/{child}/cmdline").read_text()
                found |= {name: int(child) for name, module in CHILDREN.items() if module in words}
    return found
