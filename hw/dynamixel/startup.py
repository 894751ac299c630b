"""Everything that must hold before a servo may have torque, checked and put down line by line.

The order matters. Torque goes off first, since EEPROM is locked while it is on. What only a person
should change (drive mode, start-up configuration) is checked before anything is written. The goal
current is zeroed *after* the mode change, which sets it to Current Limit. Torque goes on last, and
then a small push proves its sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from hw.dynamixel.checklist import Checklist
from hw.dynamixel.line import Line
from hw.dynamixel.link import Link, Sample
from hw.dynamixel.probe import Push, probe_sign
from hw.dynamixel.sdk import Sdk
from hw.dynamixel.tables import (
    CURRENT_MODE,
    POSITION_UNIT,
    WATCHDOG_TRIPPED,
    WATCHDOG_UNIT_NS,
    Model,
    Register,
    model_by_number,
)
from hw.errors import ServoMissingError, UnfitServoError
from hw.servo import Check, Outcome
from hw.settings import DynamixelSettings

_WATCHDOG_FIRMWARE: Final = 38
"""First firmware with a Bus Watchdog"""
_WATCHDOG_UNITS: Final = 127
_REVERSE: Final = 0x01
_TORQUE_ON_BY_GOAL: Final = 0x08
_HARDWARE_ERRORS: Final = {
    0: "input voltage",
    2: "overheating",
    3: "motor encoder",
    4: "electrical shock",
    5: "overload",
}
_SAMPLE_PATIENCE_NS: Final = 40_000_000
_SAMPLE_ATTEMPTS: Final = 3
_LOOK_NS: Final = 20_000_000
"""Between two looks at a shaft inside the wall"""
_STANDS_NS: Final = 1_000_000_000
"""Not moved for so long: nobody is about to turn it out"""
_TURN_OUT_NS: Final = 5_000_000_000
_PUSHES: Final = 3
"""A machine that is not set up for real time may stall for longer than the Bus Watchdog allows"""


@dataclass(frozen=True, slots=True)
class Ready:
    """A servo with torque enabled at zero torque."""

    checks: list[Check]
    current_limit: int
    """The servo's own, in the model's current unit"""


def start_up(
    settings: DynamixelSettings, model: Model, line: Line, link: Link, torque_step: float
) -> Ready:
    """Check everything, set up what the driver may set up, and enable torque at zero torque.

    Whoever calls this switches the torque off when it raises.

    Args:
        settings: What is wanted.
        model: The configured model.
        line: The bus, for the set-up.
        link: The same bus, for positions and the probe.
        torque_step: [N·m] per current unit.

    Raises:
        ServoMissingError: Nothing answers.
        UnfitServoError: One or more checks failed; the message has a sentence for each.
    """
    start = _Startup(settings, model, line, link, torque_step)
    start.identify()
    start.torque_off()
    start.judge_what_only_a_person_changes()
    start.list.refuse_if_unfit()
    start.set_up()
    start.judge_limits_and_position()
    start.list.refuse_if_unfit()
    start.torque_on()
    start.prove_the_sign()
    start.list.refuse_if_unfit()
    return Ready(start.list.checks, start.current_limit)


def watchdog_units(settings: DynamixelSettings) -> int:
    """The configured Bus Watchdog in the register's unit.

    Raises:
        UnfitServoError: No servo has such a one.
    """
    units = round(settings.watchdog_s * 1e9 / WATCHDOG_UNIT_NS)
    if not 1 <= units <= _WATCHDOG_UNITS:
        raise UnfitServoError(
            f"A Bus Watchdog of {settings.watchdog_s:g} s was asked for, but servos have 0.02 to "
            "2.54 s: set servo.watchdog_s within that."
        )
    return units


class _Startup:
    def __init__(
        self,
        settings: DynamixelSettings,
        model: Model,
        line: Line,
        link: Link,
        torque_step: float,
    ) -> None:
        where = settings.port or "the emulated bus in memory"
        self.current_limit = 0
        self._settings = settings
        self._model = model
        self._link = link
        self._clock = line.clock
        self._torque_step = torque_step
        self._sdk = Sdk(line, settings.baud, settings.id, where)
        self._registers = model.registers
        self._name = f"{model.name} with id {settings.id} on {where}"
        self.list = Checklist(self._name)

    # What is there

    def identify(self) -> None:
        """Model and firmware; without them no other register has a meaning, so raise at once."""
        number = self._sdk.ping()
        found = model_by_number(number)
        name = found.name if found else "unknown model"
        no_current = "" if found is None or found.current_mode else ", which has no current mode"
        self.list.add(
            "model",
            number == self._model.number,
            f"{name} ({number})",
            f"{self._model.name} ({self._model.number})",
            f"It is an {name} (model number {number}){no_current}: connect an {self._model.name}, "
            "or set servo.model to what is there.",
        )
        self.list.refuse_if_unfit()
        self._have_replies_to_everything()
        firmware = self._read("firmware_version")
        self.list.add(
            "firmware",
            firmware >= _WATCHDOG_FIRMWARE,
            str(firmware),
            f"at least {_WATCHDOG_FIRMWARE}",
            f"Its firmware {firmware} has no Bus Watchdog ({_WATCHDOG_FIRMWARE} or later has): "
            "update it with Dynamixel Wizard.",
        )
        self.list.refuse_if_unfit()

    def _have_replies_to_everything(self) -> None:
        """Status Return Level 2; below it a servo is silent on writes, at 0 even on reads."""
        register = self._registers["status_return_level"]
        try:
            found = str(level := self._sdk.read(register))
        except ServoMissingError:
            found, level = "no replies to reads", 0
        if level != register.default:
            self._sdk.write_unanswered(register, register.default)
            level = self._sdk.read(register)
            found += f", set to {level}"
        self.list.add(
            "status return level",
            level == register.default,
            found,
            str(register.default),
            f"Its Status Return Level ({register.address}) stays {level} when {register.default} "
            "is written: set it with Dynamixel Wizard.",
        )

    def torque_off(self) -> None:
        """Torque that is on belongs to somebody else's run; EEPROM is locked while it is on."""
        was_on = self._read("torque_enable") != 0
        if was_on:
            self._write("torque_enable", 0)
        off = not was_on or self._read("torque_enable") == 0
        found = "off" if not was_on else "on, switched off" if off else "on"
        self.list.add(
            "torque at the start", off, found, "off", "Its torque stays on: switch its power off."
        )

    # What only a person changes

    def judge_what_only_a_person_changes(self) -> None:
        """Latched errors, drive mode, start-up configuration: dangerous, and not ours to mend."""
        error = self._read("hardware_error_status")
        names = ", ".join(name for bit, name in _HARDWARE_ERRORS.items() if error >> bit & 1)
        self.list.add(
            "hardware error",
            error == 0,
            f"{names or 'unknown'} (0x{error:02x})" if error else "none",
            "none",
            f"It has latched a hardware error ({names or f'0x{error:02x}'}): remove the cause, "
            "then reboot it or switch its power off and on; nothing else clears it.",
        )
        drive_mode = self._read("drive_mode")
        self.list.add(
            "direction",
            not drive_mode & _REVERSE,
            "reverse" if drive_mode & _REVERSE else "normal",
            "normal",
            "Its Drive Mode is reverse, which may turn round the position but not the torque, so "
            "that a wall would push the wrong way: clear bit 0 of Drive Mode (10) with Dynamixel "
            "Wizard.",
        )
        self.list.add(
            "torque on by goal update",
            not drive_mode & _TORQUE_ON_BY_GOAL,
            "on" if drive_mode & _TORQUE_ON_BY_GOAL else "off",
            "off",
            "Any goal, a late one too, would switch its torque back on: clear bit 3 of Drive Mode "
            "(10) with Dynamixel Wizard.",
        )
        startup = self._read("startup_configuration")
        dangers = [
            danger
            for bit, danger in ((1, "torque on at power-up"), (2, "old goals restored"))
            if startup & bit
        ]
        self.list.add(
            "start-up configuration",
            not dangers,
            " and ".join(dangers) or "0",
            "0",
            f"Its Startup Configuration means {' and '.join(dangers)}: write 0 to Startup "
            "Configuration (60) with Dynamixel Wizard.",
        )

    # What the driver sets up

    def set_up(self) -> None:
        """Mode, return delay, goal, watchdog: written where they differ, and read back."""
        self._write("bus_watchdog", 0)  # one that has tripped refuses every goal, 0 included
        self._settle_at("operating mode", "operating_mode", CURRENT_MODE)
        self._settle_at("return delay", "return_delay_time", 0)
        self._write("goal_current", 0)  # the mode change has set it to Current Limit
        self._settle_at("goal current", "goal_current", 0)
        self._settle_at("bus watchdog", "bus_watchdog", watchdog_units(self._settings))

    def judge_limits_and_position(self) -> None:
        """The servo's own limit on torque, and where it stands."""
        self.current_limit = self._read("current_limit")
        self.list.add(
            "current limit",
            self.current_limit > 0,
            f"{self.current_limit} ({self.current_limit * self._torque_step:.2f} N·m)",
            "above 0",
            "Its Current Limit is 0, so it can make no torque: raise Current Limit (38) with "
            "Dynamixel Wizard.",
        )
        position = self._sample().counts
        found = f"{position * POSITION_UNIT:.3f} rad"
        if not self._may_be_at(position):
            position = self._wait_to_be_turned_out(position)
            found += f", inside the wall; then {position * POSITION_UNIT:.3f} rad"
        self.list.add(
            "position",
            self._may_be_at(position),
            found,
            "anywhere" if self._settings.keep_out is None else "outside the wall",
            f"It stands inside the wall, at {position * POSITION_UNIT:.3f} rad: turn it out by "
            "hand, or move the wall with wall.position.",
        )

    def _may_be_at(self, counts: int) -> bool:
        keep_out = self._settings.keep_out
        return keep_out is None or not keep_out[0] <= counts * POSITION_UNIT <= keep_out[1]

    def _wait_to_be_turned_out(self, position: int) -> int:
        """Give a hand that is moving the shaft the time to leave the wall; where it is then."""
        begun = moved = self._clock.now_ns()
        while not self._may_be_at(position):
            self._clock.wait_until(self._clock.now_ns() + _LOOK_NS)
            now = self._clock.now_ns()
            before, position = position, self._sample().counts
            if abs(position - before) > 1:
                moved = now
            if now - moved > _STANDS_NS or now - begun > _TURN_OUT_NS:
                break
        return position

    # Torque

    def torque_on(self) -> None:
        """Enable torque; the goal is zero."""
        self._write("torque_enable", 1)
        on = self._read("torque_enable") == 1
        self.list.add(
            "torque",
            on,
            "on" if on else "off",
            "on",
            "Its torque stays off: check its supply voltage and Hardware Error Status (70).",
        )
        self.list.refuse_if_unfit()

    def prove_the_sign(self) -> None:
        """See a small torque away from the wall move the shaft away from the wall."""
        settings = self._settings
        if settings.probe_torque <= 0.0:
            self.list.add("torque sign", True, "not probed", "not asked for")
            return
        limit = min(round(settings.probe_torque / self._torque_step), self.current_limit)
        direction = 1 if settings.probe_direction > 0 else -1
        push, tripped = self._push(direction * max(1, limit))
        torque = push.peak * self._torque_step
        if push.moved:
            found = f"{push.moved:+d} counts at {torque:+.3f} N·m"
            remedy = (
                f"Its shaft moved the wrong way ({found}), so a wall would pull instead of push: "
                "check Drive Mode (10), and that nobody turns the shaft during the start."
            )
        elif tripped:
            found = "no motion, because the Bus Watchdog tripped"
            remedy = (
                f"Its Bus Watchdog ({settings.watchdog_s * 1e3:.0f} ms) ended the push that was to "
                "prove the torque's sign: find what stalls this machine, or raise servo.watchdog_s."
            )
        else:
            found = f"no motion at {torque:+.3f} N·m"
            remedy = (
                f"Its shaft did not move at {abs(torque):.2g} N·m: free it if it is blocked or "
                "held, or raise servo.probe_torque; 0 skips the probe."
            )
        self.list.add("torque sign", push.sign_is_right, found, "motion with the torque", remedy)

    def _push(self, limit: int) -> tuple[Push, bool]:
        """Push, again if the Bus Watchdog ended the torque, and whether it did the last time."""
        for _ in range(_PUSHES):
            push = probe_sign(self._link, self._clock, limit, self._name, self._may_be_at)
            tripped = not push.moved and self._read("bus_watchdog") == WATCHDOG_TRIPPED
            if not tripped:
                break
            self._write("bus_watchdog", 0)
            self._write("goal_current", 0)
            self._write("bus_watchdog", watchdog_units(self._settings))
        return push, tripped

    # Tools

    def _settle_at(self, name: str, register_name: str, wanted: int) -> None:
        """Write a register where it differs, and read it back."""
        register: Register = self._registers[register_name]
        before = self._sdk.read(register)
        after = before
        if before != wanted:
            self._sdk.write(register, wanted)
            after = self._sdk.read(register)
        found = str(after) if after == before else f"{before}, set to {after}"
        title = register_name.replace("_", " ").title()
        self.list.add(
            name,
            after == wanted,
            found,
            str(wanted),
            f"Its {title} ({register.address}) stays {after} when {wanted} is written: reboot it, "
            "and look for another program on this bus.",
        )

    def _read(self, name: str) -> int:
        return self._sdk.read(self._registers[name])

    def _write(self, name: str, value: int) -> None:
        self._sdk.write(self._registers[name], value)

    def _sample(self) -> Sample:
        """A position, over the same path that the running cycle will use."""
        for _ in range(_SAMPLE_ATTEMPTS):
            self._link.request()
            sample = self._link.collect(self._clock.now_ns() + _SAMPLE_PATIENCE_NS)
            if sample.outcome is Outcome.OK:
                return sample
        raise ServoMissingError(
            f"The {self._name} answers single registers but not the block of its sample "
            "(120 to 135): check the cable."
        )
