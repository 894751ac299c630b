"""Leaves out each criterion and number of the detector; writes docs/evidence/leave-out.md.

    scripts/study leave_out [--only PART ...] [--cases N] [--quick] [--rows FILE [--known]]

The cases are fixed: scripts/studies/leave_out_cases.jsonl holds walls and hands of the detector's
table, those found to go wrong first of all. Every case first runs with numbers that note in which
range of theirs the run stays the same to the bit; it runs again only for values outside.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
from pydantic import TypeAdapter

from haptic_wall.controller.detector.detection import detect
from haptic_wall.controller.detector.oscillation import DetectorSettings
from haptic_wall.controller.detector.servo_fit import fitted_servo
from haptic_wall.controller.detector.tuning import ANY, MANY, TUNING, Origin, Tuning
from haptic_wall.controller.detector.wall_fit import fitted_wall
from haptic_wall.controller.experiments.maps.walls import Walls
from haptic_wall.controller.theory.checks import FloatArray
from scripts.asked_numbers import Asked, asked_tuning
from scripts.study import ROOT, Found, Option, Part, Study, table
from scripts.trials.cases import LAGS, PRESETS, Case
from scripts.trials.detector_trials import Drawn, draw_held, draw_kicked, kick_trial, kicked_at
from scripts.trials.hands import HANDS, draw_hands, handled
from scripts.trials.listening import COUNT, PERIOD, listen
from scripts.trials.real_rows import draw_real_hand, draw_real_wall
from scripts.trials.small_cycles import settled
from scripts.trials.verdicts import answered, goes_on_by_itself
from scripts.trials.watched import Trace

CASES = ROOT / "scripts" / "studies" / "leave_out_cases.jsonl"
FACTOR = 1.5
HEAD = ("cases", "ran", "differ", "worse", "better")
NEAR = 0.1
"""A ratio this near to 1 has its distance from 1 scaled"""
SEED, KICKED, SHARES = 36, 10, (0.6, 1.2, 2.0)
"""Of what the belief's detector hears: number of kicked walls, and K over their limit"""
HELD, HELD_S = 2, 10.0
"""Walls for each hand that it hears, and their length [s]"""
EACH, LONGEST_S, MOST = 6, 25.0, 12
"""For single numbers: cases of each kind, their greatest length [s], and runs with each value"""
REAL_WALLS, REAL_HAND_S = 2, 12.0
"""Walls that oscillate on each servo with every effect, and the length of a trial with an operator
there [s]"""
HEARD = ("belief", "streaks", "energy", "recording")
"""Groups of the detector that knows the believed servo: its alarm is only a suspicion in a run, so
that recorded motions tell more of them"""
EVERY = tuple(group.name for group in fields(TUNING))

Numbers = Mapping[str, object]
"""Values by ``group.name``"""
Tries = dict[str, Numbers]
"""Numbers that are changed together, by a name"""

CRITERIA: Tries = {
    "probes of regular and of suspected motion": {
        "backstop.large_counts": 1e9,
        "backstop.small_counts": 1e9,
    },
    "the believed servo's suspicion": {"belief.alarm_counts": ANY, "energy.clear": ANY},
    "motion beyond hands": {
        "evidence.hands_hz": ANY,
        "evidence.hands_acceleration": ANY,
        "evidence.hands_power": ANY,
    },
    "ripples": {"half_cycles.ripple": 0.0, "half_cycles.coarse_half_cycles": 0},
    "contacts that throw the shaft back": {
        "backstop.throws": MANY,
        "backstop.throws_loaded": MANY,
    },
    "a load on its transmission": {"probe.load_size": ANY},
    "two unsure answers alike": {"probe.unsure_shortest": ANY},
    "a hand after all, on the reduced wall": {
        "backstop.hand_shortest": ANY,
        "backstop.hand_half_cycles": MANY,
    },
    "the wall's motion without doubt, on the reduced wall": {
        "backstop.own_first": ANY,
        "backstop.own_second": ANY,
        "backstop.own_third": ANY,
    },
    "the end after so many cycles": {"backstop.hurry": ANY},
    "no probe of what a hand has just done": {"backstop.held_off_s": 0.0},
}
"""Whole criteria, and the numbers with which they have no effect"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a case."""

    label: str
    rank: int
    """0 is best"""
    figures: str
    """Digest of all its figures"""


