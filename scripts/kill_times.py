"""Measures how soon the torque ends when a run is killed, and writes docs/kill-times.md.

    scripts/kill_times [--rounds N] [--out FILE]

The whole tree of processes on an emulated bus of its own, a hand leaning on the wall, the Bus
Watchdog at 40 ms as for hardware. From the signal to zero torque by the witness: the true torque
that acts, recorded every millisecond. What killed it, and who ended the torque, is in the table.
"""

import argparse
import contextlib
import csv
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from controller.telemetry import ROW

HERE = Path(__file__).resolve().parent
PROGRAM = [sys.executable, "-m", "controller.cli.main"]
LIMIT_MS = 60.0
SETTINGS = (
    "servo.watchdog_s=0.04",
    "safety.heartbeat_s=0.1",
    "safety.max_loss=1",
    "safety.max_losses_in_row=900",
    "realtime.profile=best-effort",
    "wall.position=3.14159",
    "wall.stiffness=8",
    "wall.damping=0.02",
    "model.delay=0",
)
"""Patient with the machine's stalls, but for what is measured"""
TRUTH = ("servo.position=2.9", "servo.hand=lean", "servo.hand_origin=3.14159")
KILLS = {
    "SIGKILL of the loop": (("loop_process", signal.SIGKILL),),
    "SIGKILL of the supervisor": (("supervisor", signal.SIGKILL),),
    "SIGKILL of both": (  # stopped first: neither may act on the other's death
        ("supervisor", signal.SIGSTOP),
        ("loop_process", signal.SIGKILL),
        ("supervisor", signal.SIGKILL),
    ),
    "SIGSTOP of the loop": (("loop_process", signal.SIGSTOP),),
}
ATTEMPTS = 5
"""A run that a stall of the machine has ended before the signal came is begun again"""


def with_sets(settings: tuple[str, ...]) -> list[str]:
    """As options."""
    return [word for setting in settings for word in ("--set", setting)]


def loop_of(pid: int) -> int | None:
    """The loop's process among the children of a run."""
    with contextlib.suppress(OSError):
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            with contextlib.suppress(OSError):
                if "controller.loop_process" in Path(f"/proc/{child}/cmdline").read_text():
                    return int(child)
    return None


def one_kill(kills: tuple[tuple[str, signal.Signals], ...], folder: Path) -> tuple | None:
    """One run, ended so; None: it ended by itself before.

    Returns:
        From the signal to zero torque [ms]; the instruction that came last before it.
    """
    record, log = folder / "witness.csv", folder / "run.hwlog"
    log.unlink(missing_ok=True)
    emulator = subprocess.Popen(
        [*PROGRAM, "emulate", "--record", record, *with_sets(TRUTH)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
    )
    port = emulator.stdout.readline().strip()
    run = subprocess.Popen(
        [
            *[*PROGRAM, "run", "xm430-w350", "--log", log, "--plot", folder / "run.png"],
            *with_sets((*SETTINGS, f"servo.port={port}")),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    asked = None
    try:
        enough = 2500 * ROW.itemsize  # the warm-up is over and the hand leans on the wall
        while run.poll() is None and not (log.exists() and log.stat().st_size > enough):
            time.sleep(0.02)
        time.sleep(random.random() * 0.05)
        pids = {"supervisor": run.pid, "loop_process": loop_of(run.pid)}
        if run.poll() is None and all(pids.values()):
            asked = time.monotonic()
            for name, number in kills:
                os.kill(pids[name], number)
            time.sleep(1.0)
    finally:
        if run.poll() is None:
            run.send_signal(signal.SIGINT)
        run.wait()
        emulator.terminate()
        emulator.wait()
    return None if asked is None else until_no_torque(record, asked)


def until_no_torque(record: Path, asked: float) -> tuple[float, str] | None:
    """From an instant [s] to the last torque [ms], and what ended it; None: there was none."""
    with record.open() as file:
        rows = [
            (float(row["time_s"]), float(row["torque_nm"]), row) for row in csv.DictReader(file)
        ]
    before = [torque for at, torque, _ in rows if at <= asked]
    if not before or abs(before[-1]) < 0.1:
        return None
    end = (
        next(i for i in range(len(rows) - 1, -1, -1) if rows[i][0] <= asked or rows[i][1] != 0.0)
        + 1
    )
    if end == len(rows):
        return float("inf"), "nothing"
    at, _, row = rows[end]
    if row["event"] == "rx" and row["instruction"] == str(0x83):
        by = "goal current 0"
    elif row["event"] == "rx" and row["instruction"] == "3":
        by = "Torque Enable 0"
    else:
        by = "Bus Watchdog"
    return (at - asked) * 1e3, by


def measure(rounds: int) -> tuple[list[str], bool]:
    """The table, and whether every time is within the limit."""
    rows = [
        "| what was killed | rounds | median, ms | longest, ms | what ended the torque |",
        "|---|---|---|---|---|",
    ]
    held = True
    for name, kills in KILLS.items():
        found = []
        with tempfile.TemporaryDirectory() as folder:
            for _ in range(rounds):
                attempts = (one_kill(kills, Path(folder)) for _ in range(ATTEMPTS))
                result = next((each for each in attempts if each is not None), None)
                if result is None:
                    sys.exit(f"{name}: {ATTEMPTS} runs ended before they were killed")
                found.append(result)
                print(f"{name}: {result[0]:.1f} ms, {result[1]}", file=sys.stderr, flush=True)
        times = [time_ms for time_ms, _ in found]
        by = ", ".join(sorted({by for _, by in found}))
        rows.append(
            f"| {name} | {rounds} | {statistics.median(times):.1f} | {max(times):.1f} | {by} |"
        )
        held = held and max(times) <= LIMIT_MS
    return rows, held


def main() -> None:
    """Measure, write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "kill-times.md")
    wanted = parser.parse_args()
    rows, held = measure(wanted.rounds)
    page = [
        "# From the kill to no torque",
        "",
        "Written by `scripts/kill_times`; run it to see the figures of your machine. A hand leans"
        " on the wall, the loop runs at 1 kHz with the Bus Watchdog at 40 ms, and a process is"
        " killed or stopped. The time is from the signal to zero torque, the true one by the"
        " [emulated bus's record](emulated-bus.md), to a millisecond.",
        "",
        *rows,
        "",
        f"Wanted: at most {LIMIT_MS:g} ms each. "
        + ("It holds." if held else "It does not hold on this machine."),
        "",
    ]
    wanted.out.write_text("\n".join(page))
    print("\n".join(page))
    sys.exit(not held)


if __name__ == "__main__":
    main()
