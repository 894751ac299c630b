"""The interface of a bus of servos: all access of the controller to them, simulated or real."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple, Protocol

JUMP_SHARE: Final = 3.0
"""Largest plausible speed of a shaft, as a multiple of the no-load speed"""
JUMP_SPEED: Final = 30.0
"""The same where the no-load speed is not known [rad/s]"""
WHOLE: Final = 1e-9
"""Tolerance, so that rounding does not take a step from an exact torque [steps]"""


class Outcome(IntEnum):
    """Outcome of one request for the position."""

    OK = 0
    LOST = 1
    """No reply before the deadline."""
    CORRUPT = 2
    """Bytes arrived that are not a valid reply."""
    REFUSED = 3
    """A valid reply with a position that the servo cannot have reached; only the loop says so."""


class Reading(NamedTuple):
    """The answer to one request; the position is NaN if it failed."""

    outcome: Outcome
    position: float
    """Multi-turn position [rad]; NaN unless the outcome is OK."""
    counts: int
    """The encoder's own; 0 unless the outcome is OK and it counts."""
    sampled_ns: int
    """The instant the request was sent [ns]: the earliest possible time of the sample, so that an
    age computed from it is an upper bound."""
    torque: float
    """Torque from the measured current [N·m]; NaN where the servo gives none."""
    alert: bool
    """The servo has latched a hardware error; the position is still valid."""


@dataclass(frozen=True, slots=True)
class Facts:
    """Facts of the servo, constant while it is open."""

    name: str
    """For people: model, id, port."""
    counts_per_rev: int
    """Encoder counts per revolution; 0: the position is not quantised."""
    torque_limit: float
    """Largest torque it accepts [N·m]."""
    torque_step: float
    """Smallest nonzero torque, and the largest difference between neighbours [N·m]; 0: none."""
    stall_torque: float = math.inf
    """Its largest torque at its rated supply, whatever its limit [N·m]; infinite: not known."""
    no_load_speed: float = 0.0
    """Its speed without a load [rad/s]; 0: not known, or it has none. At the supply found by
    ``start``; before, at the nominal one."""
    rounds_down: bool = False
    """A torque between two possible ones is rounded toward zero, not to the nearer one"""

    def within(self, torque: float) -> float:
        """Return the largest torque that, once rounded, does not exceed this one [N·m], >= 0."""
        if self.rounds_down or not self.torque_step or math.isinf(torque):
            return torque
        return math.floor(torque / self.torque_step + WHOLE) * self.torque_step

    @property
    def position_step(self) -> float:
        """Return one count of the encoder [rad]; 0: the position is not quantised."""
        return math.tau / self.counts_per_rev if self.counts_per_rev else 0.0

    @property
    def fastest(self) -> float:
        """Return the speed above which a change of position is a jump of the encoder [rad/s].

        A shaft turned by hand at three times its no-load speed generates three times the supply's
        voltage.
        """
        return JUMP_SHARE * self.no_load_speed or JUMP_SPEED


@dataclass(slots=True)
class BusCounts:
    """Counts of the bus traffic since the servo was started."""

    cycles: int = 0
    lost: int = 0
    late: int = 0
    """Replies after their request had been given up; never used."""
    corrupt: int = 0


@dataclass(slots=True)
class Traffic:
    """The traffic between a loop and its servos, as the loop sees it."""

    counts: list[BusCounts]
    """Of each servo; begin anew with each ``start``"""
    waited_ns: int = 0
    """Wait of the last ``collect``, without its own work [ns]"""
    longest_s: float = 0.0
    """Usual time of a reply at the worst phase of an adapter's timer [s]; 0: not known. Known after
    ``start``"""


@dataclass(frozen=True, slots=True)
class Check:
    """One line of a start or an examination: found against wanted."""

    name: str
    ok: bool
    found: str
    wanted: str
    fix: str = ""
    """The remedy; with ``ok`` it is advice: it works, but could be better"""
    applies: bool = True
    """False: it does not exist here; ``found`` gives the reason"""
    fixable: bool = False
    """Whether ``doctor --fix`` can apply the remedy"""


class Bus(Protocol):
    """The servos of a run, commanded in torque; one servo is a bus of one.

    Opened by ``haptic_wall.hw.open``, closed by ``close``. The order of calls is ``start``, any
    number of cycles, ``stop``, ``close``. A cycle is ``request``, ``collect``, ``write``. The
    request may be sent in the period before the one that collects it (the replies then travel while
    the loop sleeps). Lists have one item a servo, always in the same order.

    Attributes:
        given_up: Asked before each servo's start; True: ``start`` raises a ``GivenUpError``.
    """

    given_up: Callable[[], bool]

    @property
    def facts(self) -> Sequence[Facts]:
        """Return the facts of each servo; some are known after ``start`` only."""
        ...

    @property
    def traffic(self) -> Traffic | None:
        """Return the traffic, the same object as long as the bus is open.

        None: no reply travels, so none can be late or lost.
        """
        ...

    @property
    def trouble(self) -> str:
        """Return what was wrong with the servos, and the remedy, after ``stop``; empty: nothing."""
        ...

    def health(self) -> list[tuple[float, float]]:
        """Return each servo's last supply [V] and temperature [°C]; supply 0: not known yet.

        Empty: they report neither.
        """
        ...

    def start(self) -> list[list[Check]]:
        """Check all conditions, then enable the torques at zero torque.

        Returns:
            The checks of each servo, in order.

        Raises:
            UnfitServoError: A check failed; the message says if torque off was not read back.
            ServoMissingError: No reply.
            ServoLostError: One stops replying; the message says whether torque is off.
        """
        ...

    def request(self) -> None:
        """Request all positions. Does not wait."""
        ...

    def collect(self, deadline_ns: int) -> Sequence[Reading]:
        """Return the answers to the last ``request``, waiting until ``deadline_ns`` [ns] at most.

        It never raises for events on the bus: a lost or broken reply is an outcome.

        Raises:
            ServoLostError: The port is gone.
            TorqueLostError: The torque of a servo is gone.
            ServoHealthError: A servo is in no state to be driven any longer.
        """
        ...

    def write(self, torques: Sequence[float]) -> Sequence[float]:
        """Send the torques [N·m] together, limited and rounded to the servos' possibilities.

        Returns:
            The torques really sent [N·m].

        Raises:
            ValueError: A torque is not a finite number; nothing was sent.
            RuntimeError: The bus is not started, or is stopped.
            ServoLostError: The port is gone.
        """
        ...

    def stop(self) -> bool:
        """Set zero torques, switch all torques off, read that back. Safe at any time, and twice.

        Returns:
            Whether torque off was read back from all.
        """
        ...

    def close(self) -> None:
        """Release the servos; stop them first if they were started and not stopped. Safe twice."""
        ...
