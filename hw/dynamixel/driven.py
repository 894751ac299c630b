"""One servo as its driver knows it: model, limits, goal, health; converts torques and readings."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from contextlib import suppress
from typing import Final

from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.health import DrivingRange
from haptic_wall.hw.dynamixel.register_access import QUICK_NS, Table
from haptic_wall.hw.dynamixel.registers import (
    COUNTS_PER_REV,
    WATCHDOG_TRIPPED,
    WATCHDOG_UNIT_NS,
)
from haptic_wall.hw.dynamixel.rules import Seen, error_names, what_to_do
from haptic_wall.hw.dynamixel.station import Station
from haptic_wall.hw.dynamixel.tables import MODELS, Model, model_by_number
from haptic_wall.hw.dynamixel.torque_law import torque_law
from haptic_wall.hw.errors import (
    ServoHealthError,
    ServoLostError,
    TorqueLostError,
    UnfitServoError,
)
from haptic_wall.hw.servo import Facts
from haptic_wall.hw.settings import DriverSettings

NEVER_NS: Final = 1 << 62
_TWICE: Final = 2
"""Consecutive polls that confirm a fault of supply or temperature, because a current peak makes the
supply voltage dip"""


def drivable(settings: DriverSettings) -> tuple[Model, float]:
    """Return the configured model, and its torque constant [N·m/A].

    Raises:
        UnfitServoError: The model or its constant is not known.
    """
    model = MODELS.get(settings.model)
    if model is None:
        raise UnfitServoError(
            f"{settings.model} is no known model with a current mode",
            advice=f"set servo.model to one of {', '.join(MODELS)}.",
        )
    constant = settings.torque_constant or model.torque_constant
    if constant is None:
        raise UnfitServoError(
            f"The {model.name} has no published torque constant",
            advice="measure it and set servo.torque_constant [N·m/A].",
        )
    return model, constant


def rearm(table: Table, units: int) -> bool:
    """Arm a tripped Bus Watchdog again, at zero torque; return whether that was read back.

    A tripped watchdog accepts no goal before it is cleared, and the old torque may then return with
    nothing to end it: so torque is off meanwhile. Every write is read back.

    Args:
        table: The servo.
        units: Its setting [20 ms].
    """
    steps = (
        ("torque_enable", 0),
        ("bus_watchdog", 0),
        ("goal_current", 0),
        ("bus_watchdog", units),
        ("torque_enable", 1),
    )
    return all(table.try_write(name, value, 3 * QUICK_NS[-1:]) == value for name, value in steps)


class Driven:
    """One servo of a drive.

    Args:
        settings: Its settings.
        station: The servo on the line.
        exchange: The line.

    Raises:
        UnfitServoError: The model is unknown, or its smallest torque exceeds the torque limit.
    """

    def __init__(self, settings: DriverSettings, station: Station, exchange: Exchange) -> None:
        model, constant = drivable(settings)
        self.settings = settings
        self.model = model
        self.constant = constant
        self.units = round(settings.watchdog_s * 1e9 / WATCHDOG_UNIT_NS)
        """Setting of the Bus Watchdog [20 ms]"""
        self.station = station
        self.where = settings.port or "the emulated bus in memory"
        name = f"id {settings.id} at {settings.baud} baud on {self.where}"
        self.table = Table(exchange, station, name, model.registers)
        self.law = torque_law(model, constant, model.voltage)
        if settings.torque_limit > 0.0 and not self.law.within(settings.torque_limit):
            raise UnfitServoError(
                advice="raise it above that.",
                field="servo.torque_limit",
                given=f"is {settings.torque_limit:g} N·m, but the smallest torque of the "
                f"{model.name} is {self.law.step:.2g} N·m",
            )
        self._name = f"{model.name} id {settings.id} on {settings.port or 'memory'}"
        self.health = {"supply": 0, "temperature": 0}
        """Last readings [0.1 V], [°C]; 0: none yet"""
        self.bounds: DrivingRange | None = None
        """The servo's limits; None until the start has read them"""
        self.heard_ns = 0
        """When the last answered request was sent [ns]"""
        self.silence_ns = NEVER_NS
        """Time since then after which the Bus Watchdog may have tripped [ns]; while the torque is
        off pauses may have any length"""
        self.facts = self._facts(model.current_limit, model.voltage)
        self.forget()

    def forget(self) -> None:
        """Discard what an earlier run has left."""
        self.goal = 0
        """The last goal current"""
        self.known = False
        """It has replied as a model with a known control table"""
        self.firmware = 0
        """Known after a start"""
        self.alert = False
        """A hardware error was latched"""
        self.trouble = ""
        """See ``Bus``"""
        self.station.forget()
        self._strikes = dict.fromkeys(self.health, 0)

    def meet(self) -> int:
        """Return the model number; record whether its control table is known."""
        number = self.table.ping()
        self.known = model_by_number(number) is not None
        return number

    def begin(self, seen: Seen) -> None:
        """Take the limits that the start has read; from now on watch for pauses: torque is on."""
        self.law = seen.law
        self.bounds = seen.bounds
        self.heard_ns = self.table.clock.now_ns()
        if self.table.read("bus_watchdog") != self.units:
            self.look(0)  # a stall in the start has tripped it
        self.facts = self._facts(seen["current_limit"], seen.volts)
        # The watchdog counts whole units, so that one set to two may trip soon after the first.
        self.silence_ns = round(max(self.units - 1, 0.75) * WATCHDOG_UNIT_NS)

    def obeys_only_itself(self, ids: Collection[int]) -> None:
        """Refuse a servo that would also take the goals of another one of these ids.

        Raises:
            UnfitServoError: It would.
        """
        second = self.table.read("secondary_id")
        if second in ids and second != self.station.id:
            raise UnfitServoError(
                f"The {self._name} also obeys id {second}, which is another one of this bus",
                advice="write 255 to its Secondary ID (12); `haptic-wall doctor --fix` does so.",
            )

    def limited(self, torque: float) -> float:
        """Return a torque within the servo's limit [N·m].

        Raises:
            ValueError: The torque is not a finite number.
        """
        if not math.isfinite(torque):
            raise ValueError(f"a torque of {torque} N·m was commanded; a finite one is wanted")
        most = self.facts.torque_limit
        return max(-most, min(most, torque))

    def judge(self, values: Mapping[str, int]) -> None:
        """Judge polled values, see ``HealthPolls``.

        Raises:
            TorqueLostError: The servo's torque is off.
            ServoHealthError: The servo must not be driven any longer.
        """
        bounds, name = self.bounds, self._name
        if bounds is None:
            return
        if values.get("torque enable") == 0:
            raise TorqueLostError(
                f"The torque of the {name} is off, but this program has not switched it off",
                advice="look for another program on this bus, and check the supply: a restart "
                "switches it off.",
            )
        for kind, find in (("supply", bounds.supply_fault), ("temperature", bounds.heat_fault)):
            if kind in values:
                fault, advice = find(values[kind])
                self.health[kind] = values[kind]
                self._strikes[kind] = self._strikes[kind] + 1 if fault else 0
                if self._strikes[kind] >= _TWICE:
                    raise ServoHealthError(f"The {name} {fault}", advice=f"{advice}.")
        if values.get("bus watchdog", self.units) != self.units:
            self.look(0)

    def resume(self, now_ns: int) -> None:
        """Examine the Bus Watchdog if the last answered request is too long ago; see ``look``."""
        silence_ns = now_ns - self.heard_ns
        if silence_ns > self.silence_ns:
            self.look(silence_ns)
            self.heard_ns = now_ns

    def look(self, silence_ns: int) -> None:
        """Check whether the servo still accepts goals; arm it again if no torque was lost.

        A tripped watchdog silently refuses every goal. Under torque it is left tripped: the return
        of the torque after an unobserved motion would be an impact.

        Args:
            silence_ns: Time without an instruction [ns]; 0: there was none.

        Raises:
            ServoLostError: The port is gone, or there is no reply.
            TorqueLostError: The torque is gone.
        """
        found = self.table.try_read("bus_watchdog", QUICK_NS[:1])
        if found is None:
            self.table.exchange.rest()  # none may hold its torque while this one is looked for
            found = self.table.try_read("bus_watchdog", QUICK_NS[1:])
        if found == self.units:
            return
        if found is not None and found != WATCHDOG_TRIPPED:
            raise TorqueLostError(
                f"The Bus Watchdog of the {self._name} has another setting than the driver wrote, "
                f"{found}",
                advice="look for another program on this bus, and check the supply: a restart sets "
                "it to 0.",
            )
        silence = f"{silence_ns * 1e-6:.0f} ms" if silence_ns else "a while"
        if found == WATCHDOG_TRIPPED and self.goal:
            raise TorqueLostError(
                f"The {self._name} heard nothing for {silence}, so its Bus Watchdog "
                f"({self.settings.watchdog_s * 1e3:.0f} ms) has dropped the torque",
                advice="find the cause of this machine's stalls, or raise servo.watchdog_s.",
            )
        if found is None or not rearm(self.table, self.units):
            raise self.table.lost(
                f"The {self._name} no longer answers, after {silence} without an answered request",
                ": a servo that restarts is silent meanwhile",
            )

    def silent(self) -> ServoLostError:
        """Return the error for a servo that answers, but no longer tells its health."""
        return self.table.lost(f"The {self._name} answers, but has not told its health for seconds")

    def name_trouble(self) -> None:
        """Read what the servo has latched, if it has."""
        if self.alert and not self.trouble:
            with suppress(ServoLostError):
                if error := self.table.try_read("hardware_error_status", QUICK_NS):
                    names = error_names(error) or f"0x{error:02x}"
                    told = f"the {self.facts.name} has latched: {names}; {what_to_do(error)}"
                    self.trouble = told

    def _facts(self, current_limit: int, volts: float) -> Facts:
        """Return the facts; the torque limit is rounded down to a whole number of torque steps."""
        steps = current_limit
        if self.settings.torque_limit > 0.0:
            steps = min(steps, self.law.within(self.settings.torque_limit))
        return Facts(
            name=self._name,
            counts_per_rev=COUNTS_PER_REV,
            torque_limit=self.law.torque(steps),
            torque_step=self.law.step,
            stall_torque=self.model.stall_torque or self.law.torque(self.model.current_limit),
            no_load_speed=self.model.no_load_at(volts),
            rounds_down=self.law.root,
        )