@dataclass(frozen=True, slots=True)
class Row:
    """A case with some of the detector's numbers changed, one after the other."""

    plain: Outcome
    """As the detector is"""
    asked: list[str]
    """Numbers that the case compares or computes with"""
    may: list[str]
    """Tries that may change it; all others leave every bit of it the same"""
    changed: dict[str, Outcome]
    """Of those that ran, the ones that did change it"""


@dataclass(frozen=True, slots=True)
class Felt:
    """The results of some cases with another value of one number."""

    may: int
    """Cases that the value may change"""
    ran: int
    """Of those, how many ran: until an answer changed, at most ``MOST``"""
    differ: int
    """Of those, how many have other figures"""
    change: str
    """The answer that changed; empty: none"""
    worse: bool = False


def varied(numbers: Numbers) -> Tuning:
    """Return the tuning with some other values."""
    tuning = TUNING
    for name, value in numbers.items():
        group, one = name.split(".")
        changed = replace(getattr(tuning, group), **{one: value})
        tuning = replace(tuning, **{group: changed})
    return tuning


def _of_group(group: str) -> Iterator[tuple[str, object, Origin]]:
    numbers = getattr(TUNING, group)
    for one in fields(numbers):
        yield one.name, getattr(numbers, one.name), one.metadata["origin"]


def without(group: str) -> Tries:
    """Return values that leave a criterion out, for each number of a group that has such a one."""
    tries: Tries = {}
    for name, value, origin in _of_group(group):
        number = f"{group}.{name}"
        if origin.off is not None:
            tries[number] = {number: origin.off}
        elif isinstance(value, tuple):
            for i, rule in enumerate(value):
                tries[f"{number} {rule}"] = {number: (*value[:i], *value[i + 1 :])}
    return tries


def scaled(group: str) -> Tries:
    """Return each number of a group, a third smaller and a half larger."""
    tries: Tries = {}
    for name, value, _ in _of_group(group):
        number = f"{group}.{name}"
        for sign, factor in (("/", 1.0 / FACTOR), ("×", FACTOR)):
            other = _times(value, factor)
            if other != value:
                tries[f"{number} {sign} {FACTOR:g}"] = {number: other}
    return tries


def _times(value: object, factor: float) -> object:
    if isinstance(value, tuple):
        return tuple((count, factor * growth) for count, growth in value)
    if isinstance(value, int):
        return max(1, round(factor * value))
    assert isinstance(value, float)
    if 0.0 < abs(value - 1.0) <= NEAR:
        return 1.0 + factor * (value - 1.0)
    return factor * value


@cache
def table_cases() -> dict[str, tuple[str, Case]]:
    """Return kind and case of each line of the file, by a name that its text gives it."""
    kind = TypeAdapter(Case)
    found = {}
    for line in CASES.read_text(encoding="utf-8").splitlines():
        one = json.loads(line)
        name = f"{one['kind']}-{hashlib.sha256(line.encode()).hexdigest()[:8]}"
        found[name] = one["kind"], kind.validate_python(one["case"])
    return found


def whole_names(most: int, longest_s: float = math.inf) -> list[str]:
    """Return names of whole runs, the kinds in turn; ``most``: of each kind."""
    kinds: dict[str, list[str]] = {}
    for name, (kind, case) in table_cases().items():
        if case.duration_s <= longest_s:
            kinds.setdefault(kind, []).append(name)
    places = sorted(
        ((i + 0.5) / len(names), name)
        for names in (every[:most] for every in kinds.values())
        for i, name in enumerate(names)
    )
    return [name for _, name in places]


def heard_names(most: int) -> list[str]:
    """Return names of recorded motions; ``most``: of each kind."""
    kicks = [f"kicks {share} {i}" for i in range(KICKED) for share in range(len(SHARES))]
    held = [f"held {hand} {i}" for hand in range(len(HANDS)) for i in range(HELD)]
    recordings = [f"recordings {len(SHARES) - 1} {i}" for i in range(KICKED)]
    return [*kicks[:most], *held[:most], *recordings[:most]]


def real_names(most: int) -> list[str]:
    """Return names of walls and hands on servos with every effect; ``most``: of each kind."""
    servos = range(len(PRESETS))
    walls = [f"real-walls {i} {n}" for n in range(REAL_WALLS) for i in servos]
    hands = [f"real-hands {i} {n}" for n in range(len(HANDS)) for i in servos]
    return [*walls[:most], *hands[:most]]


