"""The page that says what chaos did: faults and what followed, and the promises with figures."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

from scripts.chaos.faults import CORE_HELD, FAULTS
from scripts.chaos.judge import MACHINE, REFUSED, STRANGERS, Stall
from scripts.chaos.run import ASKED, Run
from scripts.chaos.verdict import growth

FLAT_MB = 5.0
OFF_MS = 60.0
"""From the death or the stop of a loop to no torque, or from when nothing below runs on its core"""
AT_ONCE = (
    "loop killed",
    "supervisor killed",
    "supervisor and loop killed",
    "loop stopped for 0.1 to 1 s",
    CORE_HELD,
)
"""The faults that this is promised for"""
WATCHED = ("emulator", "loop", "recorder", "supervisor")
"""Processes whose memory is watched"""


@dataclass(slots=True)
class Hour:
    """All runs of one hour of chaos."""

    minutes: float
    seed: int
    runs: list[Run] = field(default_factory=list)
    stalls: list[Stall] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    """Faults that are not permitted here"""
    room: bool = False
    """The log lay on a small file system of its own"""
    whole: bool = False

    def add(self, run: Run, stalls: Sequence[Stall]) -> None:
        """Take in a run that was judged, with what its observers saw."""
        self.runs.append(run)
        self.stalls += stalls

    @property
    def unexplained(self) -> list[Run]:
        """Runs whose end nothing explains."""
        return [run for run in self.runs if run.cause is None]

    @property
    def growth_mb(self) -> dict[str, float]:
        """The most that each kind of process has grown, over the runs that are long enough [MB]."""
        most: dict[str, float] = {}
        for run in self.runs:
            for name, mb in growth(run).items():
                most[name] = max(most.get(name, mb), mb)
        return most

    @property
    def off_late(self) -> list[float]:
        """Times to no torque that are over what is promised [ms]."""
        return [ms for name in AT_ONCE for ms in self.off_ms(name) if ms > OFF_MS]

    def off_ms(self, name: str) -> list[float]:
        """From faults of one kind to no torque [ms]."""
        return [1e3 * run.off_s for run in self.runs if run.cause == name and run.off_s is not None]

    @property
    def broken(self) -> list[str]:
        """Every promise that did not hold, in words."""
        words = [
            f"run {number} ended by {run.reason}, which nothing explains"
            for number, run in enumerate(self.runs, 1)
            if run.cause is None
        ]
        words += [
            f"run {number} ({run.reason}): {problem}"
            for number, run in enumerate(self.runs, 1)
            for problem in run.problems
        ]
        words += [f"{ms:.0f} ms from a fault at the loop to no torque" for ms in self.off_late]
        words += [
            f"the {name} grew by {mb:.1f} MB" for name, mb in self.growth_mb.items() if mb > FLAT_MB
        ]
        return words


def lines(hour: Hour) -> list[str]:
    """The promises, what was injected and what followed, and what else is to be said."""
    faults = sum(len(run.injected) for run in hour.runs)
    partial = "" if hour.whole else "**It was broken off; this is what there was until then.** "
    return [
        f"{partial}{hour.minutes:g} min, seed {hour.seed}: {len(hour.runs)} runs, {faults} faults,"
        f" {sum(run.rows for run in hour.runs)} ticks in the logs.",
        "",
        *_promises(hour),
        "",
        "| fault | injected | ended a run | by | torque off, ms |",
        "|---|---|---|---|---|",
        *_faults(hour),
        "",
        *_notes(hour)[:-1],
    ]


def _promises(hour: Hour) -> list[str]:
    runs, grown = hour.runs, hour.growth_mb
    witnessed = [run for run in runs if run.witnessed]
    causes = Counter(run.cause for run in runs)
    after = sum(len(run.torque_problems) for run in runs)
    memory = ", ".join(
        f"{name} {grown[name]:+.1f} MB" if name in grown else f"no {name} was watched long enough"
        for name in WATCHED
    )
    flat = all(mb <= FLAT_MB for mb in grown.values())
    off = [ms for name in AT_ONCE for ms in hour.off_ms(name)]
    longest = f"{len(off)} times, {max(off):.0f} ms at most" if off else "not seen"
    explained = len(runs) - sum(causes[each] for each in (None, MACHINE, STRANGERS, REFUSED, ASKED))
    return [
        "| promise | found | holds |",
        "|---|---|---|",
        f"| no torque after a trip | {len(witnessed)} ends witnessed; torque or torque commands"
        f" after the cut: {after} | {_holds(not after)} |",
        f"| a dead, stopped or starved loop's torque is gone within {OFF_MS:.0f} ms | {longest}"
        f" | {_holds(not hour.off_late)} |",
        f"| no unexplained stop | {explained} by a fault, {causes[ASKED]} on request,"
        f" {causes[MACHINE]} by an observed stall of the machine, {causes[STRANGERS]} while other"
        f" programs ran at real-time priority, {causes[REFUSED]} refused to start with a reason,"
        f" {causes[None]} unexplained"
        f" | {_holds(not causes[None])} |",
        f"| no lost log block | {sum(run.goals for run in runs)} torques witnessed,"
        f" {sum(run.rows for run in runs)} rows; lost and reported:"
        f" {sum(run.lost for run in runs)}; runs with unreported losses:"
        f" {sum(bool(run.log_problems) for run in runs)}"
        f" | {_holds(not any(run.log_problems for run in runs))} |",
        f"| memory flat within {FLAT_MB:g} MB | largest growth of a process from its second"
        " minute to its last, without the shared ring of rows:"
        f" {memory if grown else 'no run was long enough'}"
        f" | {'–' if flat and len(grown) < len(WATCHED) else _holds(flat)} |",
        "| nothing left behind | processes that outlived their run, runs that did not end:"
        f" {sum(len(run.other_problems) for run in runs)}"
        f" | {_holds(not any(run.other_problems for run in runs))} |",
        *(f"\n- Did not hold: {words}" for words in hour.broken),
    ]


def _holds(holds: bool) -> str:
    return "yes" if holds else "**no**"


def _faults(hour: Hour) -> list[str]:
    injected = Counter(fault.name for run in hour.runs for fault in run.injected)
    ends: dict[str | None, Counter[str]] = defaultdict(Counter)
    for run in hour.runs:
        ends[run.cause][run.reason] += 1
    rows = []
    for name in (*(fault.name for fault in FAULTS), ASKED, MACHINE, STRANGERS):
        times = "–" if name in (MACHINE, STRANGERS) else str(injected[name])
        if not injected[name] and not ends[name]:
            continue
        by = ", ".join(f"{reason} {count}" for reason, count in ends[name].most_common())
        off = hour.off_ms(name)
        took = f"{median(off):.0f}, {max(off):.0f}" if off else "–"
        rows.append(f"| {name} | {times} | {ends[name].total()} | {by or '–'} | {took} |")
    return rows


def _notes(hour: Hour) -> list[str]:
    notes = []
    if hour.left_out:
        notes.append(f"Not permitted or not asked for here: {', '.join(hour.left_out)}.")
    notes.append(
        "The disk was full because its file system was filled."
        if hour.room
        else "The disk was full because the recorder's files were not allowed to grow."
    )
    notes.append(
        "A supervisor is killed only while a recorder lives, because with both dead nothing writes"
        " the waiting rows."
    )
    lengths = [1e3 * (stall.until_s - stall.from_s) for stall in hour.stalls]
    worst = f", the longest {max(lengths):.0f} ms" if lengths else ""
    notes.append(
        f"Stalls of the machine of more than 10 ms during the runs, on either core:"
        f" {len(lengths)}{worst}."
    )
    busy = sum(bool(run.strangers) for run in hour.runs)
    if busy:
        notes.append(
            f"In {busy} runs other programs ran at real-time priority; at the loop's own they"
            " can keep it waiting, which the observers, above it, do not see."
        )
    for number, run in enumerate(hour.runs, 1):
        if run.cause == REFUSED:
            notes.append(f"Run {number} {run.reason}")
    gone = sum(not run.witnessed for run in hour.runs)
    if gone:
        notes.append(f"In {gone} runs the bus was killed, and its record ends with it.")
    lacks = sorted({text for run in hour.runs for text in run.warnings if "it lacks" in text})
    if lacks:
        notes.append(f"A message about an incomplete log, of {len(lacks)}: {lacks[0]}.")
    return [line for note in notes for line in (note, "")]
