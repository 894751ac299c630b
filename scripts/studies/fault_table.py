"""Injects every fault of bus and servo into a session of the whole program.

    scripts/study fault_table

In memory, on the simulated clock: the same on every machine, and a test holds the page to that.
"""

import itertools
from functools import cache

import numpy as np

from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.theory.checks import IntArray
from haptic_wall.hw.servo import Outcome
from scripts.study import Part, Study, table_of
from tests.support.memory_session import LIMITS_OF_HARDWARE, MemorySession, run_in_memory

SETTINGS = (*LIMITS_OF_HARDWARE, "servo.hand=lean", "servo.kick=-0.5", "loop.warm_up_s=0.1")
"""With a hand that swings the servo into the wall and leans on it"""
AT_S = 0.9005
"""When the fault comes, after torque on: the shaft moves into the wall, and the next tick is half a
period away"""
DURATION_S = 1.05
PERIOD_NS = 1_000_000
IN_TICK = ("overspeed", "losses_in_row", "loss_rate", "hardware_error", "not_a_number")
"""Trips whose own tick has a row"""
FAULTS = (
    ("one reply is lost", "drop:times=1,way=reply"),
    ("one request is lost", "drop:times=1,way=request"),
    ("one torque is lost", "drop:every=2,times=1,way=request"),
    ("one reply is broken", "corrupt:flips=3,times=1,way=reply"),
    ("one request is broken", "corrupt:flips=3,times=1,way=request"),
    ("one reply is cut short", "truncate:keep=12,times=1,way=reply"),
    ("one reply comes twice", "duplicate:times=1,way=reply"),
    ("one reply comes a period late", "late:ms=1,times=1,way=reply"),
    ("one reply bears another id", "wrong-id:times=1,way=reply"),
    ("noise before one reply", "noise:times=1,way=reply"),
    ("no replies for 8 ms", "drop:for=0.008,way=reply"),
    ("no replies", "drop:way=reply"),
    ("one reply in five is lost", "drop:p=0.2,way=reply"),
    ("every reply comes too late", "late:ms=1.5,way=reply"),
    ("the encoder stands still for 20 ms", "stuck:for=0.02"),
    ("the encoder stands still", "stuck"),
    ("the encoder jumps for 2 ms", "jump:counts=500,for=0.0022"),
    ("the encoder jumps", "jump:counts=500"),
    ("overload is latched", "hardware-error:bits=overload"),
    ("overheating is latched", "hardware-error:bits=overheating"),
    ("the supply breaks down for a moment", "brown-out"),
    ("the servo is unplugged", "unplug"),
    ("the servo is unplugged for 3 ms", "unplug:for=0.003"),
    ("the adapter is unplugged", "unplug-adapter"),
)


def session(spec: str | None) -> MemorySession:
    """The session with one fault, or with none."""
    faults = [] if spec is None else [_at(spec)]
    return run_in_memory(SETTINGS, DURATION_S, faults=faults)


def _at(spec: str) -> str:
    return f"{spec}{',' if ':' in spec else ':'}at={AT_S}"


@cache
def calm() -> dict[int, float]:
    """The torque of a run without any fault."""
    return true_torque(session(None))


def line(fault: tuple[str, str]) -> list[str]:
    """Describe the effect of one fault, beside a run without any."""
    name, spec = fault
    found = session(spec)
    struck_ns = found.given_ns + round(AT_S * 1e9)
    reason = found.result.stop_reason
    counts = found.result.bus or {}
    counted = ", ".join(
        f"{key} {counts[key]}" for key in ("lost", "corrupt", "late", "refused") if counts.get(key)
    )
    ticks = found.ticks
    if not isinstance(reason, Trip):
        after = ticks[ticks["deadline_ns"] >= struck_ns - PERIOD_NS]
        outcome: IntArray = after["outcome"]
        failed = int(np.count_nonzero(outcome != Outcome.OK))
        did = f"goes on; {counted}" if counted else "goes on; nothing is counted"
        periods = f"{failed} without a sample"
        return [name, f"`{spec}`", did, periods, difference(found, calm())]
    trip = reason.label
    ended_ns = int(ticks["deadline_ns"][-1]) + (0 if trip in IN_TICK else PERIOD_NS)
    lasted = -((struck_ns - ended_ns) // PERIOD_NS)
    read_back = "torque off read back" if found.result.torque_off else "torque off not read back"
    link = f"trips: [{trip}](../reference/trips.md), {read_back}"
    did = f"{link}; {counted}" if counted else link
    return [name, f"`{spec}`", did, f"{max(0, lasted)}", ending(found, struck_ns)]


def true_torque(found: MemorySession) -> dict[int, float]:
    """The torque that acts [N·m], by instant [ns], every millisecond."""
    return {row.time_ns: row.state.torque for row in found.truth if row.event == "state"}


def difference(found: MemorySession, calm: dict[int, float]) -> str:
    """How far the true torque went from that of the run without faults, while the wall was on."""
    end_ns = int(found.ticks["deadline_ns"][-1])
    torque = true_torque(found)
    most = max(abs(torque[at] - calm[at]) for at in torque if at <= end_ns)
    if not most:
        return "as without the fault"
    return f"at most {most:.3f} N·m from a run without the fault"


def ending(found: MemorySession, struck_ns: int) -> str:
    """From the fault to no torque, by the witness."""
    before = [row for row in found.truth if row.time_ns < struck_ns][-1].state.torque
    backwards = reversed(found.truth)
    still = list(itertools.takewhile(lambda row: row.state.torque == 0.0, backwards))
    if not still:
        return f"from {before:.2f} N·m: it stayed on"
    return f"from {before:.2f} N·m to 0 after {(still[-1].time_ns - struck_ns) * 1e-6:.1f} ms"


STUDY = Study(
    "evidence/fault-table.md",
    (
        Part(
            "faults",
            lambda _: FAULTS,
            line,
            table_of("fault|`--fault`|answer|periods|torque"),
            case_s=0.4,
        ),
    ),
    everywhere=True,
)
