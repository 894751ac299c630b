"""Tries passivity control around the ceiling of a link's vibration: does it feed the vibration?"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from scripts.study import Given
from scripts.trials.beyond_ceiling import draw_walls, unguarded
from scripts.trials.cases import PRESETS, Case
from scripts.trials.rates import few, most
from scripts.trials.run import Trial
from scripts.trials.sections import Job, Made, draws, in_parts, section, walls_of
from scripts.trials.truth import Truth
from scripts.trials.verdicts import small, sustains

SHARES = (0.5, 0.9, 1.2, 2.0)
"""B over the exact ceiling"""
CONTROL = "wall.passivity_control=true"
_COUNT = math.tau / 4096
_LARGER = 1.1
_LAST_S = 2.0
_A_JOB = 6


@dataclass(frozen=True, slots=True)
class Controlled:
    """One wall without and with passivity control."""

    case: Case
    lasts: tuple[bool, bool]
    """It sustains itself above four counts while the detector reports: without, with"""
    amplitude: tuple[float, float]
    """Half of the way that the output covers to and fro in a tenth of a second, at most over the
    last two seconds [counts]"""
    injected: float
    """Mean injected damping over B [1]"""
    ends_s: tuple[float, float]
    """With the guard off: end of the run by an alarm; NaN: there was none [s]"""


@dataclass(frozen=True, slots=True)
class Cell:
    """Results of some walls."""

    preset: str
    share: float
    known: bool
    """The link is believed, exactly"""
    found: list[Controlled]


def link_believed(truth: Truth) -> tuple[str, ...]:
    """Return the belief of a link that is known exactly, as changes of a configuration."""
    motor, load = truth.inertia - truth.load_inertia, truth.load_inertia
    moving = motor * load / truth.inertia
    rate = math.sqrt(truth.transmission_stiffness / moving)
    return (
        f"model.load_inertia={load!r}",
        f"model.flexible_hz={rate / math.tau!r}",
        f"model.flexible_damping_ratio={0.5 * truth.transmission_damping / (moving * rate)!r}",
    )


def controlled(case: Case) -> Controlled:
    """Run a case without and with passivity control, first without a reaction."""
    with_it = replace(case, law=(*case.law, CONTROL))
    plain, other = case.run("report"), with_it.run("report")
    least, wall = small(case.truth.counts_per_rev), case.wall
    ends = [unguarded(each).run("trip") for each in (case, with_it)]
    return Controlled(
        case=case,
        lasts=(sustains(plain, least), sustains(other, least)),
        amplitude=(_amplitude(plain), _amplitude(other)),
        injected=float(np.mean(other.damping)) / wall.damping - 1.0,
        ends_s=(_ended_s(ends[0]), _ended_s(ends[1])),
    )


def _amplitude(trial: Trial) -> float:
    end = trial.output.size
    windows = range(max(0, end - round(_LAST_S / trial.period)), end - 99, 100)
    return 0.5 * max(float(np.ptp(trial.output[at : at + 100])) for at in windows) / _COUNT


def _ended_s(trial: Trial) -> float:
    return math.nan if trial.trip is None else trial.output.size * trial.period


def tried(job: tuple[str, float, bool, int, tuple[int, ...]]) -> Cell:
    """Try some walls.

    Args:
        job: Preset of the servo, B over the ceiling, whether the link is believed, number of walls,
            and the seed.
    """
    preset, share, known, walls, seed = job
    cases = draw_walls(preset, share, walls, draws(seed))
    if known:
        cases = [replace(case, law=link_believed(case.truth)) for case in cases]
    return Cell(preset, share, known, [controlled(case) for case in cases])


def jobs(given: Given) -> list[Job]:
    """Return the jobs: both servos, with and without a believed link, all shares, in parts."""
    made = []
    for i, preset in enumerate(PRESETS):
        for known in (False, True):
            for share in SHARES if given.walls else SHARES[2:3]:
                for part, walls in in_parts(walls_of(given, 1), _A_JOB):
                    made.append((preset, share, known, walls, (given.seed, 14, i, part)))
    return made


def told(cells: list[Cell]) -> Made:
    """Return the section's text."""
    lines = [
        "The walls of the [detector's table](detector-table.md#beyond-the-ceiling-of-a-link), other"
        " draws, without and with passivity control; the link is not believed, or known exactly."
        f" *Larger*, *smaller*: the amplitude in the last {_LAST_S:g} s, by more than a tenth and a"
        " count. With the guard off an alarm ends the run.",
        "",
        "| servo | link | B / ceiling | walls | damping added, of B: mean, most | lasts without"
        " control | lasts with it | lasts with it alone | larger with it | smaller with it | ends"
        " without it, of those that last | ends with it | time, median: without, with it |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for preset in PRESETS:
        for known in (False, True):
            for share in SHARES:
                here = [
                    one
                    for some in cells
                    if (some.preset, some.known, some.share) == (preset, known, share)
                    for one in some.found
                ]
                name = "known" if known else "not believed"
                lines.append(f"| {preset} | {name} | {share:g} | {_cells(here)} |")
    wrong: list[tuple[str, object]] = [
        (f"B {some.share:g}: lasts with passivity control alone", one.case)
        for some in cells
        for one in some.found
        if one.lasts[1] and not one.lasts[0]
    ]
    return Made(lines, wrong)


def _cells(found: list[Controlled]) -> str:
    n = len(found)
    added = [100.0 * round(one.injected, 6) + 0.0 for one in found]  # no -0.0
    alone = sum(one.lasts[1] and not one.lasts[0] for one in found)
    cells = [
        str(n),
        f"{np.mean(added):.1f}, {max(added):.0f} %" if added else "",
        str(sum(one.lasts[0] for one in found)),
        str(sum(one.lasts[1] for one in found)),
        few(alone, n),
        str(sum(_larger(*one.amplitude) for one in found)),
        str(sum(_larger(*reversed(one.amplitude)) for one in found)),
    ]
    for i in (0, 1):
        lasting = [one for one in found if one.lasts[i]]
        cells.append(most(sum(one.ends_s[i] == one.ends_s[i] for one in lasting), len(lasting)))
    both = [one.ends_s for one in found if not any(map(math.isnan, one.ends_s))]
    cells.append(", ".join(f"{np.median(each):.1f} s" for each in zip(*both, strict=True)))
    return " | ".join(cells)


def _larger(before: float, after: float) -> bool:
    return after > _LARGER * before and after > before + 1.0


PASSIVE = section("ceiling", jobs, tried, told, case_s=25.0)
