"""Measures what a log costs, and writes docs/log-figures.md: memory over hours, waits for the disk.

    scripts/log_figures [--hours H] [--out FILE] [--folder DIR]

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

import numpy as np

from haptic_wall.controller.logs.file import LogWriter, append_end
from haptic_wall.controller.runtime.telemetry import (
    CAPACITY,
    FLAG_CONTACT,
    FLAG_WARM_UP,
    ROW,
    Telemetry,
    Word,
)
from haptic_wall.controller.settings.load import load_config
from scripts.whole_program import measured_on, page_options, say_time

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
"""A command that tells its memory at the end: what the system tells of a child that has ended
includes its parent's."""
DISK_S = 20
RATES_HZ = (1000, 10_000)


@dataclass(frozen=True, slots=True)
class Read:
    """One way to read one log."""

    megabytes: float
    """The process's largest memory"""
    seconds: float


def write_log(path: Path, seconds: float) -> None:
    """A hand that goes in and out of a wall, as a recorder would have written it."""
    preset = "emulated-xm430"
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
    """Read a log one way; what it took."""
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


def memory_table(folder: Path, hours: float) -> list[str]:
    """Each way over both logs."""
    lines = [
        f"| read by | 10 min, MB | {hours:g} h, MB | more, MB | 10 min, s | {hours:g} h, s |",
        "|---|---|---|---|---|---|",
    ]
    logs = {SHORT_S: folder / "short.hwlog", 3600.0 * hours: folder / "long.hwlog"}
    for seconds, path in logs.items():
        write_log(path, seconds)
    for way, command in WAYS:
        short, long = (read(way, command, path) for path in logs.values())
        name = f"`{command} {way}`" if way.startswith("--") else f"`{way}`"
        name = "`log`" if way == "summary" else name
        lines.append(
            f"| {name} | {short.megabytes:.0f} | {long.megabytes:.0f} |"
            f" {long.megabytes - short.megabytes:+.1f} | {short.seconds:.1f} | {long.seconds:.0f} |"
        )
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


def backlog(folder: Path, rate_hz: int) -> int:
    """The most rows that waited for a recorder."""
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
        telemetry.write(*[0] * (len(ROW) - 1))
        time.sleep(0.01)
    began, written, most = time.monotonic(), 0, 0
    while time.monotonic() < began + DISK_S:
        while written < (time.monotonic() - began) * rate_hz:
            telemetry.write(*[written] * (len(ROW) - 1))
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


def main() -> None:
    """Measure and write the page."""
    parser = page_options("log_figures", __doc__ or "", "log-figures.md")
    parser.add_argument("--hours", type=float, default=4.0, help="length of the long log")
    parser.add_argument("--folder", type=Path, help="where logs are written (a disk to measure)")
    options = parser.parse_args()
    say_time(120 + 2 * DISK_S + 250 * options.hours)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        syncs = sync_times(folder)
        waited = {rate: backlog(folder, rate) for rate in RATES_HZ}
        table = memory_table(folder, options.hours)
    rows = "; ".join(
        f"at {rate} rows a second at most {count} of {CAPACITY} waited, {count / rate:.2f} s"
        for rate, count in waited.items()
    )
    lines = [
        "# What a log costs",
        "",
        "Written by `scripts/log_figures`; run it to see the figures of your machine, `--folder`"
        " for another disk. Largest memory of the whole process, the program itself and what it"
        f" loads included. {measured_on()}",
        "",
        *table,
        "",
        f"The disk: {np.median(syncs):.1f} ms (median) to {max(syncs):.0f} ms (longest) until it"
        " has three quarters of a second of rows for good, which the recorder waits for once a"
        f" second. Meanwhile rows wait in shared memory: {rows}.",
    ]
    options.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
