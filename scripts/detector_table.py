"""Tries the oscillation detector on walls and hands drawn at random; writes docs/detector-table.md.

    scripts/study detector_table [--quick] [--seed N] [--only SECTION ...] [--hours H] [--walls N]
                           [--examples FILE] [--out FILE]

With ``--only`` the other sections of the page stay as they are.
"""

import math
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor, Future, as_completed
from typing import Any

import numpy as np

from haptic_wall.controller.experiments.processes import cores, not_from_the_terminal, processes
from scripts.page_sections import add_options, amount_of, command_of, write
from scripts.trials.beyond_limit import LIMIT
from scripts.trials.bouncing import BOUNCES
from scripts.trials.detector_trials import (
    NAMES,
    HandTrial,
    KickTrial,
    SustainedTrial,
    hand_trials,
    kick_trials,
    sustained_trials,
)
from scripts.trials.hand_hours import HOURS
from scripts.trials.hands import HANDS
from scripts.trials.own_walls import WALLS
from scripts.trials.recordings import RECORDINGS
from scripts.trials.sections import measured
from scripts.trials.small_cycles import BACKLASH_CYCLES
from scripts.whole_program import measured_on, page_options

SHARES = (0.6, 0.9, 1.2, 1.5, 2.0, 3.0)
WALLS_A_TASK, HANDS_A_TASK, HAND_S = 50, 20, 60.0
TASKS, QUICK_TASKS = (6, 2, 4), (2, 1, 1)
"""Parts of kicks, of sustained oscillations, and of each hand"""
CHOSEN_ON, SEED = (1, 2), 3
"""Seeds whose walls and hands the detector's thresholds were chosen on, and one that had no part in
it: whoever changes a threshold after looking at its results takes another."""
QUICK = 5
"""By what a part of the quick run has fewer walls, and shorter hands"""

