"""Rehearses every fault of bus and servo with the whole program, and writes docs/fault-table.md.

    scripts/fault_table [--out FILE]

In memory, on the simulated clock: the page is the same every time, and a test holds it to that.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.hw.servo import Outcome
from scripts.rehearsal import LIMITS_OF_HARDWARE, Rehearsed, rehearse
from scripts.whole_program import measured_on, page_options, say_time

SETTINGS = (*LIMITS_OF_HARDWARE, "servo.hand=lean", "servo.kick=-0.5", "loop.warm_up_s=0.1")
"""With a hand that swings the servo into the wall and leans on it"""
AT_S = 0.9005
"""When the fault comes, after torque on: the shaft moves into the wall, and the next tick is half a
period away"""
DURATION_S = 1.05
ROW_S = 0.3
"""Time to rehearse one row [s]"""
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
    ("replies stay away for 8 ms", "drop:for=0.008,way=reply"),
    ("replies stay away", "drop:way=reply"),
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


class Line(NamedTuple):
    """A row of the table."""

    name: str
    spec: str
    did: str
    periods: str
    torque: str


def rehearsed(spec: str | None) -> Rehearsed:
    """The session with one fault, or with none."""
    if spec is None:
        return rehearse(SETTINGS, DURATION_S)
    return rehearse(SETTINGS, DURATION_S, faults=[_at(spec)])


def _at(spec: str) -> str:
    return f"{spec}{',' if ':' in spec else ':'}at={AT_S}"


def lines(faults: Sequence[tuple[str, str]] = FAULTS) -> list[Line]:
    """The table, or some of its rows."""
    calm = true_torque(rehearsed(None))
    return [line(name, spec, rehearsed(spec), calm) for name, spec in faults]


def line(name: str, spec: str, found: Rehearsed, calm: dict[int, float]) -> Line:
    """Describe the effect of one fault, beside a run without any."""
    struck_ns = found.given_ns + round(AT_S * 1e9)
    reason = found.result.stop_reason
    counts = found.result.bus or {}
    counted = ", ".join(
        f"{key} {counts[key]}" for key in ("lost", "corrupt", "late", "refused") if counts.get(key)
    )
    ticks = found.ticks
    if not isinstance(reason, Trip):
        after = ticks[ticks["deadline_ns"] >= struck_ns - PERIOD_NS]
        failed = int(np.count_nonzero(after["outcome"] != Outcome.OK))
        did = f"goes on; {counted}" if counted else "goes on; nothing is counted"
        return Line(name, spec, did, f"{failed} without a sample", difference(found, calm))
    trip = reason.label
    ended_ns = int(ticks["deadline_ns"][-1]) + (0 if trip in IN_TICK else PERIOD_NS)
    periods = -((struck_ns - ended_ns) // PERIOD_NS)
    read_back = "torque off read back" if found.result.torque_off else "torque off not read back"
    link = f"trips: [{trip}](trips.md#{trip}), {read_back}"
    did = f"{link}; {counted}" if counted else link
    return Line(name, spec, did, str(max(0, periods)), ending(found, struck_ns))


def true_torque(found: Rehearsed) -> dict[int, float]:
    """The torque that acts [N·m], by instant [ns], every millisecond."""
    return {row.time_ns: row.state.torque for row in found.truth if row.event == "state"}


def difference(found: Rehearsed, calm: dict[int, float]) -> str:
    """How far the true torque went from that of the run without faults, while the wall was on."""
    end_ns = int(found.ticks["deadline_ns"][-1])
    torque = true_torque(found)
    most = max(abs(torque[at] - calm[at]) for at in torque if at <= end_ns)
    if not most:
        return "as without the fault"
    return f"at most {most:.3f} N·m from a run without the fault"


def ending(found: Rehearsed, struck_ns: int) -> str:
    """From the fault to no torque, by the witness."""
    before = [row for row in found.truth if row.time_ns < struck_ns][-1].state.torque
    backwards = reversed(found.truth)
    still = list(itertools.takewhile(lambda row: row.state.torque == 0.0, backwards))
    if not still:
        return f"from {before:.2f} N·m: it stayed on"
    return f"from {before:.2f} N·m to 0 after {(still[-1].time_ns - struck_ns) * 1e-6:.1f} ms"


def as_row(each: Line) -> str:
    """As the page has it."""
    return f"| {each.name} | `{each.spec}` | {each.did} | {each.periods} | {each.torque} |"


def page(machine: str) -> str:
    """The whole page.

    Args:
        machine: A line that says what it was written on.
    """
    rows = [as_row(each) for each in lines()]
    return "\n".join(
        [
            "# What each fault does",
            "",
            "Written by `scripts/fault_table`; do not edit. The whole program on the emulated bus"
            " in memory, on the simulated clock, with the [limits of hardware](trips.md): at most"
            " 15 ms without a reading and 5 % lost in half a second, 15 rad/s, the Bus Watchdog at"
            " 40 ms. A hand swings the servo into the wall; the fault comes while it moves in.",
            "",
            "The faults are those of `haptic-wall emulate --fault`"
            " ([emulated bus](emulated-bus.md)). *Periods*, of 1 ms: from the fault to the tick"
            " that ended the run, or those that had to use an older sample. *Torque*: the true one,"
            " by the bus's record.",
            "",
            machine,
            "",
            "| fault | as asked for | what the program did | periods | torque |",
            "|---|---|---|---|---|",
            *rows,
            "",
            "An encoder that stands still looks like a shaft that stands still: nothing tells them"
            " apart, so the torque stays what it was, and what limits it is the torque limit and"
            " whoever holds the shaft. When it runs again within the reach of the speed limit the"
            " wall goes on.",
            "",
        ]
    )


def main() -> None:
    """Write the page."""
    wanted = page_options("fault_table", __doc__, "fault-table.md").parse_args()
    say_time(ROW_S * (1 + len(FAULTS)))
    wanted.out.write_text(page(f"{measured_on()} On the simulated clock others find the same."))


if __name__ == "__main__":
    main()
