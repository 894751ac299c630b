"""Regenerates docs/measured.md: what this program does on the machine it runs on.

    scripts/measure [--seconds S] [--rounds N] [--out FILE]

Everything over the emulated bus is judged by the witness (the emulator's own record) or side by
side with the bare loop of scripts/bare_loop.py on the same emulator, in alternating rounds.
"""

import argparse
import csv
import json
import math
import os
import platform
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from controller.theory import critical_stiffness

HERE = Path(__file__).resolve().parent
PROGRAM = [sys.executable, "-m", "controller.cli.main"]
FORGIVING = [
    word
    for setting in (
        "realtime.profile=best-effort",
        "servo.watchdog_s=0.5",
        "safety.heartbeat_s=2",
        "safety.max_losses_in_row=400",
        "safety.max_loss=0.9",
    )
    for word in ("--set", setting)
]
"""What the machine's own stalls must not end; none of it changes what is measured."""
INERTIA, DAMPING, VIRTUAL_DAMPING, PERIOD = 0.011951, 0.011692, 0.02, 1e-3


def wall_run(folder: Path, *arguments: str) -> dict:
    """One ``haptic-wall run``, its report."""
    places = ["--log", str(folder / "run.hwlog"), "--plot", str(folder / "run.png"), "--json"]
    done = subprocess.run(
        [*PROGRAM, "run", *arguments, *places], check=False, capture_output=True, text=True
    )
    if done.returncode:
        sys.exit(f"a run ended with {done.returncode}: {done.stdout or done.stderr}")
    return json.loads(done.stdout)


def machine() -> str:
    """What this was measured on."""
    model = next(
        line.split(":")[1].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    )
    return (
        f"{os.cpu_count()} cores of {model}, Linux {platform.release()}, Python"
        f" {platform.python_version()}"
    )


def simulated_speed(folder: Path, rounds: int) -> list[str]:
    """How much faster than real time the simulated clock runs."""
    linear = ["--set", "servo.coulomb=0", "--set", "servo.hand=none", "--set", "servo.kick=-0.05"]
    lines = ["| run on the simulated clock, 60 s | times real time |", "|---|---|"]
    for name, settings in (("linear servo", linear), ("friction and hand", [])):
        factors = [
            wall_run(
                folder,
                "simulated",
                "--duration=60",
                "--set",
                "loop.clock=simulated",
                *settings,
            )["real_time_factor"]
            for _ in range(rounds)
        ]
        lines.append(f"| {name}, full controller and log | {statistics.median(factors):.0f} |")
    return lines


def middle(reports: list[dict], *path: str) -> float:
    """Median over rounds of one figure."""
    figures = []
    for report in reports:
        value = report
        for step in path:
            value = value[step]
        figures.append(value)
    return statistics.median(figures)


def beside_bare_loop(folder: Path, rounds: int, seconds: float) -> list[str]:
    """The whole controller beside the bare loop, on the same emulator in alternating rounds.

    The servo simulated in the loop's process has no bus: nothing is lost, nothing waited for.
    """
    bare, ours, inside = [], [], []
    emulator = subprocess.Popen(
        [*PROGRAM, "emulate", "--set", "servo.coulomb=0"], stdout=subprocess.PIPE, text=True
    )
    try:
        port = emulator.stdout.readline().strip()
        for _ in range(rounds):
            done = subprocess.run(
                [sys.executable, HERE / "bare_loop.py", port, str(seconds)],
                check=True,
                capture_output=True,
                text=True,
            )
            bare.append(json.loads(done.stdout))
            report = wall_run(
                folder,
                "xm430-w350",
                f"--duration={seconds}",
                "--set",
                f"servo.port={port}",
                "--set",
                "wall.side=both",
                "--set",
                f"wall.position={math.pi}",
                *FORGIVING,
            )
            report |= {name: report["bus"][name] for name in ("lost", "late")}
            ours.append(report)
            inside.append(wall_run(folder, "simulated", f"--duration={seconds}"))
    finally:
        emulator.terminate()
        emulator.wait()
    rows = [
        "| medians of rounds | bare loop on the bus | haptic-wall on the bus |"
        " haptic-wall, servo in its process |",
        "|---|---|---|---|",
    ]
    for name in ("ticks", "missed_ticks", "lost", "late"):
        rows.append(
            f"| {name} | {middle(bare, name):g} | {middle(ours, name):g} |"
            f" {middle(inside, name) if name in inside[0] else 0:g} |"
        )
    for name in ("lateness_us", "bus_us", "work_us"):
        for percentile in ("p50", "p99"):
            rows.append(
                f"| {name} {percentile} | {middle(bare, name, percentile):.1f} |"
                f" {middle(ours, name, percentile):.1f} |"
                f" {middle(inside, name, percentile):.1f} |"
            )
    return rows


