"""A run with all that a fault may strike, and kinds of faults."""

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from scripts.whole_program import Bus, children_of


@dataclass(slots=True)
class Stage:
    """A run with all that a fault may strike."""

    bus: Bus
    run: subprocess.Popen[bytes]
    log: Path
    room: Path | None
    """A small file system that the log lies on; None: none could be made"""
    core: int
    """The loop's"""
    cores: tuple[int, ...]
    random: Random
    page_port: int = 0
    """Port of the live page"""
    pids: dict[str, int] = field(default_factory=dict)
    """The last known: children of a dead supervisor cannot be found any more"""
    killed: set[int] = field(default_factory=set)
    """Processes that were sent SIGKILL; on a busy machine one may take seconds to die of it"""

    def look(self) -> dict[str, int]:
        """The processes of the run that are there, as far as they can be found."""
        self.pids |= {"supervisor": self.run.pid, "emulator": self.bus.process.pid}
        self.pids |= children_of(self.run.pid)
        return self.pids

    def send(self, name: str, number: signal.Signals) -> None:
        """Send a process of the run a signal; nothing where it is gone."""
        pid = self.pids.get(name)
        if pid is not None and Path(f"/proc/{pid}").exists():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, number)
            if number == signal.SIGKILL:
                self.killed.add(pid)


@dataclass(frozen=True, slots=True)
class Lasting:
    """An injected fault: how long it lasts [s], and how it is undone."""

    seconds: float
    undo: Callable[[], None] = lambda: None
    detail: str = ""
    from_s: float | None = None
    """When it struck [s]; None: when it was asked for"""


@dataclass(frozen=True, slots=True)
class Fault:
    """A kind of fault."""

    name: str
    inject: Callable[[Stage], Lasting]
    may_end: frozenset[str] = frozenset()
    """Stop reasons that it explains; none: a run must not end of it"""
    allowed: Callable[[], bool] = lambda: True
    ready: Callable[[Stage], bool] = lambda _stage: True
    """Whether it may be injected now; else it waits"""
