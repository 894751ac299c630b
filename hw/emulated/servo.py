"""One emulated servo: its control table in time, and the mechanism that it drives.

Every instruction acts at its instant, and a read returns the state of that instant.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec import ALERT, ErrorCode
from haptic_wall.hw.dynamixel.registers import (
    BAUD_RATES,
    COUNTS_PER_REV,
    RETURN_DELAY_UNIT_NS,
    TICK_MODULUS,
    WATCHDOG_UNIT_NS,
)
from haptic_wall.hw.dynamixel.tables import Model
from haptic_wall.hw.emulated.drive import Drive
from haptic_wall.hw.emulated.motor import motor_of
from haptic_wall.hw.emulated.rules import ControlTable
from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.hand import SharedHand
from haptic_wall.hw.plant.mechanism import Mechanism
from haptic_wall.hw.truth import TrueServo

BOOT_NS = 200_000_000
"""A rebooting servo does not reply for this long [ns]; real ones take some tenths of a second"""

_NEVER_NS = 1 << 62
"""Time of the replies of a disconnected servo [ns]"""

_BEHIND_NS = 50_000_000
"""The motion of two masses is computed at least this often [ns]: after an idle bus that of seconds
would take longer than a client waits for a reply"""


class TrueState(NamedTuple):
    """The true state, which no client can read."""

    position: float
    """[rad]"""
    velocity: float
    """[rad/s]"""
    torque: float
    """The motor's acting torque [N·m]"""


