"""Soaks the driver in damaged replies, in memory and in real time, and writes docs/bus-soak.md.

    scripts/bus_soak [--cycles N] [--frames N] [--seconds S] [--seed N] [--out FILE]

In memory, on the simulated clock, every run with the same seed is the same. What was done to each
reply is known there, so each cycle's outcome is set against it; positions are set against the true
ones. The status is 1 where something that is promised did not hold.
"""

import argparse
import csv
import json
import math
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random

import numpy as np
from scipy.stats import binom

from controller.logfile import read_log
from hw.clock import SimulatedClock
from hw.dynamixel.codec import Parser, encode_status
from hw.dynamixel.emulated.bus import EmulatedBus
from hw.dynamixel.emulated.damage import Passage
from hw.dynamixel.emulated.injection import Faults
from hw.dynamixel.emulated.memory_line import MemoryLine
from hw.dynamixel.emulated.servo import EmulatedServo
from hw.dynamixel.servo import DynamixelServo
from hw.dynamixel.tables import MODELS, POSITION_UNIT
from hw.servo import Outcome
from hw.settings import DynamixelSettings, TrueServo

HERE = Path(__file__).resolve().parent
PROGRAM = [sys.executable, "-m", "controller.cli.main"]
DAMAGE = (
    "drop:p=0.01,way=reply",
    "corrupt:flips=1,p=0.01,way=reply",
    "corrupt:flips=4,p=0.005,way=reply",
    "corrupt:flips=64,p=0.01,way=reply",
    "truncate:p=0.005,way=reply",
    "late:ms=1.5,p=0.005,way=reply",
    "wrong-id:p=0.005,way=reply",
)
"""5 % of the replies, each fault by itself; 64 flipped bits are a third of a reply"""
MAY_BE = {
    "none": {"OK"},
    "behind late": {"OK", "LOST"},  # not struck, but the one before held the wire
    "drop": {"LOST"},
    "corrupt": {"CORRUPT", "LOST"},  # with a broken header or length there is no frame in it
    "truncate": {"CORRUPT", "LOST"},
    "late": {"LOST"},
    "wrong-id": {"LOST"},  # another's reply: whole, but not ours
}
"""What may become of a cycle whose reply was struck so, beside undetected damage"""
PERIOD_NS = 1_000_000
COLLECT_NS = 800_000
MAX_SPEED = 15.0
TRUE = TrueServo(inertia=0.011951, damping=0.011692, coulomb=0.09039)
SETTINGS = DynamixelSettings(
    port="", baud=4_000_000, id=1, model="XM430-W350", max_speed=MAX_SPEED, watchdog_s=0.04
)
CRC_PASSES = 2.0**-16
"""The share of random frames whose checksum happens to be right"""
CONFIDENCE = 0.99


class WatchedFaults(Faults):
    """Faults that also tell what they did to the reply of the present cycle."""

    def __init__(self, seed: int) -> None:
        super().__init__((), seed)
        self.names: tuple[str, ...] = ()

    def pass_frame(self, wire: bytes, way: str, now_ns: int) -> Passage | None:
        """See ``Faults``."""
        passage = super().pass_frame(wire, way, now_ns)
        if passage is not None:
            self.names += passage.names
        return passage


