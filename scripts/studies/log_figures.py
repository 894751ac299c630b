"""Measures the cost of a log: memory over hours, waits for the disk.

    scripts/study log_figures [--hours H] [--folder DIR]

Memory: a log of ten minutes and one of hours are written (580 MB an hour), and every way to read
one runs in a process of its own, whose largest memory the system tells. Disk: a recorder as in a
run, with rows coming at 1 and 10 kHz; how many wait.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.logs.file import LogWriter, append_end
from haptic_wall.controller.runtime.telemetry import (
    CAPACITY,
    FLAG_CONTACT,
    FLAG_WARM_UP,
    ROW,
    Row,
    Telemetry,
    Word,
)
from haptic_wall.controller.settings.load import load_config
from scripts.study import Found, Given, Option, Part, Study, table

SHORT_S = 600
BLOCK = 250
"""Rows that a recorder gathers in a quarter of a second"""
WAYS = (
    ("summary", "log"),
    ("--csv", "log"),
    ("--mcap", "log"),
    ("--plot", "log"),
    ("--cut", "log"),
    ("detect --plot", "detect"),
)
TELLING = """
import sys
from pathlib import Path
from haptic_wall.controller.cli.main import main
status = main(sys.argv[1:])
sys.stderr.write(Path("/proc/self/status").read_text())
sys.exit(status)
"""
"""A command that prints its own memory at the end, because the system's figure for an ended child
includes its parent's memory"""
DISK_S = 20
RATES_HZ = (1000, 10_000)
_FIELDS = len(ROW.names or ()) - 1
"""Of a row, without its number"""


@dataclass(frozen=True, slots=True)
class Read:
    """One way to read one log."""

    megabytes: float
    """The process's largest memory"""
    seconds: float


def write_log(path: Path, seconds: float) -> None:
    """A hand that goes in and out of a wall, as a recorder would have written it."""
    preset = "emulated-ideal"
    metadata = {
        "program": "haptic-wall",
        "name": preset,
        "config": load_config(preset).config.model_dump(mode="json"),
    }
    rng = np.random.default_rng(1)
    count = round(1000 * seconds)
    step = np.pi / 2048
    with LogWriter(path, metadata, ROW) as log:
        for start in range(0, count, BLOCK):
            rows = np.zeros(min(BLOCK, count - start), ROW)
            seq = np.arange(start, start + len(rows))
            rows["seq"], rows["deadline_ns"] = seq, 10**9 + 10**6 * seq
            swing = 0.1 * np.sin(seq / 400.0 + 3.0 * np.sin(seq / 9000.0))
            rows["position"] = np.round(swing / step) * step
            rows["velocity"] = np.gradient(swing, 1e-3) if len(rows) > 1 else 0.0
            inside = rows["position"] > 0.0
            rows["flags"] = np.where(inside, FLAG_CONTACT, 0)
            rows["flags"][seq < 500] |= FLAG_WARM_UP
            rows["stiffness"], rows["damping"], rows["delay_s"] = 8.0, 0.02, 3e-4
            rows["torque"] = rows["wall_torque"] = np.where(inside, -8.0 * rows["position"], 0.0)
            rows["lateness_ns"] = rng.exponential(3000.0, len(rows))
            rows["work_ns"], rows["bus_ns"], rows["age_ns"] = 20_000, 90_000, 100_000
            rows["measured_torque"] = rows["torque"]
            log.append(rows)
    append_end(path, {"stop_reason": "duration", "message": "", "rows": count})


def read(way: str, command: str, log: Path) -> Read:
    """Read a log in one way; return time and memory."""
    words = [sys.executable, "-c", TELLING, command, str(log)]
    out = log.with_name("out.png")
    for word in way.split():
        if word.startswith("--"):
            words += [word, str(out)]
    if way == "--cut":
        words += ["--from", "10"]
    began = time.monotonic()
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(words[3:])} ended with {done.returncode}: {done.stderr}")
    taken = time.monotonic() - began
    kilobytes = re.findall(r"VmHWM:\s+(\d+) kB", done.stderr)[-1]
    out.unlink(missing_ok=True)
    return Read(int(kilobytes) * 1024 / 1e6, taken)


class Reading(NamedTuple):
    """One way to read a log of some length."""

    way: str
    command: str
    seconds: float
    folder: str


def readings(given: Given) -> list[Reading]:
    """Each way over a short log and a long one."""
    spans = (SHORT_S, 3600.0 * given.hours)
    return [Reading(*way, seconds, given.folder) for way in WAYS for seconds in spans]


