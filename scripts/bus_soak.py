"""Soaks the driver in damaged replies, in memory and in real time, and writes docs/bus-soak.md.

    scripts/bus_soak [--cycles N] [--frames N] [--seconds S] [--seed N] [--out FILE]

In memory, on the simulated clock, every run with the same seed is the same. What was done to each
reply is known there, so each cycle's outcome is set against it; positions are set against the true
ones. The status is 1 where something that is promised did not hold.
"""

import sys
import tempfile
from pathlib import Path

from scripts.real_time_soak import real_time_soak
from scripts.soak import (
    CONFIDENCE,
    DAMAGE,
    MAX_SPEED,
    MAY_BE,
    Soaked,
    interval,
    random_frames_that_pass,
    soak,
)
from scripts.whole_program import measured_on, page_options, say_time

CYCLE_S, FRAME_S, START_S = 3e-4, 1e-5, 5.0
"""Duration of a cycle in memory, of a random frame and of the program's start [s]"""


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
        " be completed: its cycle became a lost one. Once another frame begins it was cut short,"
        " and the driver counts it as corrupt instead.",
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


def real_time_page(seconds: float, seed: int) -> list[str]:
    """The section in real time: with the damage, and beside it a run without."""
    columns = []
    for damage in ((), DAMAGE):
        with tempfile.TemporaryDirectory() as folder:
            found = real_time_soak(seconds, seed, damage, Path(folder))
        report = found.report
        bus, lateness = report["bus"], report["lateness_us"]
        failed = bus["lost"] + bus["corrupt"] + bus["refused"]
        columns.append(
            {
                "ticks": report["ticks"],
                "missed ticks": report["missed_ticks"],
                "rate, Hz": f"{report['rate_hz']:.2f}",
                "rate by the witness's median interval, Hz": f"{found.rate_hz:.2f}",
                "lateness p50, µs": f"{lateness['p50']:.1f}",
                "lateness p99, µs": f"{lateness['p99']:.1f}",
                "replies struck, by the witness": found.struck.total(),
                "lost": bus["lost"],
                "corrupt": bus["corrupt"],
                "refused": bus["refused"],
                "late": bus["late"],
                "failed beyond those struck": failed - found.struck.total(),
                "furthest from the true position at its instant, rad": f"{found.furthest:.4f}",
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
    parser = page_options("bus_soak", __doc__, "bus-soak.md")
    parser.add_argument("--cycles", type=int, default=1_000_000, help="on the simulated clock")
    parser.add_argument("--frames", type=int, default=2_000_000, help="random ones, for the CRC")
    parser.add_argument("--seconds", type=float, default=60.0, help="in real time; 0: not")
    parser.add_argument("--seed", type=int, default=1, help="of the damage")
    wanted = parser.parse_args()
    say_time(
        wanted.cycles * CYCLE_S
        + wanted.frames * FRAME_S
        + bool(wanted.seconds) * 2 * (wanted.seconds + START_S)
    )
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
        measured_on(),
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
