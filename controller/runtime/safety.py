"""Names and explains the trips, which end a run for safety, and its other ends."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Final

from haptic_wall.hw.errors import Problem


class Trip(StrEnum):
    """Why a run was ended for safety; reports and logs contain these values."""

    NOT_A_NUMBER = "trip:not_a_number"
    """A position, velocity or torque was NaN or infinite."""
    OVERSPEED = "trip:overspeed"
    """The position moved further than the speed limit allows, or the torque drove it too fast."""
    TRAVEL = "trip:travel"
    """The shaft left ``safety.travel``, counted over several turns from ``wall.reference``."""
    OSCILLATION = "trip:oscillation"
    """The wall oscillates by itself."""
    LOSSES_IN_ROW = "trip:losses_in_row"
    """At least three readings in a row failed, for longer than ``safety.max_silence_s``."""
    LOSS_RATE = "trip:loss_rate"
    """In ``safety.loss_window_s`` more than ``safety.max_loss`` of the readings failed."""
    MISSED_PERIODS = "trip:missed_periods"
    """In half a second more than ``safety.max_missed`` of the periods had no tick."""
    HARDWARE_ERROR = "trip:hardware_error"
    """The servo has latched a hardware error."""
    TORQUE_LOST = "trip:torque_lost"
    """The servo's torque is gone: its Bus Watchdog, a restart, or another program."""
    SERVO_HEALTH = "trip:servo_health"
    """Twice in a row the supply was outside of the servo's voltage limits, or the temperature
    within 2 °C of its limit; or a second servo has its id."""
    SERVO_LOST = "trip:servo_lost"
    """The port is gone, or no request was answered until the Bus Watchdog may have tripped."""
    LOOP_HUNG = "trip:loop_hung"
    """The loop sent no heartbeat for ``safety.heartbeat_s``, or did not end when asked."""
    LOOP_DIED = "trip:loop_died"
    """The loop's process ended: killed, out of memory, or a defect."""
    INTERNAL_ERROR = "trip:internal_error"
    """The program raised an error it should not have."""

    @property
    def label(self) -> str:
        """Return the name without ``trip:``, for people."""
        return self.value.partition(":")[2]

    @classmethod
    def of(cls, reason: str | None) -> Trip | None:
        """Return the trip in a report or a log; None: it names no known trip."""
        return cls(reason) if reason is not None and reason in cls._value2member_map_ else None


class End(StrEnum):
    """Other reasons why a run ended; reports and logs contain these values."""

    DURATION = "duration"
    """As planned: the time or the program is over."""
    INTERRUPTED = "interrupted"
    """A person, or a signal, asked for it."""
    REFUSED = "refused"
    """The servo could not be started."""


StopReason = End | Trip
REASONS: Final[tuple[StopReason, ...]] = (*End, *Trip)


def stop_reason(text: str) -> StopReason:
    """Return the reason that another process of the same run names.

    Raises:
        ValueError: It is none.
    """
    return Trip.of(text) or End(text)


EXPLANATIONS: Final[Mapping[Trip, Problem]] = {
    Trip.NOT_A_NUMBER: Problem(
        "a position, velocity or torque was not a finite number",
        advice="this is a defect or a broken servo: please report it with the log",
    ),
    Trip.OVERSPEED: Problem(
        "the shaft moved faster than safety.max_speed allows, or the torque drove "
        "it to nearly the servo's no-load speed",
        advice="check the wall's stability and the encoder, or set safety.max_speed",
    ),
    Trip.TRAVEL: Problem(
        "the shaft left safety.travel",
        advice="check the turns in the start-up line, turn the shaft back by hand, or "
        "widen safety.travel",
    ),
    Trip.OSCILLATION: Problem(
        "the wall oscillates by itself",
        advice="request less stiffness or damping, correct the belief about the servo in "
        "model.* (identify measures it), and leave guard.mode at stable",
    ),
    Trip.LOSSES_IN_ROW: Problem(
        "all readings failed for longer than safety.max_silence_s allows",
        advice="check cable, power, baud rate and adapter; `haptic-wall doctor` finds late replies"
        " and the suitable servo.schedule",
    ),
    Trip.LOSS_RATE: Problem(
        "a larger fraction of the readings failed than safety.max_loss allows",
        advice="check cable, power, baud rate and adapter (`haptic-wall doctor` finds late replies "
        "and the suitable servo.schedule), or lower loop.rate_hz",
    ),
    Trip.MISSED_PERIODS: Problem(
        "the loop missed a larger fraction of its periods than safety.max_missed allows",
        advice="end programs that keep the cores busy, lower loop.rate_hz, or set "
        "realtime.profile=best-effort, which makes the wall softer instead",
    ),
    Trip.HARDWARE_ERROR: Problem(
        "the servo has latched a hardware error (overload, overheating, voltage, encoder or shock)",
        advice="let it cool, check its supply, then reboot it",
    ),
    Trip.TORQUE_LOST: Problem(
        "the servo answers, but its torque is gone: its Bus Watchdog after a stall, "
        "a restart, or another program on the bus",
    ),
    Trip.SERVO_HEALTH: Problem(
        "the servo's supply or temperature is out of its own limits, or a second one has its id",
    ),
    Trip.SERVO_LOST: Problem(
        "the port is gone, or the servo no longer answers",
        advice="check that both are plugged in and powered",
    ),
    Trip.LOOP_HUNG: Problem(
        "",
        advice="find the cause of the stop or stall, or raise safety.heartbeat_s",
    ),
    Trip.LOOP_DIED: Problem(
        "look for the cause; if memory ran out, the kernel's log says so",
        advice="if you find no cause, please report this with the log",
    ),
    Trip.INTERNAL_ERROR: Problem(
        "the program met an unexpected error",
        advice="please report it with the log",
    ),
}


OF_THE_BUS: Final = frozenset((Trip.LOSSES_IN_ROW, Trip.LOSS_RATE, Trip.SERVO_LOST))
"""Trips after replies that did not come"""
AFTER_STALL: Final = frozenset(
    (Trip.OVERSPEED, Trip.LOSSES_IN_ROW, Trip.LOSS_RATE, Trip.TORQUE_LOST, Trip.SERVO_LOST)
)
"""Trips that a stall of the computer can cause"""


def emulator_late(*, granted: bool) -> Problem:
    """Explain the trips ``OF_THE_BUS`` with an emulated bus, which has no cable.

    Args:
        granted: The loop had real-time priority.
    """
    rights = "give both processes real-time rights (`sudo scripts/setup-testbed`), "
    return Problem(
        "unless faults were injected, the emulator got no processor time, or has ended",
        advice=f"end programs that keep the cores busy, {'' if granted else rights}run a preset"
        " emulated-* with `--set loop.clock=simulated`, or raise safety.max_silence_s or"
        " safety.max_loss",
    )


def stall_advice(*, granted: bool) -> str:
    """Return what helps against stalls of the computer; ``granted`` as of ``emulator_late``."""
    rights = ", or give this program real-time rights (`sudo scripts/setup-testbed`)"
    return (
        f"end programs that keep the cores busy{'' if granted else rights}; without a real servo"
        " `--set loop.clock=simulated` has no stalls"
    )