def outcome(name: str, tuning: Tuning) -> Outcome:
    """Run a case and judge it."""
    if name in table_cases():
        kind, case = table_cases()[name]
        return _JUDGES[kind](case, tuning)
    kind, *numbers = name.split()
    return _JUDGES[kind](*map(int, numbers), tuning)


def _outcome(labels: Sequence[tuple[str, bool]], figures: object) -> Outcome:
    """Return the first label that holds; labels begin with the worst."""
    digest = hashlib.sha256(repr(figures).encode()).hexdigest()[:12]
    for i, (label, holds) in enumerate(labels):
        if holds:
            return Outcome(label, len(labels) - 1 - i, digest)
    raise AssertionError("the last label always holds")


def _wall(case: Case, tuning: Tuning) -> Outcome:
    found = answered(case, tuning)
    labels = [
        ("unseen", found.unseen),
        ("never ends", found.never),
        ("late", not found.in_time),
        ("in time, by a trip", found.trip is not None),
        ("in time", True),
    ]
    return _outcome(labels, replace(found, case=case))


def _small_cycle(case: Case, tuning: Tuning) -> Outcome:
    found = settled(case, tuning)
    labels = [
        ("unseen", found.unseen),
        ("a trip", found.trip is not None),
        ("goes on", not found.settled),
        ("settles, not named", not found.named),
        ("settles", True),
    ]
    return _outcome(labels, replace(found, case=case))


def _hand(case: Case, tuning: Tuning) -> Outcome:
    trial = case.run(tuning=tuning)
    probes, _, softened, _ = trial.counts
    labels = [
        ("a trip", trial.trip is not None),
        ("softened", softened > 0),
        ("suspected", trial.taken_back > 0),
        ("probed", probes > 0),
        ("left alone", True),
    ]
    rows = trial.stiffness.tobytes() + trial.state.tobytes() + trial.output.tobytes()
    return _outcome(labels, (trial.counts, trial.taken_back, hashlib.sha256(rows).hexdigest()))


@cache
def _kicked() -> tuple[Drawn, list[tuple[Walls, FloatArray, list[Trace]]]]:
    drawn = draw_kicked(KICKED, np.random.default_rng(SEED))
    return drawn, [kicked_at(drawn, share) for share in SHARES]


@cache
def _held(hand: int) -> tuple[Drawn, list[Trace]]:
    random = np.random.default_rng((SEED, hand))
    drawn = draw_held(HELD, random)
    hands = draw_hands(drawn.walls, HANDS[hand], round(HELD_S / PERIOD), random)
    return drawn, handled(drawn.walls, hands)


def _kick(share: int, i: int, tuning: Tuning) -> Outcome:
    drawn, shares = _kicked()
    walls, start, traces = shares[share]
    heard = listen(walls, i, traces[i], drawn.belief[i], once=True, tuning=tuning)
    trial = kick_trial("", SHARES[share], walls, i, float(start[i]), traces[i], heard.alarms)
    if trial.lasts:
        labels = [("no alarm", not trial.alarm), ("late alarm", not trial.early), ("alarm", True)]
    else:
        labels = [("false alarm", trial.alarm), ("no alarm, it dies", True)]
    return _outcome(labels, (heard.alarms, heard.small))


def _heard(hand: int, i: int, tuning: Tuning) -> Outcome:
    drawn, traces = _held(hand)
    heard = listen(drawn.walls, i, traces[i], drawn.belief[i], once=False, tuning=tuning)
    labels = [("alarm", bool(heard.alarms)), ("sustained", bool(heard.small)), ("quiet", True)]
    return _outcome(labels, (heard.alarms, heard.small))


def _recording(share: int, i: int, tuning: Tuning) -> Outcome:
    trace = _kicked()[1][share][2][i]
    positions = np.asarray(trace.counts * COUNT, dtype=np.float64)
    wall = fitted_wall(positions, trace.torque, PERIOD, tuning.recording)
    servo = fitted_servo(positions, trace.torque, PERIOD, tuning.recording)
    settings, lag = DetectorSettings(PERIOD, tuning=tuning), 0.0
    if servo is not None:
        settings, lag = (
            replace(settings, inertia=servo.inertia, damping=servo.damping(servo.lag())),
            servo.lag(),
        )
    times = np.arange(positions.size, dtype=np.float64) * PERIOD
    record = detect(times, positions, trace.torque, settings, lag=lag, wall=wall)
    labels = [
        ("no alarm", math.isnan(record.first_alarm_s)),
        ("no servo found", servo is None),
        ("no wall found", wall is None),
        ("alarm", True),
    ]
    return _outcome(labels, (record.first_alarm_s, record.worst))


