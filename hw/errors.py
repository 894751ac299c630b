"""Errors of hardware, as one tree; every message says what was found, wanted, and the remedy.

An error carries its ``Problem``, the parts of its sentence; so do all errors of the program. A
user's error is told as ``FIELD: WHAT, wanted WANTED; ADVICE``, one of hardware as ``WHAT: ADVICE``.

::

    ServoError
    ├── PortError (also OSError)        the serial port cannot be used
    │   ├── PortBusyError               another program holds it
    │   └── BaudRefusedError            it cannot make this rate
    ├── ServoMissingError (LookupError) nothing answers at this id and baud
    ├── UnfitServoError (ValueError)    it answers, but must not be driven as it is
    │   └── StrangeServoError           nor written to: its model is unknown
    ├── GivenUpError                    its start was given up, as asked
    ├── ServoHealthError                it answers, but must not be driven any longer
    └── ServoLostError (also OSError)   it answered before and does not any more
        ├── PortLostError               nor does any other: the port is gone
        └── TorqueLostError             it answers, but its torque is gone
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Final

WIRING: Final = "the cable and the power supply"
"""Parts of a testbed to check when the bus fails"""
_LONGEST: Final = 300
"""Characters of a value that a message repeats"""


def is_emulated(port: str) -> bool:
    """Whether a port is a pseudo-terminal, or one in memory or of a run: a text, or empty."""
    if not port or port.endswith(("memory", "emulated")):
        return True
    return Path(port).resolve().parent == Path("/dev/pts")


@dataclass(frozen=True, slots=True)
class Problem:
    """A fault as the parts of a sentence. Its text is ``FIELD GIVEN: WHAT, wanted WANTED; ADVICE``.

    Any part may be missing.
    """

    what: str = ""
    """Usually what was found"""
    _: KW_ONLY
    wanted: str = ""
    """The values that would be right; empty: ``what`` or ``advice`` says it"""
    advice: str = ""
    """The remedy; empty: ``wanted`` says it, or nothing can be done"""
    field: str | None = None
    """The option, argument or configuration path that is at fault"""
    given: str = ""
    """Stands after the field, or in its place: such as its value, or a file"""
    mark: str = "; "
    """Stands before the advice"""

    def __str__(self) -> str:
        wanted = self.wanted and f"wanted {self.wanted}"
        given = self.given if len(self.given) <= _LONGEST else f"{self.given[:_LONGEST]}…"
        place = " ".join(filter(None, (self.field, given)))
        told = ", ".join(filter(None, (self.what, wanted)))
        told = ": ".join(filter(None, (place, told)))
        return self.mark.join(filter(None, (told, self.advice)))

    def followed_by(self, text: str) -> Problem:
        """Return the problem with more text at its end."""
        if self.advice:
            return replace(self, advice=self.advice + text)
        if self.wanted:
            return replace(self, wanted=self.wanted + text)
        return replace(self, what=self.what + text)

    @property
    def remedy(self) -> str | None:
        """Return the advice, or else the wanted values; None if neither is known."""
        return self.advice or (f"wanted {self.wanted}" if self.wanted else None)


class ExplainedError(Exception):
    """An error with the parts of its sentence.

    Args:
        what: See ``Problem``, as for the others; or a whole problem, and nothing else.
        wanted: The values that would be right.
        advice: The remedy.
        field: The option, argument or configuration path that is at fault.
        given: Stands after the field, such as its value.

    Attributes:
        problem: The parts.
    """

    mark = "; "
    """Stands before the advice"""

    def __init__(
        self,
        what: object = "",
        *,
        wanted: str | None = None,
        advice: str = "",
        field: str | None = None,
        given: object = "",
    ) -> None:
        if not isinstance(what, Problem):
            what = Problem(
                str(what),
                wanted=wanted or "",
                advice=advice,
                field=field,
                given=str(given),
                mark=self.mark,
            )
        super().__init__(str(what))
        self.problem = what


class SpecError(ExplainedError, ValueError):
    """A value of a simulated servo, or a fault of the emulated bus, is wrong."""


class ServoError(ExplainedError):
    """The servo could not be reached, is unfit, or was lost."""

    mark = ": "
    id: int | None = None
    """The id of the servo at fault; None: not known, or not a single one's"""


class PortError(ServoError, OSError):
    """The serial port cannot be used."""


class PortBusyError(PortError):
    """Another program holds the port."""


class BaudRefusedError(PortError):
    """The serial port cannot make this baud rate."""


class ServoMissingError(ServoError, LookupError):
    """Nothing answers at this id and baud."""


class UnfitServoError(ServoError, ValueError):
    """The servo answers, but must not be driven as it is set up."""


class StrangeServoError(UnfitServoError):
    """The servo's model is unknown: nothing may be written to it, nor was."""


class ServoLostError(ServoError, OSError):
    """The servo answered before and does not any more."""


class PortLostError(ServoLostError):
    """The port is gone, or sends no more: no single servo is at fault."""


class TorqueLostError(ServoLostError):
    """The servo answers, but its torque is gone: watchdog, restart, or another program."""


class GivenUpError(ServoError):
    """The start was given up, because the caller asked for it."""


class ServoHealthError(ServoError):
    """The servo answers and has torque, but is in no state to be driven any longer."""