BELIEF = "belief"
"""The part of the page on the detector that uses the believed servo"""
SECTIONS = {one.name: one for one in (WALLS, HOURS, LIMIT, BOUNCES, BACKLASH_CYCLES, RECORDINGS)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the trials, and write the page."""
    options = page_options("detector_table", __doc__ or "", "detector-table.md")
    options.add_argument("--quick", action="store_true", help="a fifteenth of the trials, or fewer")
    options.add_argument("--seed", type=int, default=SEED, help="of all draws")
    add_options(options, (BELIEF, *SECTIONS))
    chosen = options.parse_args(arguments)
    names = chosen.only or (BELIEF, *SECTIONS)
    command = command_of("detector_table", chosen)
    begin = time.monotonic()
    with not_from_the_terminal(), processes(cores()) as pool:
        parts = run(pool, chosen.seed, chosen.quick) if BELIEF in names else None
        took = time.monotonic() - begin
        sections = [SECTIONS[name] for name in names if name != BELIEF]
        made = measured(pool, sections, amount_of(chosen), command)
    head = None
    if parts is not None:
        how = f"`{command}`, {took / 60:.0f} min"
        head = page(*parts, how, seen=chosen.seed in CHOSEN_ON)
    write(chosen, head, list(SECTIONS), made)


def run(
    pool: Executor, seed: int, quick: bool
) -> tuple[list[KickTrial], list[SustainedTrial], list[HandTrial]]:
    """All the trials, in parallel; the same for the same seed."""
    fewer = QUICK if quick else 1
    seeds = iter(range(1000 * seed, 1000 * seed + 1000))
    kick_tasks, kept_tasks, hand_tasks = QUICK_TASKS if quick else TASKS
    walls = WALLS_A_TASK // fewer
    kicks = [pool.submit(kick_trials, walls, next(seeds), SHARES) for _ in range(kick_tasks)]
    kept = [pool.submit(sustained_trials, walls, next(seeds)) for _ in range(kept_tasks)]
    hands = [
        pool.submit(hand_trials, HANDS_A_TASK, next(seeds), hand, HAND_S / fewer)
        for hand in HANDS
        for _ in range(hand_tasks)
    ]
    every: list[Future[Any]] = [*kicks, *kept, *hands]
    for done, _ in enumerate(as_completed(every), 1):
        print(f"{done} of {len(every)} parts done", file=sys.stderr)
    return (
        [trial for task in kicks for trial in task.result()],
        [trial for task in kept for trial in task.result()],
        [trial for task in hands for trial in task.result()],
    )


def page(
    kicks: list[KickTrial],
    sustained: list[SustainedTrial],
    hands: list[HandTrial],
    how: str,
    *,
    seen: bool,
) -> str:
    """The page of documentation; ``seen``: the thresholds were chosen on these very draws."""
    others = " and ".join(str(seed) for seed in CHOSEN_ON)
    drawn = (
        "The detector's thresholds were chosen on these very draws: on others it does worse."
        if seen
        else f"The detector's thresholds were chosen on the draws of seeds {others}; those of this"
        " page had no part in it."
    )
    return "\n".join(
        [
            "# The detector, tried",
            "",
            f"Written by {how}. {measured_on()}",
            "What is drawn, and what the words mean: [detector](detector.md).",
            drawn,
            "",
            "## After a kick",
            "",
            "| K / limit for this kick | walls | motion grows or lasts | alarm | before twice the "
            "kick | alarm, but the motion dies | amplitude / kick until the alarm, median and "
            "95 % |",
            "|---|---|---|---|---|---|---|",
            *(_kick_row(share, [t for t in kicks if t.share == share]) for share in SHARES),
            "",
            "At 1.2 times the limit and above, by servo:",
            "",
            "| | walls | alarm | before twice the kick |",
            "|---|---|---|---|",
            *(_servo_row(name, [t for t in kicks if t.name == name]) for name in NAMES),
            _servo_row("B = 0", [t for t in kicks if t.undamped]),
            _servo_row("kick up to 20 counts", [t for t in kicks if t.kick < 20 * _COUNT]),
            "",
            "## Sustained oscillations",
            "",
            *_sustained(sustained),
            "",
            "## Hands on walls at nine tenths of their limit",
            "",
            "| hand | walls | hours | alarms | of these, motion goes on without the hand | false |"
            " walls with a false one | sustained, but too small for an alarm: walls | of these,"
            " motion goes on without the hand |",
            "|---|---|---|---|---|---|---|---|---|",
            *(_hand_row(hand, [t for t in hands if t.hand == hand]) for hand in HANDS),
            "",
            "Whether motion goes on is looked up in the simulation: at the alarm the hand lets go,"
            " holds still, or pushes on steadily with its mean force, none of which feeds an"
            " oscillation. It goes on if after one of them at least half of the amplitude is left,"
            " and no more than 7 % is lost in the last twelve of 60 cycles.",
            "",
        ]
    )


_COUNT = 2.0 * math.pi / 4096


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "none"


def _kick_row(share: float, trials: list[KickTrial]) -> str:
    n = len(trials)
    reached = [t.reached for t in trials if t.alarm]
    median, most = np.percentile(reached, [50, 95]) if reached else (math.nan, math.nan)
    early = _percent(sum(t.early for t in trials), n) if share > 1.0 else ""
    spread = f"{median:.2f}, {most:.2f}" if share > 1.0 else ""
    return (
        f"| {share} | {n} | {sum(t.lasts for t in trials)} |"
        f" {_percent(sum(t.alarm for t in trials), n)} | {early} |"
        f" {sum(t.alarm and not t.lasts for t in trials)} | {spread} |"
    )


def _servo_row(name: str, trials: list[KickTrial]) -> str:
    some = [t for t in trials if t.share > 1.0]
    n = len(some)
    alarms, early = sum(t.alarm for t in some), sum(t.early for t in some)
    return f"| {name} | {n} | {_percent(alarms, n)} | {_percent(early, n)} |"


def _sustained(trials: list[SustainedTrial]) -> list[str]:
    n = len(trials)
    frequency = [abs(t.frequency_error) for t in trials if t.alarm]
    amplitude = [abs(t.amplitude_error) for t in trials if t.alarm]
    counts = [t.counts for t in trials]
    silent = [t for t in trials if not t.alarm]
    why = (
        f" Of the {len(silent)} without an alarm {sum(t.shrinks for t in silent)} were said to"
        " decay: they came down to their amplitude from above, by some thousandths a swing, until"
        " shortly before the record ended."
        if silent
        else ""
    )
    return [
        f"{n} oscillations of {min(counts):.0f} to {max(counts):.0f} counts that a torque limit"
        f" sustains: alarm in {n - len(silent)}; frequency within 3 % in"
        f" {sum(e <= 0.03 for e in frequency)} (largest error {100 * max(frequency):.1f} %),"
        f" amplitude within 20 % in {sum(e <= 0.2 for e in amplitude)} (largest"
        f" {100 * max(amplitude):.1f} %).{why}"
    ]


def _hand_row(hand: str, trials: list[HandTrial]) -> str:
    hours = sum(t.seconds for t in trials) / 3600.0
    alarms, real = sum(t.alarms for t in trials), sum(t.real for t in trials)
    return (
        f"| {hand} | {len(trials)} | {hours:.2f} | {alarms} | {real} | {alarms - real} |"
        f" {sum(t.alarms > t.real for t in trials)} | {sum(t.small for t in trials)} |"
        f" {sum(t.small_real for t in trials)} |"
    )


if __name__ == "__main__":
    main()