def witnessed(folder: Path, seconds: float, factor: float | None, delay: float) -> dict:
    """One run judged by the witness: grid, true delay, growth of the true motion."""
    stiffness = 0.0
    if factor is not None:
        stiffness = factor * limit(delay)
    record = folder / "witness.csv"
    report = wall_run(
        folder,
        "emulated-xm430",
        f"--duration={seconds}",
        f"--witness={record}",
        *FORGIVING,
        *(
            word
            for setting in (
                "guard.mode=off",
                "wall.side=both",
                f"wall.stiffness={stiffness}",
                f"wall.damping={VIRTUAL_DAMPING if factor else 0.0}",
                "servo.kick=0.04",
                "servo.hand=none",
                "servo.coulomb=0",
                f"servo.inertia={INERTIA}",
                f"servo.damping={DAMPING}",
                "servo.torque_limit=6",
            )
            for word in ("--set", setting)
        ),
    )
    samples, torques, motion = read_witness(record)
    following = np.searchsorted(torques, samples)
    paired = following < torques.size
    true_delay = torques[following[paired]] - samples[paired]
    true_delay = true_delay[true_delay < 2 * PERIOD]
    half = true_delay[true_delay.size // 5 :]
    index = np.round((samples - samples[0]) / PERIOD)
    steady = slice(samples.size // 10, None)
    period = earliest_slope(index[steady], samples[steady])
    return {
        "reported_ms": report["delay_s"]["total"] * 1e3,
        "true_p50_ms": float(np.median(half)) * 1e3,
        "true_p90_ms": float(np.percentile(half, 90)) * 1e3,
        "ppm": (period / PERIOD - 1) * 1e6,
        "factor": stiffness / limit(report["delay_s"]["total"]),
        "growth": growth(*motion) if factor else 0.0,
    }


def earliest_slope(x: np.ndarray, y: np.ndarray, blocks: int = 40) -> float:
    """Slope of a line under points that come late at times, and by half a period seem early."""
    for _ in range(3):
        rest = y - np.polyval(np.polyfit(x, y, 1), x)
        keep = np.abs(rest - np.median(rest)) < 0.05 * PERIOD
        x, y, rest = x[keep], y[keep], rest[keep]
    first = [part[np.argmin(rest[part])] for part in np.array_split(np.arange(x.size), blocks)]
    return float(np.polyfit(x[first], y[first], 1)[0])


def limit(delay: float) -> float:
    """Exact critical stiffness of the emulated servo at a total delay [N·m/rad]."""
    return float(critical_stiffness(INERTIA, DAMPING, VIRTUAL_DAMPING, PERIOD, delay))


def read_witness(path: Path) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Instants of the cyclic reads and of the torques [s], and the true motion."""
    samples, torques, times, positions = [], [], [], []
    with path.open() as file:
        for row in csv.DictReader(file):
            if row["event"] == "state":
                times.append(float(row["time_s"]))
                positions.append(float(row["position_rad"]))
            elif row["event"] == "rx" and int(row["instruction"]) == 0x02:
                samples.append(float(row["time_s"]))
            elif row["event"] == "rx" and int(row["instruction"]) == 0x83:
                torques.append(float(row["time_s"]))
    samples, torques = np.array(samples), np.array(torques)
    # The cycles begin with the first torque that is followed by others every period.
    first = torques[np.argmax(np.diff(torques, append=np.inf) < 3 * PERIOD)]
    samples = samples[(samples > first) & (samples < torques[-1])]
    return samples, torques, (np.array(times), np.array(positions))


def growth(times: np.ndarray, positions: np.ndarray) -> float:
    """Growth rate of the oscillation [1/s]: the slope of the logarithm of its turning points."""
    moving = np.flatnonzero(np.abs(positions - positions[0]) > 0.02)
    times, positions = times[moving[0] : -50], positions[moving[0] : -50]
    offset = positions - math.pi if abs(np.mean(positions)) > 1 else positions
    turns = np.flatnonzero(np.diff(np.sign(np.diff(offset))) != 0) + 1
    heights = np.abs(offset[turns])
    keep = heights > 0.25 * np.median(heights)
    return float(np.polyfit(times[turns[keep]], np.log(heights[keep]), 1)[0])


def by_the_witness(folder: Path, rounds: int, seconds: float) -> list[str]:
    """Delay, grid and stability boundary, judged by the emulator's record."""
    delay = witnessed(folder, seconds, None, 0.0)["reported_ms"] * 1e-3
    rows = [
        "| K / limit | grid error, ppm | delay reported, ms | true p50, ms | true p90, ms |"
        " growth, 1/s |",
        "|---|---|---|---|---|---|",
    ]
    for factor in (0.9, 1.1):
        for _ in range(rounds):
            # K is chosen by the delay the run before reported; what it was of this run's limit
            # is in the row.
            found = witnessed(folder, seconds, factor, delay)
            delay = found["reported_ms"] * 1e-3
            rows.append(
                f"| {found['factor']:.3f} | {found['ppm']:+.2f} | {found['reported_ms']:.3f} |"
                f" {found['true_p50_ms']:.3f} | {found['true_p90_ms']:.3f} |"
                f" {found['growth']:+.3f} |"
            )
    return rows


def stopping(folder: Path, rounds: int) -> list[str]:
    """From Ctrl-C to the frame that ends the torque, as the witness saw it."""
    rows = ["| from Ctrl-C to | median, ms | longest, ms |", "|---|---|---|"]
    zero, off = [], []
    for number in range(2 * rounds):
        record = folder / f"stop{number}.csv"
        process = subprocess.Popen(
            [
                *PROGRAM,
                "run",
                "emulated-xm430",
                "--duration=60",
                f"--witness={record}",
                "--set",
                "servo.hand=lean",
                "--log",
                str(folder / "stop.hwlog"),
                "--plot",
                str(folder / "stop.png"),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        time.sleep(5.0 + 0.0137 * number)  # the hand leans by now; at any phase of the period
        asked = time.monotonic()
        process.send_signal(signal.SIGINT)
        process.wait()
        for name, found in (("0x83", zero), ("0x03", off)):
            with record.open() as file:
                found.append(
                    next(
                        float(row["time_s"]) - asked
                        for row in csv.DictReader(file)
                        if row["event"] == "rx"
                        and float(row["time_s"]) > asked
                        and int(row["instruction"]) == int(name, 16)
                        and (row["params"].endswith("0000") if name == "0x83" else True)
                    )
                    * 1e3
                )
    for name, values in (("goal current 0", zero), ("Torque Enable 0", off)):
        rows.append(f"| {name} | {statistics.median(values):.2f} | {max(values):.2f} |")
    return rows


def main() -> None:
    """Measure everything and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each run")
    parser.add_argument("--rounds", type=int, default=3, help="alternating rounds")
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "measured.md")
    wanted = parser.parse_args()
    page = [
        "# Measured",
        "",
        "Written by `scripts/measure`; run it to see the figures of your machine.",
        f"This page: {machine()}. No wire and no USB adapter is in these figures: the bus is a"
        " pseudo-terminal.",
        "",
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, lines in (
            ("Simulated clock", simulated_speed(folder, wanted.rounds)),
            ("Beside a bare loop", beside_bare_loop(folder, wanted.rounds, wanted.seconds)),
            ("By the witness", by_the_witness(folder, wanted.rounds, wanted.seconds)),
            ("Stopping", stopping(folder, wanted.rounds)),
        ):
            page += [f"## {title}", "", *lines, ""]
            print("\n".join(page[-len(lines) - 3 :]), flush=True)
    wanted.out.write_text("\n".join(page))


if __name__ == "__main__":
    main()
