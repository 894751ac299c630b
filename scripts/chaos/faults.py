"""Faults that chaos injects into a run, and the stop reasons that each may cause."""

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO, Final

from haptic_wall.controller.runtime.safety import Trip
from scripts.chaos.loads import may_set_clock
from scripts.chaos.stage import Fault, Lasting, Stage

MEMORY_SHARE: Final = 0.2
"""Of the memory that is available, which a load may take"""
CLOCK_STEP_S: Final = 60.0
"""The furthest that the system's clock is set wrong, for a second"""


def has_recorder(stage: Stage) -> bool:
    """Whether a killed recorder has been replaced; only a supervisor can do that."""
    return stage.look().get("recorder") not in stage.killed


SILENT = frozenset({Trip.LOSSES_IN_ROW, Trip.LOSS_RATE, Trip.SERVO_LOST, Trip.TORQUE_LOST})
"""Stop reasons of a bus that is silent for long"""
STOPPED = frozenset({Trip.LOOP_HUNG, Trip.TORQUE_LOST})
"""Stop reasons of a loop that does not run"""
NO_REPORT: Final = "killed"
"""The stop reason of a run whose supervisor was killed: it reports none"""


def on_bus(*specs: str) -> Callable[[Stage], Lasting]:
    """A fault of the bus, one of several; ``{}`` becomes a length of up to three seconds."""

    def inject(stage: Stage) -> Lasting:
        spec = stage.random.choice(specs)
        seconds = round(stage.random.uniform(1.0, 3.0), 2) if "{}" in spec else 0.5
        spec = spec.format(seconds)
        with contextlib.suppress(BrokenPipeError):
            stage.bus.inject(spec)
        return Lasting(seconds, detail=spec)

    return inject


def kill(*names: str) -> Callable[[Stage], Lasting]:
    """SIGKILL; of several, all are stopped first, so that none acts on the other's death."""

    def inject(stage: Stage) -> Lasting:
        stage.look()
        struck_s = time.monotonic()
        if len(names) > 1:
            for name in names:
                stage.send(name, signal.SIGSTOP)
        for name in names:
            stage.send(name, signal.SIGKILL)
        return Lasting(0.0, from_s=struck_s)

    return inject


def stop(name: str, least_s: float, most_s: float) -> Callable[[Stage], Lasting]:
    """SIGSTOP, and SIGCONT after a while."""

    def inject(stage: Stage) -> Lasting:
        stage.look()
        seconds = stage.random.uniform(least_s, most_s)
        struck_s = time.monotonic()
        stage.send(name, signal.SIGSTOP)
        if seconds < 0.1:  # shorter than a turn of the loop that undoes faults
            time.sleep(seconds)
            stage.send(name, signal.SIGCONT)
            return Lasting(0.0, detail=f"{1e3 * seconds:.0f} ms")
        return Lasting(
            seconds,
            lambda: stage.send(name, signal.SIGCONT),
            f"{1e3 * seconds:.0f} ms",
            struck_s,
        )

    return inject


def load(*arguments: str, output: BinaryIO | int | None = None) -> subprocess.Popen[bytes]:
    """A process beside the run."""
    return subprocess.Popen(
        [sys.executable, "-m", "scripts.chaos.loads", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=output,
    )


def end(process: subprocess.Popen[bytes]) -> None:
    """End a process beside the run, and wait for it."""
    process.terminate()
    process.wait()


def busy(stage: Stage) -> Lasting:
    """Ordinary processes that never rest, two on each core."""
    loads = [load("busy", str(core)) for core in stage.cores for _ in range(2)]

    def undo() -> None:
        for each in loads:
            end(each)

    return Lasting(stage.random.uniform(3.0, 8.0), undo, f"{len(loads)} processes")


def hog(least_s: float, most_s: float) -> Callable[[Stage], Lasting]:
    """A process above the loop's priority on its core; injected when it says that it holds it."""

    def inject(stage: Stage) -> Lasting:
        seconds = stage.random.uniform(least_s, most_s)
        process = load("hog", str(stage.core), f"{seconds}", output=subprocess.PIPE)
        assert process.stdout is not None
        with process.stdout as told:  # a tenth of a second, in which a Python begins
            held_s = told.readline()
        detail = f"{1e3 * seconds:.0f} ms"
        if not held_s:  # it was refused, and strikes nothing
            return Lasting(0.0, lambda: end(process), f"{detail}, but it did not begin")
        return Lasting(seconds, lambda: end(process), detail, float(held_s))

    return inject


def hostile_clients(stage: Stage) -> Lasting:
    """Clients of the running wall that do it no good."""
    seconds = stage.random.uniform(2.0, 5.0)
    process = load("clients", str(stage.log), f"{seconds}")
    return Lasting(seconds, lambda: end(process), f"{seconds:.1f} s")


def memory(stage: Stage) -> Lasting:
    """A share of the memory that is available."""
    lines = Path("/proc/meminfo").read_text().splitlines()
    (available,) = (int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    megabytes = int(MEMORY_SHARE * available / 1024)
    seconds = stage.random.uniform(3.0, 6.0)
    process = load("memory", str(megabytes), f"{seconds}")
    return Lasting(seconds + 1.0, lambda: end(process), f"{megabytes} MB")


def flood(stage: Stage) -> Lasting:
    """Clients of the live page that send nonsense, large messages, or nothing, and do not read."""
    seconds = stage.random.uniform(1.0, 4.0)
    process = load("flood", str(stage.page_port), f"{seconds}")
    return Lasting(seconds + 0.5, lambda: end(process), f"{seconds:.1f} s")


def disk_full(stage: Stage) -> Lasting:
    """No room for the log: its file system is filled, or its writer may not make it longer."""
    seconds = stage.random.uniform(1.0, 4.0)
    if stage.room is not None:
        filler = stage.room / "filler"
        with filler.open("wb") as file, contextlib.suppress(OSError):
            room = os.statvfs(stage.room)
            os.posix_fallocate(file.fileno(), 0, room.f_bavail * room.f_frsize)
        return Lasting(seconds, lambda: filler.unlink(missing_ok=True), f"{seconds:.1f} s")
    pid = stage.look().get("recorder")
    if pid is None:
        return Lasting(0.0)
    before = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (stage.log.stat().st_size, before[1]))

    def undo() -> None:
        with contextlib.suppress(ProcessLookupError):
            resource.prlimit(pid, resource.RLIMIT_FSIZE, before)

    return Lasting(seconds, undo, f"{seconds:.1f} s")


def clock_step(stage: Stage) -> Lasting:
    """The system's clock set wrong for a second; a process of its own sets it right again."""
    step = stage.random.uniform(1.0, CLOCK_STEP_S) * stage.random.choice((-1.0, 1.0))
    process = load("clock", f"{step}", "1.0")
    return Lasting(1.5, lambda: end(process), f"{step:+.0f} s")


def may_take_priority() -> bool:
    """Whether real-time priorities are granted."""
    return os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_RTPRIO)[0] >= 85