def reading(case: Reading) -> Read:
    """Write a log, and read it."""
    with tempfile.TemporaryDirectory(dir=case.folder or None) as folder:
        log = Path(folder) / "a.hwlog"
        write_log(log, case.seconds)
        return read(case.way, case.command, log)


def memory(found: Found[Reading, Read]) -> list[str]:
    """A line for each way."""
    rows = []
    for (case, short), (later, long) in zip(found[::2], found[1::2], strict=True):
        hours = later.seconds / 3600.0
        words = case.command if case.way == "summary" else f"{case.command} {case.way}"
        name = f"`{words if case.way.startswith(('--', 'summary')) else case.way}`"
        more = f"{long.megabytes - short.megabytes:+.1f}"
        sizes = [f"{short.megabytes:.0f}", f"{long.megabytes:.0f}", more]
        rows.append([name, *sizes, f"{short.seconds:.1f}", f"{long.seconds:.0f}"])
    spans = ["10 min, MB", f"{hours:g} h, MB", "more, MB", "10 min, s", f"{hours:g} h, s"]
    return table(["read by", *spans], *rows)


def backlog(folder: Path, rate_hz: int) -> int:
    """The most rows that waited for a recorder at so many a second."""
    telemetry = Telemetry.create()
    orders = {
        "telemetry": telemetry.descriptor,
        "parent": os.getpid(),
        "log": str(folder / "disk.hwlog"),
        "metadata": {},
        "period_ns": round(1e9 / rate_hz),
        "resume": False,
    }
    recorder = subprocess.Popen(
        [sys.executable, "-m", "haptic_wall.controller.processes.recorder"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        pass_fds=[telemetry.descriptor],
    )
    assert recorder.stdin is not None
    recorder.stdin.write((json.dumps(orders) + "\n").encode())
    recorder.stdin.close()
    while not telemetry.words[Word.TAIL]:  # until it has begun
        telemetry.write(Row(*[0] * _FIELDS))
        time.sleep(0.01)
    began, written, most = time.monotonic(), 0, 0
    while time.monotonic() < began + DISK_S:
        while written < (time.monotonic() - began) * rate_hz:
            telemetry.write(Row(*[written] * _FIELDS))
            written += 1
        most = max(most, telemetry.words[Word.HEAD] - telemetry.words[Word.TAIL])
        time.sleep(0.005)
    telemetry.words[Word.FINISHED] = 1
    recorder.wait()
    return most


def sync_times(folder: Path) -> list[float]:
    """How long the disk takes to keep three quarters of a second of rows [ms]."""
    times = []
    with LogWriter(folder / "sync.hwlog", {}, ROW) as log:
        for _ in range(20):
            for _ in range(3):
                log.append(np.zeros(BLOCK, ROW))
            began = time.monotonic()
            log.sync()
            times.append(1e3 * (time.monotonic() - began))
            time.sleep(0.2)
    return times


class Disk(NamedTuple):
    """How long the disk takes, and what waits meanwhile."""

    syncs: list[float]
    """[ms]"""
    waited: dict[int, int]
    """Rows, by how many come a second"""


def disk(folder: str) -> Disk:
    """Measure the disk of a folder."""
    with tempfile.TemporaryDirectory(dir=folder or None) as name:
        return Disk(sync_times(Path(name)), {hz: backlog(Path(name), hz) for hz in RATES_HZ})


def waits(found: Found[str, Disk]) -> list[str]:
    """Waits of the disk, in words."""
    ((_, (syncs, waited)),) = found
    rows = "; ".join(
        f"at {rate} rows a second at most {count} of {CAPACITY} waited, {count / rate:.2f} s"
        for rate, count in waited.items()
    )
    return [
        f"The disk: {np.median(syncs):.1f} ms (median) to {max(syncs):.0f} ms (longest) until it"
        " has three quarters of a second of rows for good, which the recorder waits for once a"
        f" second. Meanwhile rows wait in shared memory: {rows}."
    ]


STUDY = Study(
    "evidence/log-figures.md",
    (
        Part("memory", readings, reading, memory, case_s=90.0, in_turn=True),
        Part(
            "disk",
            lambda given: [given.folder],
            disk,
            waits,
            case_s=2.0 * DISK_S + 20.0,
            in_turn=True,
        ),
    ),
    (
        Option("hours", 4.0, "length of the long log [h]"),
        Option(
            "folder",
            "",
            "folder for the logs, on the disk to measure (default: the temporary folder)",
        ),
    ),
)
