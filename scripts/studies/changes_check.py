"""Changes random walls in contact at random, and measures the energy that the shaft gets.

scripts/study changes_check [--runs N]
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_wall.controller.settings.changes import moved
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from scripts.changed_walls import Asked, ChangedRun, injected
from scripts.hostile_changes import MOST_STEPS, Hostile, box
from scripts.hostile_changes import tried as attacked
from scripts.study import Given, Option, Part, Study, table
from scripts.trials.rates import few
from scripts.trials.search import Axis, worst_cases

SECONDS = 30.0
"""Duration of a run [s]"""
GAP = 300
"""Ticks between the end of a change and the next one"""
WAIT = 10_000
"""Longest wait [ticks]: the default of the command"""
_BEHIND = 20
"""Least number of rows behind a change that is judged: the longest delay, and more"""
MOST_J = 1e-3
PRESETS = "xm430-w350", "xl330-m288"
HANDS = "push", "tap", "lean"
SEED = 1000
"""Of the first run; the rule was tuned on runs with smaller ones"""
LAWS = "wall", "spring", "stops", "detents", "texture", "friction", "profile"
KINDS = (
    "stiffness up",
    "stiffness down",
    "damping",
    "position",
    "delay up",
    "delay down",
    "law",
    "several",
)


@dataclass(frozen=True, slots=True)
class Bench:
    """A run."""

    preset: str
    hand: str
    seed: int


class One(NamedTuple):
    """A change."""

    kind: str
    made: bool
    waited_s: float
    energy: float
    """Given to the shaft [J]; 0: not made"""
    why: str
    """Last reason to wait"""


class Row(NamedTuple):
    """Of a run."""

    changes: tuple[One, ...]
    ended: str


def benches(given: Given) -> list[Bench]:
    """Return the runs."""
    return [
        Bench(preset, hand, seed)
        for seed in range(SEED, SEED + given.runs)
        for preset in PRESETS
        for hand in HANDS
    ]


def tried(bench: Bench, seconds: float = SECONDS) -> Row:
    """Run a wall, and change it.

    Args:
        bench: The run.
        seconds: Its duration [s].
    """
    random = np.random.default_rng([bench.seed, *bench.preset.encode(), *bench.hand.encode()])
    config = _config(bench, random)
    kinds: list[str] = []
    free = [0]

    def ask(row: int, now: Config, position: float) -> Sequence[str]:
        if run.asked and run.asked[-1].tick >= free[0]:
            free[0] = row + GAP
        if row < free[0] or row < 2 * GAP or not _touches(now, position):
            return ()
        free[0] = row
        kind, sets = _drawn(random, now)
        kinds.append(kind)
        return sets

    run = ChangedRun(config, ask, WAIT)
    result, rows = run.run(seconds)
    since = 0
    found = []
    for kind, asked in zip(kinds, run.asked, strict=True):
        if asked.refused:
            raise AssertionError(asked.refused)
        if asked.number:
            continue  # the run ended while it waited
        energy = injected(run, rows, asked, since) if asked.row >= 0 else 0.0
        if _same(rows, asked) or asked.row + _BEHIND > len(rows):
            continue
        waited = (asked.row - asked.tick) * config.period_s if asked.row >= 0 else WAIT * 1e-3
        found.append(One(kind, asked.row >= 0, waited, energy, asked.obstacle.name.lower()))
        since = asked.row if asked.row >= 0 else since
    return Row(tuple(found), str(result.stop_reason))


def _config(bench: Bench, random: np.random.Generator) -> Config:
    """Return a wall on a servo drawn inside the belief of a preset."""
    preset = load_config(bench.preset).config
    belief, limit = preset.belief(), preset.servo.torque_limit
    sets = [
        "loop.clock=simulated",
        "servo.backend=simulated",
        f"servo.hand={bench.hand}",
        f"servo.torque_limit={limit!r}",
        "servo.counts_per_rev=4096",
        f"wall.stiffness={10.0 ** random.uniform(-0.5, 0.7):.4g}",
        f"wall.damping={random.choice([0.0, random.uniform(0.0, 0.03)]):.4g}",
        f"delay.steps={max(0, int(random.integers(-4, 5)))}",
    ]
    for name in ("inertia", "damping", "coulomb", "delay"):
        bounds = getattr(belief, name)
        corner = random.random() < 0.5
        true = random.choice([bounds.low, bounds.high]) if corner else None
        true = random.uniform(bounds.low, bounds.high) if true is None else true
        sets.append(f"servo.{name}={float(true)!r}")
        sets.append(
            f"model.{name}={{value: {bounds.value!r}, low: {bounds.low!r}, high: {bounds.high!r}}}"
        )
    return load_config("simulated", sets).config


def _same(rows: NDArray[np.void], asked: Asked) -> bool:
    """Whether the guard commands the same as before: it allows neither more."""
    if asked.row < 0 or asked.new is None:
        return False
    before, after = rows[asked.tick - 1], rows[asked.row]
    gains = all(before[name] == after[name] for name in ("stiffness", "damping"))
    same = asked.before.delay == asked.new.delay and not moved(asked.before, asked.new)
    return gains and same


def _touches(config: Config, position: float) -> bool:
    """Whether the law holds energy at a position."""
    law = config.law(0.0)
    return law.in_contact(position) and abs(law.elongation(position)) > 2e-3


def _drawn(random: np.random.Generator, now: Config) -> tuple[str, tuple[str, ...]]:
    """Draw a change."""
    kind = str(random.choice(KINDS))
    wall, steps = now.wall, now.delay.steps
    stiffness = wall.stiffness
    if kind == "delay down" and steps == 0:
        kind = "delay up"
    match kind:
        case "stiffness up":
            return kind, (f"wall.stiffness={min(stiffness * random.uniform(1.1, 4.0), 8.0):.5g}",)
        case "stiffness down":
            return kind, (f"wall.stiffness={stiffness * random.uniform(0.1, 0.9):.5g}",)
        case "damping":
            return kind, (f"wall.damping={random.uniform(0.0, 0.05):.5g}",)
        case "position":
            return kind, (f"wall.position={wall.position + random.normal(0.0, 0.05):.5g}",)
        case "delay up":
            return kind, (f"delay.steps={min(steps + int(random.integers(1, 4)), 6)}",)
        case "delay down":
            return kind, (f"delay.steps={int(random.integers(0, steps))}",)
        case "law":
            return kind, _law(random, wall.law)
    return kind, (
        f"wall.stiffness={10.0 ** random.uniform(-0.5, 0.7):.5g}",
        f"wall.damping={random.uniform(0.0, 0.05):.5g}",
        f"wall.position={random.normal(0.0, 0.05):.5g}",
        f"delay.steps={int(random.integers(0, 6))}",
    )


def _law(random: np.random.Generator, now: str) -> tuple[str, ...]:
    """Draw another law."""
    law = str(random.choice([each for each in LAWS if each != now]))
    numbers = {
        "wall": (),
        "spring": (),
        "stops": ("wall.low=-1", f"wall.high={random.uniform(-0.1, 0.1):.4g}"),
        "detents": (
            f"wall.count={random.integers(8, 64)}",
            f"wall.snap={random.uniform(0.1, 0.4):.3g}",
        ),
        "texture": (f"wall.period={random.uniform(0.03, 0.2):.4g}",),
        "friction": (f"wall.friction={random.uniform(0.02, 0.2):.3g}",),
        "profile": ("wall.profile=[[-1, 1], [-0.2, 0.3], [0, 0], [0.3, -0.6], [1, -1]]",),
    }[law]
    return (f"wall.law={law}", *numbers)


def _whole(found: Sequence[tuple[Bench, Row]]) -> list[One]:
    return [each for _, row in found for each in row.changes]


def by_kind(found: Sequence[tuple[Bench, Row]]) -> Iterable[str]:
    """Return the tables of the kinds of changes and of the hands, and what waited in vain."""
    rows = []
    for kind in (*KINDS, "all"):
        some = [each for each in _whole(found) if kind in ("all", each.kind)]
        rows.append(_cells(kind, some))
    yield from table(_HEAD, *rows)
    yield ""
    rows = []
    for hand in HANDS:
        some = [each for bench, row in found if bench.hand == hand for each in row.changes]
        rows.append(_cells(f"`{hand}`", some))
    yield from table(("hand", *_HEAD[1:]), *rows)
    vain = [each.why for each in _whole(found) if not each.made]
    yield ""
    yield (
        "Waited for in vain: "
        + (", ".join(f"{why} {vain.count(why)}" for why in sorted(set(vain))) or "nothing")
        + "."
    )
    ends = [row.ended for _, row in found]
    yield "Ends of the runs: " + ", ".join(f"{e} {ends.count(e)}" for e in sorted(set(ends))) + "."


_HEAD = (
    "change",
    "asked",
    "made",
    "waited, median [s]",
    "waited, 90 % [s]",
    "energy, median [mJ]",
    "energy, largest [mJ]",
)


def _cells(name: str, some: Sequence[One]) -> tuple[str, ...]:
    made = [each for each in some if each.made]
    if not made:
        return (name, str(len(some)), "0", "", "", "", "")
    waited = np.array([each.waited_s for each in made])
    energy = 1e3 * np.array([each.energy for each in made])
    return (
        name,
        str(len(some)),
        f"{len(made)} ({100.0 * len(made) / len(some):.0f} %)",
        f"{np.median(waited):.2f}",
        f"{np.percentile(waited, 90):.2f}",
        f"{np.median(energy):.3f}",
        f"{energy.max():.3f}",
    )


def harmless(found: Sequence[tuple[Bench, Row]]) -> bool:
    """Whether no change gave more than a millijoule, and most were made."""
    every = _whole(found)
    made = [each for each in every if each.made]
    return all(each.energy <= MOST_J for each in made) and len(made) > 0.8 * len(every)


FEW_STEPS = 6
HOW = "drawn", "searched"
_A_CASE = 20
"""Runs drawn in a case; a search has some times as many"""
PARENTS, CHILDREN = 20, 40
Attack = tuple[str, int, int, int]
"""How, longest delay [periods], generations, seed"""


def attacks(given: Given) -> list[Attack]:
    """Return hostile runs: many drawn at random, and searches."""
    return [
        (how, steps, given.generations, SEED + k)
        for steps in (FEW_STEPS, MOST_STEPS)
        for how, count in zip(HOW, (given.drawn // _A_CASE, given.searches), strict=True)
        for k in range(max(1, count))
    ]


def attack(case: Attack) -> tuple[Hostile, ...]:
    """Draw hostile runs, or search for the worst one; all that were tried."""
    how, steps, generations, seed = case
    axes = box(steps)
    found: list[Hostile] = []

    def energy(point: Mapping[str, float]) -> float:
        found.append(attacked(point))
        return found[-1].largest

    if how == HOW[0]:
        random = np.random.default_rng([seed, steps])
        for _ in range(_A_CASE):
            energy(_anywhere(axes, random))
    else:
        worst_cases(
            energy,
            axes,
            parents=PARENTS,
            children=CHILDREN,
            generations=generations,
            seed=seed,
            workers=0,
        )
    return tuple(found)


def _anywhere(axes: Sequence[Axis], random: np.random.Generator) -> dict[str, float]:
    """Draw a point of a box; three coordinates of ten are at a bound."""
    shares = random.random(len(axes))
    shares = np.where(random.random(len(axes)) < 0.3, np.rint(shares), shares)
    return {axis.name: axis.value(share) for axis, share in zip(axes, shares.tolist(), strict=True)}


def by_attack(found: Sequence[tuple[Attack, tuple[Hostile, ...]]]) -> Iterable[str]:
    """Return the table of the hostile runs, and the worst of each kind."""
    rows, worst = [], []
    for steps in (FEW_STEPS, MOST_STEPS):
        for how in HOW:
            runs = [
                run
                for case, some in found
                if case[:2] == (how, steps)
                for run in some
                if run.energies
            ]
            energies = np.array([energy for run in runs for energy in run.energies])
            if not energies.size:
                continue
            above = int(np.count_nonzero(energies > MOST_J))
            small = int(np.count_nonzero(energies > 0.1 * MOST_J))
            rows.append(
                (
                    how,
                    f"0 to {steps}",
                    str(len(runs)),
                    str(energies.size),
                    few(small, energies.size) if how == HOW[0] else str(small),
                    few(above, energies.size) if how == HOW[0] else str(above),
                    f"{1e3 * energies.max():.2f}",
                )
            )
            one = max(runs, key=lambda run: run.largest)
            worst.append(f"- {how}, 0 to {steps}: `{' '.join(_short(each) for each in one.worst)}`")
    yield from table(_HOSTILE, *rows)
    yield ""
    yield "The worst of each row:"
    yield ""
    yield from worst


def _short(setting: str) -> str:
    """Return a setting with its number in four digits."""
    name, sign, value = setting.partition("=")
    try:
        return f"{name}{sign}{float(value):.4g}"
    except ValueError:
        return setting


_HOSTILE = (
    "how",
    "delays [periods]",
    "runs",
    "changes made",
    "above 0.1 mJ",
    "above 1 mJ",
    "largest energy [mJ]",
)


STUDY = Study(
    "evidence/changes-check.md",
    (
        Part("changes", benches, tried, by_kind, case_s=4.0, wanted=harmless),
        Part("hostile", attacks, attack, by_attack, case_s=40.0),
    ),
    (
        Option("runs", 13, "runs of each servo and hand", quick=1),
        Option("drawn", 100, "hostile runs drawn, for each range of delays", quick=20),
        Option("searches", 1, "searches, for each range of delays", quick=1),
        Option("generations", 4, "generations of each search", quick=1),
    ),
    everywhere=True,
)
