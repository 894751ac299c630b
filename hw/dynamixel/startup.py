"""Runs the start-up: checks and records every condition, line by line, before torque is enabled.

The order matters. Torque goes off first, since EEPROM is locked while it is on. Settings that only
a person should change are judged before anything else is written. The goal current is zeroed
*after* the mode change, which sets it to Current Limit. Torque goes on last, and then a small push
verifies its sign.
"""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.dynamixel.driven import Driven
from haptic_wall.hw.dynamixel.probe import prove_the_sign
from haptic_wall.hw.dynamixel.register_access import UNHELD
from haptic_wall.hw.dynamixel.registers import CURRENT_MODE, POSITION_UNIT
from haptic_wall.hw.dynamixel.rules import (
    STATUS_LEVEL,
    Seen,
    Verdict,
    judge,
    judge_firmware,
    judge_model,
    read_servo,
)
from haptic_wall.hw.dynamixel.samples import Sample
from haptic_wall.hw.errors import Problem, StrangeServoError, UnfitServoError
from haptic_wall.hw.servo import Check, Outcome

_REPLIES: Final = 5
"""Number of replies whose median decides whether replies come in time"""
_IN_TIME: Final = 1.8
"""Periods that a reply may take: the one of its request, and 0.8 of the next"""


class Startup:
    """The start-up of one servo. The caller switches the torque off when it raises.

    Args:
        servo: The servo; its exchange is with it alone.
    """

    def __init__(self, servo: Driven) -> None:
        self._servo = servo
        self._settings = servo.settings
        self._table = servo.table
        self._clock = servo.table.clock
        self._name = f"servo with id {servo.settings.id} on {servo.where}"
        self._checks: list[Check] = []
        self._seen: Seen

    def check(self) -> int:
        """Check everything without torque, and set what the driver may set.

        Returns:
            The usual time of a reply at the worst phase of an adapter's timer [ns].

        Raises:
            ServoMissingError: No reply.
            ServoLostError: It stops replying.
            StrangeServoError: Its model is unknown; nothing was written to it.
            UnfitServoError: One or more checks failed; the message has a sentence for each.
        """
        servo, settings, table = self._servo, self._settings, self._table
        number = servo.meet()
        self._identify(number)
        table.be_alone()
        self._settle("torque_enable", 0, "torque at the start", advice="switch its power off")
        self._refuse_if_unfit()
        seen = read_servo(table, servo.model, servo.constant, settings.torque_limit, start=True)
        self._checks += (check for _, check in judge(seen, start=True))
        self._refuse_if_unfit()
        self._set_up()
        position = settings.sign * POSITION_UNIT * self._sample().counts + settings.offset
        self._checks.append(Check("position", True, f"{position:.3f} rad", "known"))
        longest_ns = self._measure_reply()
        self._refuse_if_unfit()
        self._seen = seen
        return longest_ns

    def enable(self) -> list[Check]:
        """Switch torque on at a goal of zero, after ``check``, and prove its sign.

        Returns:
            All checks.

        Raises:
            ServoLostError: It stops replying.
            UnfitServoError: A check failed.
        """
        servo, seen = self._servo, self._seen
        advice = "check its supply voltage and Hardware Error Status (70)"
        self._settle("torque_enable", 1, "torque", advice=advice)  # the goal is zero
        self._refuse_if_unfit()
        self._checks.append(prove_the_sign(servo, seen.law, seen["current_limit"], self._name))
        self._refuse_if_unfit()
        servo.begin(seen)
        return self._checks

    def _identify(self, number: int) -> None:
        """Check model and firmware, and have every instruction answered."""
        table = self._table
        self._checks.append(judge_model(number, self._servo.model.name))
        self._refuse_if_unfit()
        before = table.try_read("status_return_level")  # at 0 reads have no reply
        if before == STATUS_LEVEL:  # a silent second servo takes it
            before = table.write("status_return_level", STATUS_LEVEL)
        self._settle("status_return_level", STATUS_LEVEL, before=before or 0)
        firmware = table.read("firmware_version")
        self._servo.firmware = firmware
        self._checks.append(judge_firmware(self._servo.model, firmware))
        self._refuse_if_unfit()
        table.registers = self._servo.model.registers_at(firmware)

    def _set_up(self) -> None:
        """Set mode, return delay, goal and watchdog where they differ, and read them back."""
        table = self._table
        # A tripped watchdog refuses every goal, 0 included.
        watchdog = table.write("bus_watchdog", 0)
        self._settle("operating_mode", CURRENT_MODE)
        self._settle("return_delay_time", 0, "return delay")
        # The mode change has set it to Current Limit.
        self._settle("goal_current", 0, before=table.write("goal_current", 0))
        # It limits the current in this mode too, and keeps another program's value.
        self._settle("goal_pwm", table.read("pwm_limit"))
        self._settle("bus_watchdog", self._servo.units, before=watchdog)

    def _settle(
        self,
        register: str,
        wanted: int,
        name: str = "",
        *,
        before: int | None = None,
        advice: str = "reboot it, and look for another program on this bus",
    ) -> None:
        """Write a register where it differs from what is read, or was ``before``; read it back."""
        table = self._table
        before = after = table.read(register) if before is None else before
        if before != wanted:
            after = table.write(register, wanted)
        words = ("off", "on") if register == "torque_enable" else range(1 << 16)
        found, goal = str(words[after]), str(words[wanted])
        told = (f"Its {table.label(register)} stays {found} when {goal} is written", advice)
        if after != before:
            found = f"{words[before]}, set to {found}"
        verdict = Verdict(found, goal, *(told if after != wanted else ()))
        self._checks.append(verdict.check(name or register.replace("_", " ")))

    def _measure_reply(self) -> int:
        """Return the time of a reply [ns], and check that the schedules allow it.

        Each is requested right after another has come, when an adapter's timer has just started, so
        that it takes the longest possible time. The median is used, because a machine may stall.
        """
        times = []
        for _ in range(_REPLIES):
            sampled_ns = self._sample().sampled_ns
            times.append(self._clock.now_ns() - sampled_ns)
        middle = sorted(times)[_REPLIES // 2]
        most_ns = _IN_TIME * self._settings.period_s * 1e9
        found = f"{middle * 1e-6:.1f} ms, longest {max(times) * 1e-6:.1f} ms"
        told: tuple[str, ...] = ()
        if middle > most_ns:
            told = (
                f"Its replies take {middle * 1e-6:.1f} ms, more than {_IN_TIME:g} periods",
                f"{UNHELD}, or lower loop.rate_hz",
            )
        verdict = Verdict(found, f"at most {most_ns * 1e-6:.1f} ms", *told)
        self._checks.append(verdict.check("adapter reply"))
        return middle

    def _refuse_if_unfit(self) -> None:
        """Raise if any check failed so far, with a sentence for each."""
        if told := " ".join(f"{check.fix}." for check in self._checks if not check.ok):
            unfit = f"The {self._name} must not be driven as it is."
            kind = UnfitServoError if self._servo.known else StrangeServoError
            raise kind(Problem(unfit, advice=told, mark=" "))

    def _sample(self) -> Sample:
        """Return a position, over the same path as the running cycle."""
        (sample,) = self._table.exchange.sampled()
        if sample.outcome is Outcome.OK:
            return sample
        self._table.read("torque_enable")  # it may show how late replies are
        raise self._table.lost(
            f"The {self._name} answers single registers but not the block of its "
            "sample (120 to 135)"
        )
