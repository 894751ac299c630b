"""Regenerates docs/measured.md: what this program does on the machine it runs on.

    scripts/measure [--seconds S] [--rounds N] [--out FILE]

Everything over the emulated bus is judged by the witness (the emulator's own record) or side by
side with the bare loop (controller/bench/bare_loop.py) on the same emulator, in alternating
rounds.
"""

import signal
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

from haptic_wall.controller.bench import loops
from haptic_wall.controller.pytest_plugin.record import read_rows
from haptic_wall.hw.dynamixel.codec import Instruction
from scripts.whole_program import PROGRAM, measured_on, page_options, say_time, wall_run
from scripts.witnessed import witnessed

START_S, SIMULATED_S, STOPPED_S = 4, 3, 8
"""Duration of a run beside its length, of one on the simulated clock, of one that is stopped [s]"""


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


def beside_bare_loop(rounds: int, seconds: float) -> list[str]:
    """The whole controller beside the bare loop, on the same emulator in alternating rounds.

    The servo simulated in the loop's process has no bus: nothing is lost, nothing waited for.
    """
    bare, ours, inside = [], [], []
    with loops.emulated_bus("--set", "servo.coulomb=0") as path:
        for _ in range(rounds):
            bare.append(loops.bare(path, seconds, 1000.0))
            ours.append(loops.ours(path, seconds, 1000.0))
            inside.append(loops.of_run(loops.wall_run("simulated", seconds)))
    figures = {
        "ticks": lambda ran: ran.ticks,
        "missed_ticks": lambda ran: ran.missed,
        "lost": lambda ran: ran.lost,
        "late": lambda ran: ran.late,
    }
    rows = [
        "| medians of rounds | bare loop on the bus | haptic-wall on the bus |"
        " haptic-wall, servo in its process |",
        "|---|---|---|---|",
    ]
    for name, figure in figures.items():
        middles = [statistics.median(map(figure, runs)) for runs in (bare, ours, inside)]
        rows.append(f"| {name} | " + " | ".join(f"{each:g}" for each in middles) + " |")
    for name in ("lateness", "bus", "work"):
        for percentile in ("p50", "p99"):
            middles = [
                statistics.median(ran.times_us[name][percentile] for ran in runs)
                for runs in (bare, ours, inside)
            ]
            cells = " | ".join(f"{each:.1f}" for each in middles)
            rows.append(f"| {name}_us {percentile} | {cells} |")
    return rows


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
        after = [row for row in read_rows(record) if row.event == "rx" and row.time_s > asked]
        goals = [row for row in after if row.instruction == Instruction.SYNC_WRITE]
        none = next(row for row in goals if row.params.endswith(bytes(2)))
        last = next(row for row in after if row.instruction == Instruction.WRITE)
        zero.append((none.time_s - asked) * 1e3)
        off.append((last.time_s - asked) * 1e3)
    for name, values in (("goal current 0", zero), ("Torque Enable 0", off)):
        rows.append(f"| {name} | {statistics.median(values):.2f} | {max(values):.2f} |")
    return rows


def main() -> None:
    """Measure everything and write the page."""
    parser = page_options("measure", __doc__, "measured.md")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each run")
    parser.add_argument("--rounds", type=int, default=3, help="alternating rounds")
    wanted = parser.parse_args()
    runs = 5 * wanted.rounds + 1  # three beside the bare loop, two witnessed
    say_time(runs * (wanted.seconds + START_S) + 2 * wanted.rounds * (SIMULATED_S + STOPPED_S))
    page = [
        "# Measured",
        "",
        "Written by `scripts/measure`; run it to see the figures of your machine.",
        f"{measured_on()} Runs of {wanted.seconds:g} s, {wanted.rounds} rounds.",
        "No wire and no USB adapter is in these figures: the bus is a pseudo-terminal.",
        "",
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, lines in (
            ("Simulated clock", simulated_speed(folder, wanted.rounds)),
            ("Beside a bare loop", beside_bare_loop(wanted.rounds, wanted.seconds)),
            ("By the witness", by_the_witness(folder, wanted.rounds, wanted.seconds)),
            ("Stopping", stopping(folder, wanted.rounds)),
        ):
            page += [f"## {title}", "", *lines, ""]
            print("\n".join(page[-len(lines) - 3 :]), flush=True)
    wanted.out.write_text("\n".join(page))


if __name__ == "__main__":
    main()
