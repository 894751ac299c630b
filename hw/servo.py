"""The servo interface: what the controller may know of a servo, simulated, emulated or real."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple, Protocol

from haptic_wall.hw.clock import Clock

JUMP_SHARE: Final = 3.0
"""Of the no-load speed: no shaft is turned faster than this"""
JUMP_SPEED: Final = 30.0
"""The same where the no-load speed is not known [rad/s]"""


class Outcome(IntEnum):
    """Outcome of one request for the position."""

    OK = 0
    LOST = 1
    """No reply before the deadline."""
    CORRUPT = 2
    """Bytes arrived that are not a valid reply."""
    REFUSED = 3
    """A valid reply with a position that the servo cannot have come to."""
    WAITING = 4
    """No reply yet, and none was due: replies take several periods here. Not a loss."""


class Reading(NamedTuple):
    """The answer to one request. One that failed or waits holds no position: it is NaN."""

    outcome: Outcome
    position: float
    """Multi-turn position [rad]; NaN unless the outcome is OK."""
    counts: int
    """The encoder's integer behind it; 0 unless the outcome is OK and the servo has an encoder."""
    sampled_ns: int
    """The instant the request was sent [ns]: the earliest at which the sample can have been
    taken, so that an age computed from it hides nothing."""
    torque: float
    """Torque from the measured current [N·m]; NaN where the servo gives none."""
    alert: bool
    """The servo has latched a hardware error; the position is still valid."""


@dataclass(frozen=True, slots=True)
class Facts:
    """Facts of the servo, which do not change while it is open."""

    name: str
    """For people: model, id, port."""
    counts_per_rev: int
    """Encoder counts per revolution; 0: the position is not quantised."""
    torque_limit: float
    """Largest torque it accepts [N·m]."""
    torque_step: float
    """Smallest torque it can be sent but zero, and the largest difference between neighbours
    [N·m]; 0: none."""
    has_bus: bool
    """Replies travel over a bus, where they can be lost."""
    reply_s: float = 0.0
    """How long a reply takes, where it takes several periods [s]; 0: it comes in time for each.
    Known after ``start``."""
    stall_torque: float = math.inf
    """The most it can make at its rated supply, whatever it is limited to [N·m]; infinite: not
    known."""
    no_load_speed: float = 0.0
    """Speed that it reaches by itself without a load [rad/s]; 0: not known, or it has none. At the
    supply that ``start`` found; before, at the one its figures hold for."""

    @property
    def position_step(self) -> float:
        """One count of the encoder [rad]; 0: the position is not quantised."""
        return math.tau / self.counts_per_rev if self.counts_per_rev else 0.0

    @property
    def fastest(self) -> float:
        """Speed above which a change of position is a jump of the encoder [rad/s].

        At three times its no-load speed a shaft that is turned by hand makes three times the
        supply's voltage.
        """
        return JUMP_SHARE * self.no_load_speed or JUMP_SPEED


@dataclass(slots=True)
class BusCounts:
    """Counts of the bus traffic since the servo was started."""

    cycles: int = 0
    lost: int = 0
    late: int = 0
    """Replies that came after their request had been given up; never used."""
    corrupt: int = 0
    refused: int = 0
    """Good replies with a position that was out of reach; never used"""


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the start-up sequence: what was found against what was wanted."""

    name: str
    ok: bool
    found: str
    wanted: str


class Servo(Protocol):
    """One servo, commanded in torque. Opened by ``haptic_wall.hw.open``, closed by ``close``.

    The order of calls is ``start``, any number of cycles, ``stop``, ``close``. A cycle is
    ``request``, ``collect``, ``write``. The request may be sent in the period before the one
    that collects it (the reply then travels while the loop sleeps).

    Where a reply takes several periods (``facts.reply_s``) a request stays outstanding until it is
    answered: until then ``request`` asks for nothing, and ``collect`` does not wait.
    """

    facts: Facts
    counts: BusCounts
    waited_ns: int
    """How long the last ``collect`` waited for the bus, its own work not counted [ns]"""
    trouble: str
    """What the servo itself said was wrong with it, and what to do; empty: nothing. Known after
    ``stop``."""

    def start(self) -> list[Check]:
        """Check everything that must hold, then enable torque at zero torque.

        Returns:
            What was checked, in order.

        Raises:
            UnfitServoError: A check failed; the message says if torque off was not read back.
            ServoMissingError: Nothing answers.
            ServoLostError: It stops answering; the message says whether torque is off.
        """
        ...

    def request(self) -> None:
        """Ask for the position. Does not wait."""
        ...

    def collect(self, deadline_ns: int) -> Reading:
        """The answer to the last ``request``, waiting for it until ``deadline_ns`` [ns] at most.

        Never raises for what the bus did: a lost or broken reply is an outcome.

        Raises:
            ServoLostError: The port is gone.
            TorqueLostError: The servo's torque is gone.
            ServoHealthError: The servo is in no state to be driven any longer.
        """
        ...

    def write(self, torque: float) -> float:
        """Send a torque [N·m], limited and rounded to what the servo can do.

        Returns:
            The torque really sent [N·m].

        Raises:
            ServoLostError: The port is gone.
        """
        ...

    def idle(self) -> None:
        """Do beforehand what can be: called while the loop waits for a deadline, or not at all.

        Nothing is sent, and nothing is read from a bus.
        """
        ...

    def stop(self) -> bool:
        """Zero torque, torque off, read back. Safe to call at any time, and twice.

        Returns:
            Whether torque off was read back.
        """
        ...

    def close(self) -> None:
        """Let go of the servo; stops it first if it was started and not stopped."""
        ...

    def stand_in(self, clock: Clock) -> Servo:
        """Something of the same make to rehearse a cycle with; it moves nothing and needs no end.

        It is started, and has nothing in common with this servo and its bus: what is done to it
        has no effect. It answers at once, with positions that it makes up.

        Args:
            clock: Its time.
        """
        ...