@cache
def _real_case(preset: int, n: int, kind: str) -> Case:
    random = np.random.default_rng((SEED, preset, n, len(kind)))
    if kind == "hand":
        return draw_real_hand(PRESETS[preset], HANDS[n], REAL_HAND_S, random)
    while True:
        case = draw_real_wall(PRESETS[preset], len(LAGS) - 1, random)
        if goes_on_by_itself(case):
            return case


def _real_wall(preset: int, n: int, tuning: Tuning) -> Outcome:
    return _wall(_real_case(preset, n, "walls"), tuning)


def _real_hand(preset: int, n: int, tuning: Tuning) -> Outcome:
    return _hand(_real_case(preset, n, "hand"), tuning)


_JUDGES: dict[str, Callable[..., Outcome]] = {
    "walls": _wall,
    "bounces": _wall,
    "backlash": _small_cycle,
    "hands": _hand,
    "kicks": _kick,
    "held": _heard,
    "recordings": _recording,
    "real-walls": _real_wall,
    "real-hands": _real_hand,
}


@cache
def as_it_is(name: str) -> tuple[Outcome, dict[str, Asked]]:
    """Run a case with the detector's numbers; return in which range of each it stays the same."""
    tuning, notes = asked_tuning()
    return outcome(name, tuning), notes


def _may(notes: Mapping[str, Asked], numbers: Numbers) -> bool:
    return any(
        notes[number].used and not notes[number].allows(value) for number, value in numbers.items()
    )


def _changed(name: str, numbers: Numbers) -> Outcome:
    try:
        return outcome(name, varied(numbers))
    except (ArithmeticError, ValueError) as error:
        return Outcome(f"cannot run: {error}", 9, "")


def without_criteria(name: str) -> Row:
    """Run a case without each criterion, and note which single numbers may change it."""
    plain, notes = as_it_is(name)
    found = {
        title: _changed(name, numbers)
        for title, numbers in CRITERIA.items()
        if _may(notes, numbers)
    }
    changed = {title: other for title, other in found.items() if other != plain}
    singles = {title: numbers for group in EVERY for title, numbers in tries_of(group).items()}
    may = [title for title, numbers in (CRITERIA | singles).items() if _may(notes, numbers)]
    return Row(plain, [name for name, one in notes.items() if one.used], may, changed)


def tries_of(group: str) -> Tries:
    """Return each number of a group left out, smaller and larger."""
    return without(group) | scaled(group)


def names_of(number: str) -> list[str]:
    """Return names of the cases that a single number is tried on."""
    if number.partition(".")[0] in HEARD:
        return heard_names(EACH)
    return whole_names(EACH, LONGEST_S)


def with_other_values(number: str) -> dict[str, Felt]:
    """Run some cases with each other value of a number, until an answer changes."""
    tries = tries_of(number.partition(".")[0])
    return {
        title: _felt_by(names_of(number), numbers)
        for title, numbers in tries.items()
        if number in numbers
    }


def _felt_by(names: Sequence[str], numbers: Numbers) -> Felt:
    may = [name for name in names if _may(as_it_is(name)[1], numbers)]
    differ = 0
    for ran, name in enumerate(may[:MOST], 1):
        plain, other = as_it_is(name)[0], _changed(name, numbers)
        differ += other != plain
        if other.label != plain.label:
            change = f"{_kind(name)}: {plain.label} → {other.label}"
            return Felt(len(may), ran, differ, change, other.rank > plain.rank)
    return Felt(len(may), min(len(may), MOST), differ, "")