class EmulatedServo:
    """A servo at rest, powered up at ``start_ns``.

    Args:
        model: Its model.
        id: Its id on the bus.
        firmware: The version it reports; decides the available features.
        true: True parameters of its mechanism.
        start_ns: Time of its power-up [ns].
        baud: Its baud rate; one of ``BAUD_RATES``.
        tick: Initial value of its millisecond counter.

    Raises:
        ValueError: The baud rate, id or firmware is not possible, the model needs a torque
            constant, or the mechanism is impossible.
    """

    def __init__(
        self,
        model: Model,
        id: int,  # noqa: A002
        firmware: int,
        true: TrueServo,
        *,
        start_ns: int,
        baud: int,
        tick: int = 0,
    ) -> None:
        constant = true.torque_constant or model.torque_constant
        if constant is None:
            raise SpecError(
                f"no torque constant is published for the {model.name}",
                advice="give servo.torque_constant",
            )
        if baud not in BAUD_RATES:
            raise SpecError(
                f"a servo has no baud rate of {baud} bit/s",
                advice=f"use one of {', '.join(map(str, BAUD_RATES))}",
            )
        self.model = model
        self.firmware = firmware
        self.table = ControlTable(model, firmware)
        self.memory = self.table.memory
        motor = motor_of(model, constant)
        # Servos of one bus share their truth, but not their noise.
        seed = (true.noise_seed << 8) + id
        own = replace(true, noise_seed=seed, counts_per_rev=COUNTS_PER_REV)
        self.mechanism = Mechanism(own, start_ns, winding=motor.winding(model.voltage))
        self._held = self._by_hand = False
        self.answers_from_ns = start_ns
        """End of its boot [ns]"""
        self._tick = tick
        self._boot_ns = self._heard_ns = start_ns
        self.drive = Drive(self.table, motor, self.mechanism, model)
        self._preset("firmware_version", firmware)
        self._preset("id", id)
        self._preset("baud_rate", BAUD_RATES.index(baud))
        self._power_up(start_ns)

    @property
    def id(self) -> int:
        """Return its present id."""
        return self.memory["id"]

    @property
    def baud(self) -> int:
        """Return its baud rate [bit/s]."""
        return BAUD_RATES[self.memory["baud_rate"]]

    @property
    def return_delay_ns(self) -> int:
        """Return the time from an instruction's last byte to the reply's first [ns]."""
        return self.memory["return_delay_time"] * RETURN_DELAY_UNIT_NS

    @property
    def alert(self) -> int:
        """Return the alert bit of the error byte, if a hardware error is latched."""
        return ALERT if self.memory["hardware_error_status"] else 0

    @property
    def watchdog_from_ns(self) -> int:
        """Return a time before which the Bus Watchdog does not trip at any setting [ns]."""
        return self._heard_ns + WATCHDOG_UNIT_NS

    @property
    def watchdog_ns(self) -> int | None:
        """Return when the Bus Watchdog will trip without instructions [ns]; None: never."""
        value = self.memory.get("bus_watchdog")
        if not value or not self.memory["torque_enable"] or self.table.tripped:
            return None
        return self._heard_ns + value * WATCHDOG_UNIT_NS

    def state(self, now_ns: int) -> TrueState:
        """Return the true state at ``now_ns`` [ns]."""
        mechanism = self.mechanism
        self.drive.advance(now_ns)
        return TrueState(mechanism.position, mechanism.velocity, mechanism.torque)

    def heard(self, now_ns: int) -> None:
        """Process the arrival of an instruction for itself, for all, or for a list with its id.

        Those restart the Bus Watchdog here. The manual counts "all the instruction packets"; it is
        open whether packets for other servos count too, and here they do not.
        """
        self._heard_ns = now_ns
        if self.drive.due(now_ns) or self._by_hand:
            self.drive.advance(now_ns)

    def keep_up(self, now_ns: int) -> None:
        """Compute its controllers up to ``now_ns`` [ns], so that the next instruction is quick.

        Apart from faults and errors this has no effect on the results.
        """
        mechanism = self.mechanism
        behind = mechanism.flexible and now_ns - mechanism.time_ns > _BEHIND_NS
        if behind or self.drive.due(now_ns) or self._by_hand:
            self.drive.advance(now_ns)

    def take_hand(self, hand: SharedHand) -> None:
        """Let a person hold the shaft from now on, whenever the hand holds on."""
        self._by_hand = True
        self.mechanism.take_hand(hand)

    def set_supply(self, volts: float, now_ns: int) -> None:
        """Set the supply voltage [V] from ``now_ns`` [ns] on; out of limits it is an error."""
        self.drive.advance(now_ns)
        self.table.feed(volts)
        self.mechanism.feed(self.drive.motor.winding(volts).stall_torque)
        self.drive.update(now_ns)

    def set_ambient(self, celsius: float, now_ns: int) -> None:
        """Set the temperature [°C] from ``now_ns`` [ns] on: the motor's heat is not simulated."""
        self.drive.advance(now_ns)
        self.table.temperature = celsius
        self.table.check_health()
        self.drive.update(now_ns)

    def trip_watchdog(self, now_ns: int) -> None:
        """Trip the Bus Watchdog: the register reads -1 and the servo stops.

        The manual says no more than that. That it goes limp in current mode, and holds its position
        in a position mode, is our interpretation.
        """
        self.drive.advance(now_ns)
        self.table.trip()
        self.drive.stop(now_ns)

    def read(self, address: int, size: int, now_ns: int) -> bytes | None:
        """Return the bytes at ``address`` at ``now_ns``; None: not all of them exist."""
        if self.memory.shows_measured(address, size):
            self._refresh(now_ns)
        return self.memory.read(address, size)

    def write(self, address: int, data: bytes, now_ns: int) -> ErrorCode:
        """Write, with every consequence, at ``now_ns`` [ns]."""
        drive = self.drive
        if drive.due(now_ns):
            drive.advance(now_ns)
        error = self.table.write(address, data)
        if error == ErrorCode.NONE:
            if self.memory["torque_enable"] and not self._held:
                # The scripted operator waits for the torque, as a user of the wall would, and does
                # not disturb a start-up that checks the shaft.
                self._held = True
                self.mechanism.engage_operator(now_ns)
                for each in drive.together:  # and for the other servos, checked one by one
                    if each.mechanism.operator_waits:
                        each.mechanism.engage_operator(now_ns)
            drive.update(now_ns)
        return error

    def reboot(self, now_ns: int) -> None:
        """Set RAM to its defaults, clear errors and turns; silent until it has booted."""
        self.drive.advance(now_ns)
        self.drive.forget_turns()
        self._tick = 0
        self._power_up(now_ns)
        self.answers_from_ns = now_ns + BOOT_NS

    @property
    def unplugged(self) -> bool:
        """Whether it is disconnected from data and power."""
        return self.answers_from_ns == _NEVER_NS

    def unplug(self, now_ns: int) -> None:
        """Disconnect it: limp and silent, and RAM is lost."""
        self.reboot(now_ns)
        self.memory["torque_enable"] = 0  # whatever Startup Configuration says
        self.drive.update(now_ns)
        self.answers_from_ns = _NEVER_NS

    def latch_errors(self, bits: int, now_ns: int) -> None:
        """Set bits of Hardware Error Status; those in Shutdown switch the torque off."""
        self.drive.advance(now_ns)
        self.table.latch(bits)
        self.drive.update(now_ns)

    def _power_up(self, now_ns: int) -> None:
        self._boot_ns = now_ns
        self.drive.release(now_ns)
        self.table.power_up()
        self.drive.update(now_ns)

    def _preset(self, name: str, value: int) -> None:
        register = self.memory.registers[name]
        if not register.minimum <= value <= register.maximum:
            raise SpecError(
                f"{name} {value} of the {self.model.name} is out of range",
                advice=f"give {register.minimum} to {register.maximum}",
            )
        self.memory[name] = value

    def _refresh(self, now_ns: int) -> None:
        """Store the measurements of ``now_ns`` in the registers."""
        self.drive.advance(now_ns)
        tick = (self._tick + (now_ns - self._boot_ns) // 1_000_000) % TICK_MODULUS
        self.memory.overwrite(self.drive.measured(tick))