@dataclass(slots=True)
class Soaked:
    """What became of the cycles."""

    cycles: int = 0
    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Cycles by what struck their reply, and by what the driver made of it"""
    undetected: int = 0
    damaged: int = 0
    """Replies whose bytes were changed or cut"""
    furthest: float = 0.0
    """Largest distance between the position in use and the true one [share of what the speed limit
    and the age allow]"""
    fastest: float = 0.0
    """[rad/s]"""
    longest_gap: int = 0
    """Failed cycles in a row"""
    counts: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    real_s: float = 0.0


def soak(cycles: int, seed: int) -> Soaked:
    """Drive a moving servo through damaged replies, on the simulated clock."""
    clock = SimulatedClock()
    faults = WatchedFaults(seed)
    truth = EmulatedServo(MODELS[SETTINGS.model], 1, 48, TRUE, start_ns=0, baud=SETTINGS.baud)
    bus = EmulatedBus([truth], baud=SETTINGS.baud, start_ns=0, faults=faults)
    servo = DynamixelServo(SETTINGS, MemoryLine(bus, clock))
    servo.start()
    for spec in DAMAGE:
        bus.inject(spec, clock.now_ns())
    found = Soaked()
    began = time.monotonic()
    deadline = clock.now_ns()
    used: tuple[float, int] | None = None
    gap = 0
    left = False  # the beginning of a broken reply may wait for its rest
    for number in range(cycles):
        behind = "late" in faults.names
        faults.names = ()
        servo.request()
        reading = servo.collect(deadline + COLLECT_NS)
        kind = _kind(faults.names, behind)
        outcome = reading.outcome.name
        found.outcomes[kind, outcome] += 1
        changed = "corrupt" in faults.names or "truncate" in faults.names
        found.damaged += changed
        passed = reading.outcome in (Outcome.OK, Outcome.REFUSED)
        if changed and passed:
            found.undetected += 1
        elif kind != "several" and not (
            outcome in MAY_BE[kind] or (left and reading.outcome is Outcome.CORRUPT)
        ):
            found.problems.append(f"cycle {number}: {kind} became {outcome}")
        left = reading.outcome is not Outcome.OK and (left or changed)
        gap = 0 if reading.outcome is Outcome.OK else gap + 1
        found.longest_gap = max(found.longest_gap, gap)
        if reading.outcome is Outcome.OK:
            used = reading.position, reading.sampled_ns
        now_ns = clock.now_ns()
        state = truth.state(now_ns)
        found.fastest = max(found.fastest, abs(state.velocity))
        if used is not None:
            allowed = MAX_SPEED * (now_ns - used[1]) * 1e-9 + POSITION_UNIT
            found.furthest = max(found.furthest, abs(state.position - used[0]) / allowed)
        servo.write(_drive(number))
        deadline += PERIOD_NS
        clock.wait_until(deadline)
    found.cycles = cycles
    found.counts = asdict(servo.counts)
    found.real_s = time.monotonic() - began
    if not servo.stop():
        found.problems.append("torque off could not be read back at the end")
    _judge(found)
    return found


def _kind(names: tuple[str, ...], behind_late: bool) -> str:
    """In which row of the table a cycle is."""
    if not names:
        return "behind late" if behind_late else "none"
    return names[0] if len(names) == 1 else "several"


def _drive(number: int) -> float:
    """Torque that keeps the shaft swinging at changing speeds, to some 10 rad/s [N·m]."""
    seconds = number * PERIOD_NS * 1e-9
    return 0.25 * math.sin(4.0 * seconds) + 0.35 * math.sin(9.7 * seconds)


def _judge(found: Soaked) -> None:
    """Counts against what was done, positions against the truth, undetected against the CRC."""
    problems, counts = found.problems, found.counts
    by_outcome: Counter[str] = Counter()
    for (_, outcome), count in found.outcomes.items():
        by_outcome[outcome] += count
    for name in ("lost", "corrupt", "refused"):
        if counts[name] != by_outcome[name.upper()]:
            problems.append(f"{by_outcome[name.upper()]} cycles {name}, counted {counts[name]}")
    if counts["cycles"] != found.cycles:
        problems.append(f"{found.cycles} cycles, counted {counts['cycles']}")
    late = sum(count for (kind, _), count in found.outcomes.items() if kind == "late")
    several = sum(count for (kind, _), count in found.outcomes.items() if kind == "several")
    if not late <= counts["late"] <= late + several:
        problems.append(f"{late} replies held up alone, counted {counts['late']} late")
    if found.furthest > 1.0:
        problems.append(f"a position in use was {found.furthest:.2f} of what is allowed off")
    low, high = interval(found.damaged)
    if not low <= found.undetected <= high:
        problems.append(f"{found.undetected} undetected, wanted {low} to {high}")


def interval(count: int) -> tuple[int, int]:
    """How many of so many random frames pass a 16-bit CRC, with ``CONFIDENCE``."""
    low, high = binom.interval(CONFIDENCE, count, CRC_PASSES)
    return int(low), int(high)


def random_frames_that_pass(count: int, seed: int) -> int:
    """How many replies pass the codec whose data and checksum are random bytes."""
    random = Random(seed)
    whole = encode_status(1, 0, bytes(16))
    head = whole[:9]
    passed = 0
    for _ in range(count):
        parser = Parser()
        passed += len(parser.feed(head + random.randbytes(len(whole) - len(head))))
    return passed


def in_memory_page(found: Soaked, frames: int, passed: int, seed: int) -> list[str]:
    """The section on the simulated clock."""
    low, high = interval(found.damaged)
    outcomes = ("OK", "LOST", "CORRUPT", "REFUSED")
    rows = [f"| reply | {' | '.join(name.lower() for name in outcomes)} |", "|---|---|---|---|---|"]
    for kind in (*MAY_BE, "several"):
        cells = " | ".join(f"{found.outcomes[kind, name]}" for name in outcomes)
        rows.append(f"| {kind} | {cells} |")
    rows.append("| *counted by the driver* | " + " | ".join(_counted(found.counts)) + " |")
    low_random, high_random = interval(frames)
    return [
        f"{found.cycles} cycles at 1 kHz, seed {seed}, a shaft that swings at up to"
        f" {found.fastest:.1f} rad/s; {found.real_s:.0f} s of computing. What was done to a reply,"
        " and what its cycle became:",
        "",
        *rows,
        "",
        f"Replies that came late and were never used: {found.counts['late']}. Failed cycles in a"
        f" row: {found.longest_gap} at most.",
        "A reply that is cut short, or whose length is broken, leaves a beginning that might still"
        " be completed: its cycle counts as lost, and a cycle that fails later, before a good one,"
        " as corrupt, because the beginning is found broken then.",
        "",
        f"Changed or cut: {found.damaged} replies, of which **{found.undetected}** passed for good;"
        f" a 16-bit CRC lets {low} to {high} through if they were random bytes ({CONFIDENCE:.0%}"
        " confidence; flips of few bits it finds always).",
        f"To see that rate itself: of {frames} replies with random data and checksum {passed}"
        f" passed the codec, wanted {low_random} to {high_random}.",
        "",
        f"The position in use, however old, was never further from the true one than"
        f" {found.furthest:.0%} of what {MAX_SPEED:g} rad/s, its age and one count allow.",
        "",
        f"Did not hold, {len(found.problems)} times: " + "; ".join(found.problems[:20])
        if found.problems
        else "All of it held.",
    ]


def _counted(counts: dict[str, int]) -> list[str]:
    good = counts["cycles"] - counts["lost"] - counts["corrupt"] - counts["refused"]
    return [str(n) for n in (good, counts["lost"], counts["corrupt"], counts["refused"])]


def real_time(
    seconds: float, seed: int, damage: Sequence[str], folder: Path
) -> tuple[dict, Counter[str], float, float]:
    """Damage in real time, through a pseudo-terminal, by the whole program.

    Returns:
        Its report; how often each fault struck; the rate of its reads by the witness [Hz]; and the
        largest distance of a position from the truth at its instant [rad].
    """
    record, log = folder / "witness.csv", folder / "run.hwlog"
    emulator = subprocess.Popen(
        [*PROGRAM, "emulate", "--record", record, "--seed", str(seed)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    settings = (
        f"servo.port={emulator.stdout.readline().strip()}",
        "servo.watchdog_s=0.5",
        "safety.heartbeat_s=2",
        "safety.max_losses_in_row=400",
        "safety.max_loss=0.9",
        "realtime.profile=best-effort",
        "wall.side=both",
        f"wall.position={math.pi + 0.3}",
        "wall.stiffness=2",
        "wall.damping=0",
    )
    try:
        run = subprocess.Popen(
            [*PROGRAM, "run", "xm430-w350", "--json", f"--duration={seconds}"]
            + [word for setting in settings for word in ("--set", setting)]
            + ["--log", str(log), "--plot", str(folder / "run.png")],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        said = ""
        for line in run.stderr:
            said += line
            if "torque is on" in line:
                emulator.stdin.write("\n".join([*damage, ""]))
                emulator.stdin.flush()
                break
        output, rest = run.communicate()
    finally:
        emulator.terminate()
        emulator.wait()
    if run.returncode:
        sys.exit(f"the run in real time ended with {run.returncode}: {output}{said}{rest}")
    struck: Counter[str] = Counter()
    times, positions, reads = [], [], []
    with record.open() as file:
        for row in csv.DictReader(file):
            if row["event"] == "state":
                times.append(float(row["time_s"]))
                positions.append(float(row["position_rad"]))
            elif row["event"] == "fault":
                struck[row["fault"]] += 1
            elif row["event"] == "rx" and row["instruction"] == "2":
                reads.append(float(row["time_s"]))
    _, rows = read_log(log)
    rows = rows[np.isfinite(rows["position"])]
    true = np.interp(rows["sampled_ns"] * 1e-9, times, positions)
    off = float(np.abs(rows["position"] - true).max())
    last = np.array(reads)[-round(seconds * 900) :]
    return json.loads(output), struck, 1.0 / float(np.median(np.diff(last))), off


def real_time_page(seconds: float, seed: int) -> list[str]:
    """The section in real time: with the damage, and beside it a run without."""
    columns = []
    for damage in ((), DAMAGE):
        with tempfile.TemporaryDirectory() as folder:
            report, struck, rate, off = real_time(seconds, seed, damage, Path(folder))
        bus, lateness = report["bus"], report["lateness_us"]
        columns.append(
            {
                "ticks": report["ticks"],
                "missed ticks": report["missed_ticks"],
                "rate, Hz": f"{report['rate_hz']:.2f}",
                "rate by the witness's median interval, Hz": f"{rate:.2f}",
                "lateness p50, µs": f"{lateness['p50']:.1f}",
                "lateness p99, µs": f"{lateness['p99']:.1f}",
                "replies struck, by the witness": sum(struck.values()),
                "lost": bus["lost"],
                "corrupt": bus["corrupt"],
                "refused": bus["refused"],
                "late": bus["late"],
                "failed beyond those struck": bus["lost"]
                + bus["corrupt"]
                + bus["refused"]
                - sum(struck.values()),
                "furthest from the true position at its instant, rad": f"{off:.4f}",
            }
        )
    calm, damaged = columns
    return [
        f"The whole program for {seconds:.0f} s on a pseudo-terminal, first without damage, then"
        " with it. What is missed or fails without damage is what the machine's stalls cost.",
        "",
        "| | without damage | with damage |",
        "|---|---|---|",
        *(f"| {name} | {calm[name]} | {damaged[name]} |" for name in calm),
    ]


def main() -> None:
    """Soak, judge, write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cycles", type=int, default=1_000_000)
    parser.add_argument("--frames", type=int, default=2_000_000, help="random ones, for the CRC")
    parser.add_argument("--seconds", type=float, default=60.0, help="in real time; 0: not")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=HERE.parent / "docs" / "bus-soak.md")
    wanted = parser.parse_args()
    found = soak(wanted.cycles, wanted.seed)
    passed = random_frames_that_pass(wanted.frames, wanted.seed)
    page = [
        "# Damaged replies",
        "",
        "Written by `scripts/bus_soak`; run it to see it again. One reply in twenty is struck, by"
        " these faults of the [emulated bus](emulated-bus.md), each by itself:",
        "",
        *(f"- `{spec}`" for spec in DAMAGE),
        "",
        "## One servo in memory, on the simulated clock",
        "",
        *in_memory_page(found, wanted.frames, passed, wanted.seed),
        "",
    ]
    if wanted.seconds:
        page += ["## In real time", "", *real_time_page(wanted.seconds, wanted.seed), ""]
    wanted.out.write_text("\n".join(page))
    print("\n".join(page))
    low, high = interval(wanted.frames)
    sys.exit(bool(found.problems) or not low <= passed <= high)


if __name__ == "__main__":
    main()
