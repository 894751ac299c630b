"""Runs the driver on damaged replies for a long time, in memory and in real time.

    scripts/study bus_soak [--cycles N] [--frames N] [--seconds S] [--seed N]

In memory, on the simulated clock, every run with the same seed is the same. There the damage to
each reply is known, so each cycle's outcome is compared to it, and positions are compared to the
true ones. The exit status is 1 if a promise was broken.
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_wall.controller.bench.loops import FORGIVING
from haptic_wall.controller.emulated_bus.record import read_rows
from haptic_wall.controller.logs.file import read_log
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.hw.dynamixel.codec import Instruction
from scripts.soak import (
    CONFIDENCE,
    DAMAGE,
    MAX_SPEED,
    MAY_BE,
    interval,
    random_frames_that_pass,
    soak,
)
from scripts.study import Found, Option, Part, Study, table
from scripts.whole_program import PROGRAM, emulated_bus, with_sets

WALL = ("wall.side=both", f"wall.position={pi}", "wall.stiffness=2", "wall.damping=0")
"""Around the place where the emulated servo stands; its hand moves it"""


@dataclass(frozen=True, slots=True)
class Soaked:
    """Report and record of one run."""

    report: dict[str, Any]
    struck: Counter[str]
    """How often each fault struck"""
    rate_hz: float
    """Rate of its reads, by the median of their intervals"""
    furthest: float
    """Largest distance of a position from the truth at its instant [rad]"""


def real_time_soak(seconds: float, seed: int, damage: Sequence[str], folder: Path) -> Soaked:
    """Run for so long on a pseudo-terminal; the damage begins when torque is on."""
    record, log = folder / "witness.csv", folder / "run.hwlog"
    with emulated_bus("--record", record, "--seed", str(seed), "--set", "servo.hand=push") as bus:
        run = subprocess.Popen(
            [
                *[*PROGRAM, "run", "xm430-w350", "--json", f"--duration={seconds}"],
                *with_sets((f"servo.port={bus.port}", *FORGIVING, *WALL)),
                *["--log", str(log), "--plot", str(folder / "run.png")],
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert run.stderr is not None
        said = ""
        for line in run.stderr:
            said += line
            if "torque is on" in line:
                bus.inject(*damage)
                break
        output, rest = run.communicate()
    if run.returncode:
        sys.exit(f"the run in real time ended with {run.returncode}: {output}{said}{rest}")
    truth = read_rows(record)
    states = [row for row in truth if row.event == "state"]
    reads = [
        row.time_s for row in truth if row.event == "rx" and row.instruction == Instruction.READ
    ]
    _, rows = read_log(log)
    position: FloatArray = rows["position"]
    known = np.isfinite(position)
    sampled: FloatArray = rows["sampled_ns"][known] * 1e-9
    true = np.interp(
        sampled,
        [row.time_s for row in states],
        [row.position_rad for row in states],
    )
    last = np.array(reads)[-round(seconds * 900) :]
    return Soaked(
        json.loads(output),
        Counter(row.fault for row in truth if row.event == "fault"),
        1.0 / float(np.median(np.diff(last))),
        float(np.abs(position[known] - true).max()),
    )


OUTCOMES = ("OK", "LOST", "CORRUPT", "REFUSED")


class Memory(NamedTuple):
    """Outcomes of the cycles in memory, and of random frames."""

    fastest: float
    """Speed of the shaft [rad/s]"""
    outcomes: dict[str, list[int]]
    """How often each of ``OUTCOMES``, by what was done to the reply"""
    counts: dict[str, int]
    longest_gap: int
    damaged: int
    undetected: int
    furthest: float
    """Of what is allowed [1]"""
    problems: list[str]
    passed: int
    """Random frames"""


def in_memory(case: tuple[int, int, int]) -> Memory:
    """Soak the driver for some cycles, and the codec in some random frames, by a seed."""
    cycles, frames, seed = case
    found = soak(cycles, seed)
    return Memory(
        found.fastest,
        {kind: [found.outcomes[kind, name] for name in OUTCOMES] for kind in (*MAY_BE, "several")},
        dict(found.counts),
        found.longest_gap,
        found.damaged,
        found.undetected,
        found.furthest,
        found.problems,
        random_frames_that_pass(frames, seed),
    )


def memory(rows: Found[tuple[int, int, int], Memory]) -> list[str]:
    """The section on the simulated clock."""
    (((cycles, frames, seed), found),) = rows
    low, high = interval(found.damaged)
    low_random, high_random = interval(frames)
    lines = table(
        ["reply", *map(str.lower, OUTCOMES)],
        *([kind, *each] for kind, each in found.outcomes.items()),
        ["*counted by the driver*", *_counted(found.counts)],
    )
    return [
        f"{cycles} cycles at 1 kHz, seed {seed}, a shaft that swings at up to"
        f" {found.fastest:.1f} rad/s. Damage to a reply, and the outcome of its cycle:",
        "",
        *lines,
        "",
        f"Replies that came late and were never used: {found.counts['late']}. Failed cycles in a"
        f" row: {found.longest_gap} at most.",
        "A reply that is cut short, or whose length is broken, might still be completed, so its"
        " cycle is lost. If another frame begins meanwhile the driver counts it as corrupt.",
        "",
        f"Changed or cut: {found.damaged} replies, of which **{found.undetected}** passed as valid;"
        f" a 16-bit CRC lets {low} to {high} through if they were random bytes ({CONFIDENCE:.0%}"
        " confidence; flips of few bits it finds always).",
        f"To measure that rate: of {frames} replies with random data and checksum {found.passed}"
        f" passed the codec; expected {low_random} to {high_random}.",
        "",
        "The error of the position in use, however old, was at most"
        f" {found.furthest:.0%} of what {MAX_SPEED:g} rad/s, its age and one count allow.",
        "",
        f"Did not hold, {len(found.problems)} times: " + "; ".join(found.problems[:20])
        if found.problems
        else "All of it held.",
    ]


def _counted(counts: dict[str, int]) -> list[str]:
    good = counts["cycles"] - counts["lost"] - counts["corrupt"] - counts["refused"]
    return [str(n) for n in (good, counts["lost"], counts["corrupt"], counts["refused"])]


def memory_holds(rows: Found[tuple[int, int, int], Memory]) -> bool:
    """Whether every cycle became what it may, and as many random frames passed as should."""
    (((_, frames, _), found),) = rows
    low, high = interval(frames)
    return not found.problems and low <= found.passed <= high


def in_real_time(case: tuple[float, int, tuple[str, ...]]) -> dict[str, str]:
    """Figures of one run of the whole program; its damage may be none."""
    seconds, seed, damage = case
    with tempfile.TemporaryDirectory() as folder:
        found = real_time_soak(seconds, seed, damage, Path(folder))
    report: dict[str, Any] = found.report
    bus, lateness = report["bus"], report["lateness_us"]
    failed = bus["lost"] + bus["corrupt"] + bus["refused"]
    return {
        "ticks": f"{report['ticks']}",
        "missed ticks": f"{report['missed_ticks']}",
        "rate, Hz": f"{report['rate_hz']:.2f}",
        "rate by the witness's median interval, Hz": f"{found.rate_hz:.2f}",
        "lateness p50, µs": f"{lateness['p50']:.1f}",
        "lateness p99, µs": f"{lateness['p99']:.1f}",
        "damaged replies, by the witness": f"{found.struck.total()}",
        **{name: f"{bus[name]}" for name in ("lost", "corrupt", "refused", "late")},
        "failed cycles beyond these": f"{failed - found.struck.total()}",
        "largest error of the position at its instant, rad": f"{found.furthest:.4f}",
    }


def real_time(found: Found[Any, dict[str, str]]) -> list[str]:
    """The section in real time: with the damage, and beside it a run without."""
    (_, calm), (_, damaged) = found
    rows = ([name, calm[name], damaged[name]] for name in calm)
    return table(["", "without damage", "with damage"], *rows)


STUDY = Study(
    "evidence/bus-soak.md",
    (
        Part(
            "memory",
            lambda given: [(given.cycles, given.frames, given.seed)],
            in_memory,
            memory,
            case_s=320.0,
            wanted=memory_holds,
        ),
        Part(
            "real-time",
            lambda given: [(given.seconds, given.seed, damage) for damage in ((), DAMAGE)],
            in_real_time,
            real_time,
            case_s=65.0,
            in_turn=True,
        ),
    ),
    (
        Option("cycles", 1_000_000, "cycles on the simulated clock"),
        Option("frames", 2_000_000, "random frames for the CRC"),
        Option("seconds", 60.0, "duration in real time [s]"),
        Option("seed", 1, "seed of the damage"),
    ),
)
