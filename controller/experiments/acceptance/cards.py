"""Describes each step of an acceptance for the person at the bench: motion, grip and purpose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Card:
    """One step, for the person at the bench."""

    title: str
    moves: str
    hold: str
    measures: str
    settles: str
    """Rows of docs/hardware-assumptions.md"""

    def lines(self) -> tuple[str, ...]:
        """Return it as lines."""
        return (
            self.title,
            f"  moves: {self.moves}",
            f"  hold: {self.hold}",
            f"  measures: {self.measures}",
            f"  settles: {self.settles}",
        )


_NOTHING = "nothing; the horn bare, its way free, the power switch within reach"

CARDS: Mapping[str, Card] = {
    "doctor": Card(
        "doctor",
        "nothing, no torque",
        "nothing",
        "port, registers, reply time and rate of the bus, the machine's wake-ups",
        "how long this adapter holds replies and which rate it carries; whether the servo is"
        " reversed (Drive Mode); whether a Homing Offset is set",
    ),
    "identify": Card(
        "identify",
        "the shaft, to both sides of where it stands",
        _NOTHING,
        "inertia, friction, delay, backlash, and the torque gain where the servo measures current",
        "inertia and friction; backlash between shaft and encoder; the sign of the torque",
    ),
    "delay": Card(
        "delay",
        "the shaft, some degrees, under torque steps",
        _NOTHING,
        "the delay from torque command to motion, and whether inserted delay is found again",
        "lag of the current loop",
    ),
    "rendered": Card(
        "rendered",
        "the shaft, up to half a radian, and into the wall",
        _NOTHING,
        "the rendered stiffness, the drag of the free shaft, contacts with the wall",
        "torque in proportion to current; lost motion",
    ),
    "sweep": Card(
        "sweep",
        "the shaft is let go at more and more stiffness",
        _NOTHING,
        "the critical stiffness at some virtual dampings and delays",
        "the stability limits themselves: damping and delay together",
    ),
    "rest": Card(
        "rest",
        "nothing; torque on, zero torque",
        "nothing, hands off",
        "the encoder's noise",
        "encoder noise at rest",
    ),
    "load": Card(
        "load",
        "the shaft, slowly, 9 degrees to each side, without and with the weight",
        "the horn level until the servo holds it",
        "the commanded torque that balances a known weight",
        "torque per ampere; friction under load",
    ),
}

OPEN = (
    "Which packets restart the Bus Watchdog, whether the servo is limp after it has tripped, and"
    " whether the old torque comes back when it is cleared: it takes a second servo or a killed"
    " loop",
    "Whether a shutdown (overload, overheating) leaves the servo limp: it takes a shutdown",
    "What a reboot does with Startup Configuration, and how long it takes",
    "When within a read the position is sampled; how true Realtime Tick is: an hour's run tells",
    "Whether the bad phase of the adapter's timer moves: `haptic-wall doctor` again after an hour",
)
"""Rows of docs/hardware-assumptions.md that these steps do not settle"""