def numbers_lines(found: Found[str, dict[str, Felt]]) -> Iterator[str]:
    """Yield the text on single numbers: a row for each answer that changes, then the others."""
    if not found:
        yield "Not run."
        return
    felt = [(title, one) for _, tries in found for title, one in tries.items()]
    changes = [
        (f"`{title}`", one.may, one.ran, *(("", one.change) if one.worse else (one.change, "")))
        for title, one in felt
        if one.change
    ]
    yield f"{len(found)} numbers with {len(felt)} other values; an answer changes with"
    yield f"{len(changes)} of them."
    yield ""
    yield from table(("with", "may", "ran", "better", "worse"), *changes)
    yield ""
    figures = sum(bool(one.differ and not one.change) for _, one in felt)
    nothing = sum(bool(one.may and not one.differ) for _, one in felt)
    never = [number for number, tries in found if not any(one.may for one in tries.values())]
    yield f"Of the other values {figures} change figures, but no answer; {nothing} change nothing;"
    yield f"{len(felt) - len(changes) - figures - nothing} can change no case. With every value:"
    yield f"{', '.join(f'`{number}`' for number in never) or 'none'}."


def criteria_lines(found: Found[str, Row]) -> Iterator[str]:
    """Yield the text on whole criteria, and on what no single number can change."""
    if not found:
        yield "Not run."
        return
    yield from _lines(found, len(table_cases()))
    yield "Every number may change a case if it is left out, divided or multiplied by"
    yield f"{FACTOR:g}, except for these, in brackets how many cases ask for it:"
    unfelt = []
    for group in EVERY:
        for name, _, _ in _of_group(group):
            number = f"{group}.{name}"
            ends = ("", f" / {FACTOR:g}", f" × {FACTOR:g}")
            asked = sum(number in row.asked for _, row in found)
            if not any(_felt(found, number, end) for end in ends):
                unfelt.append(f"`{number}` ({asked})")
    yield f"{', '.join(unfelt) or 'none'}."


def _felt(found: Found[str, Row], number: str, end: str) -> int | str:
    """Return how many cases may change with a number; without an end: with it left out."""
    group = number.partition(".")[0]
    tries = {f"{number}{end}"} & scaled(group).keys() if end else without(group).keys()
    mine = {title for title in tries if title.partition(" ")[0] == number}
    return sum(not mine.isdisjoint(row.may) for _, row in found) if mine else ""


def _lines(found: Found[str, Row], whole: int) -> Iterator[str]:
    """Yield what was run, a table of the criteria, and those that leave no trace."""
    labels = Counter(f"{_kind(name)}: {row.plain.label}" for name, row in found)
    yield f"{len(found)} of {whole} cases; as the detector is: {_counted(labels)}."
    yield ""
    lines, silent = [], []
    for title in CRITERIA:
        ran = sum(title in row.may for _, row in found)
        changes = [(name, row.plain, row.changed.get(title)) for name, row in found]
        others = [(name, old, new) for name, old, new in changes if new is not None]
        ways = [_counted(_ways(others, worse=worse)) for worse in (True, False)]
        if others:
            lines.append((title, len(found), ran, len(others), *ways))
        else:
            silent.append(f"{title} ({ran} of {len(found)})")
    yield from table(("without", *HEAD), *lines)
    yield ""
    yield f"No case differs, in brackets how many ran: {', '.join(silent) or 'none'}."
    yield ""


def _kind(name: str) -> str:
    return name.replace("-", " ").split()[0]


def _ways(others: Sequence[tuple[str, Outcome, Outcome]], *, worse: bool) -> Counter[str]:
    return Counter(
        f"{_kind(name)}: {old.label} → {new.label}"
        for name, old, new in others
        if (new.rank > old.rank if worse else new.rank < old.rank)
    )


def _counted(some: Counter[str]) -> str:
    ordered = sorted(some.items(), key=lambda one: (-one[1], one[0]))
    return "; ".join(f"{count} {what}" for what, count in ordered)


STUDY = Study(
    "evidence/leave-out.md",
    (
        Part(
            "criteria",
            lambda given: whole_names(given.cases),
            without_criteria,
            criteria_lines,
            case_s=4.0,
        ),
        Part(
            "real",
            lambda given: real_names(given.cases),
            without_criteria,
            lambda found: list(_lines(found, len(real_names(MANY)))),
            case_s=25.0,
        ),
        Part(
            "numbers",
            lambda given: [
                f"{group}.{one.name}" for group in EVERY for one in fields(getattr(TUNING, group))
            ][:: max(1, given.every)],
            with_other_values,
            numbers_lines,
            case_s=8.0,
        ),
    ),
    (
        Option("cases", 1000, "cases of each kind at most, for whole criteria", quick=1),
        Option("every", 1, "try only every n-th of the single numbers", quick=20),
    ),
)
