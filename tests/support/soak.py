"""A driver on the simulated clock in damaged replies, with each cycle set against what was done.

Every run with the same seed is the same.
"""

import math
import time
from collections import Counter
from dataclasses import asdict, dataclass, field

from scipy.stats import binom

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.servo import DynamixelServo
from haptic_wall.hw.dynamixel.tables import MODELS, POSITION_UNIT
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.damage import Passage
from haptic_wall.hw.emulated.injection import Faults
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.servo import Outcome
from haptic_wall.hw.settings import DriverSettings, TrueServo

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
"""Results that a cycle may have whose reply was struck so, beside undetected damage"""
PERIOD_NS = 1_000_000
COLLECT_NS = 800_000
MAX_SPEED = 15.0
TRUE = TrueServo(inertia=0.011951, damping=0.011692, coulomb=0.09039)
SETTINGS = DriverSettings(
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
    """Results of the cycles."""

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
    found.counts = asdict(servo.bus.counts)
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
    # A reply that has only begun is lost for its cycle; that it was cut short shows a cycle later.
    cut = by_outcome["LOST"] - counts["lost"]
    begun = sum(
        count
        for (kind, outcome), count in found.outcomes.items()
        if outcome == "LOST" and kind in ("truncate", "corrupt", "several")
    )
    if not 0 <= cut <= begun:
        problems.append(f"{by_outcome['LOST']} cycles lost, counted {counts['lost']}")
    for name, moved in (("corrupt", cut), ("refused", 0)):
        if counts[name] != by_outcome[name.upper()] + moved:
            problems.append(f"{by_outcome[name.upper()]} cycles {name}, counted {counts[name]}")
    if cut < found.outcomes["truncate", "LOST"] // 2:
        problems.append(f"{found.outcomes['truncate', 'LOST']} cut short, counted {cut}")
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
