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
        "time for which this adapter holds back replies, and the rate that it allows; whether the"
        " servo is reversed (Drive Mode) or has a Homing Offset",
    ),
    "identify": Card(
        "identify",
        "the shaft, to both sides of its position",
        _NOTHING,
        "inertia, friction, delay, backlash, and the torque gain where the servo measures current",
        "inertia and friction; backlash between shaft and encoder; the sign of the torque",
    ),
    "delay": Card(
        "delay",
        "the shaft, by itself, up to 0.3 rad to each side",
        _NOTHING,
        "the delay from torque command to motion, and inserted delays",
        "lag of the current loop",
    ),
    "rendered": Card(
        "rendered",
        "the shaft, up to half a radian, and into the wall",
        _NOTHING,
        "the rendered stiffness, the drag of the free shaft, contacts with the wall",
        "torque in proportion to current",
    ),
    "sweep": Card(
        "sweep",
        "the shaft, released at rising stiffness",
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
    "The packets that restart the Bus Watchdog; whether the servo is limp after a trip; whether the"
    " old torque comes back when the trip is cleared. This needs a second servo or a killed loop.",
    "Whether a shutdown (overload, overheating) leaves the servo limp. This needs a shutdown.",
    "The duration of a reboot, and its effect with Startup Configuration.",
    "The instant within a read at which the position is sampled, and the accuracy of Realtime Tick."
    " This needs a run of an hour.",
    "Whether the bad phase of the adapter's timer moves. This needs `haptic-wall doctor` a second"
    " time, after an hour.",
)
"""Rows of docs/hardware-assumptions.md that these steps do not settle"""