RECORDER_KILLED: Final = "recorder killed"
CORE_HELD: Final = "loop's core held for 0.1 to 0.4 s"
GENTLE: Final = (
    Fault(
        "replies and requests damaged",
        on_bus(
            "drop:p=0.05,for={}",
            "corrupt:p=0.05,for={}",
            "corrupt:flips=64,p=0.05,for={}",
            "truncate:p=0.02,for={}",
            "duplicate:p=0.05,for={}",
            "late:ms=1.5,p=0.02,for={}",
            "wrong-id:p=0.03,for={}",
            "noise:p=0.05,for={}",
        ),
    ),
    Fault("both cores busy", busy),
    Fault("a fifth of the memory taken", memory),
    Fault("loop's core held for 5 to 20 ms", hog(0.005, 0.02), allowed=may_take_priority),
    Fault(RECORDER_KILLED, kill("recorder")),
    Fault("recorder stopped for 1 to 5 s", stop("recorder", 1.0, 5.0)),
    Fault("live page's server killed", kill("page")),
    Fault("live page's server stopped for 1 to 5 s", stop("page", 1.0, 5.0)),
    Fault("live page's server flooded for 1 to 4 s", flood),
    Fault("dial killed", kill("dial")),
    Fault("dial stopped for 1 to 5 s", stop("dial", 1.0, 5.0)),
    Fault("a thousand hostile clients for 2 to 5 s", hostile_clients),
    Fault("disk full for 1 to 4 s", disk_full),
    Fault("loop stopped for 3 to 15 ms", stop("loop", 0.003, 0.015)),
    Fault("supervisor stopped for 1 to 3 s", stop("supervisor", 1.0, 3.0)),
    Fault("emulator stopped for 3 to 15 ms", stop("emulator", 0.003, 0.015)),
    Fault("clock set wrong by up to a minute", clock_step, allowed=may_set_clock),
)
"""A run must live through these"""
HARD: Final = (
    Fault("loop killed", kill("loop"), frozenset({Trip.LOOP_DIED})),
    Fault("supervisor killed", kill("supervisor"), frozenset({NO_REPORT}), ready=has_recorder),
    Fault(
        "supervisor and loop killed",
        kill("supervisor", "loop"),
        frozenset({NO_REPORT}),
        ready=has_recorder,
    ),
    Fault("loop stopped for 0.1 to 1 s", stop("loop", 0.15, 1.0), STOPPED | SILENT),
    Fault(
        CORE_HELD,
        hog(0.1, 0.4),
        STOPPED | SILENT,
        allowed=may_take_priority,
    ),
    Fault("emulator stopped for 0.1 to 1 s", stop("emulator", 0.15, 1.0), SILENT),
    Fault("emulator killed", kill("emulator"), frozenset({Trip.SERVO_LOST})),
    Fault("bus silent", on_bus("drop:for={}", "drop:way=reply,for={}", "unplug:for={}"), SILENT),
    Fault("adapter unplugged", on_bus("unplug-adapter:for={}"), frozenset({Trip.SERVO_LOST})),
    Fault(
        "encoder jumps", on_bus("jump:counts=500", "jump:counts=-900"), frozenset({Trip.OVERSPEED})
    ),
    Fault(
        "servo in error",
        on_bus("hardware-error:bits=overload", "hardware-error:bits=voltage+encoder"),
        frozenset({Trip.HARDWARE_ERROR}),
    ),
    Fault(
        "supply or temperature out of limits",
        on_bus("supply:volts=5,for={}", "ambient:celsius=95,for={}"),
        frozenset({Trip.HARDWARE_ERROR, Trip.SERVO_HEALTH}),
    ),
    Fault("servo restarts", on_bus("brown-out"), SILENT),
)
"""Most runs end by these"""
FAULTS: Final = (*GENTLE, *HARD)
MAY_END: Final[Mapping[str, frozenset[str]]] = {fault.name: fault.may_end for fault in FAULTS}
HELD_UP: Final = ("emulator stopped for 0.1 to 1 s",)
"""Behind these the witness sees late what was sent in time"""
