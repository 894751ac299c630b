"""Errors of hardware, as one tree; every message says what was found, wanted, and the remedy.

::

    ServoError
    ├── BackendError (also LookupError) no backend of this name, or it cannot be loaded
    ├── PortError (also OSError)        the serial port cannot be used
    │   ├── PortBusyError               another program holds it
    │   └── BaudRefusedError            it cannot make this rate
    ├── ServoMissingError (LookupError) nothing answers at this id and baud
    ├── UnfitServoError (ValueError)    it answers, but must not be driven as it is
    │   └── StrangeServoError           nor written to: its model is unknown
    ├── ServoHealthError                it answers, but must not be driven any longer
    └── ServoLostError (also OSError)   it answered before and does not any more
        └── TorqueLostError             it answers, but its torque is gone
"""

from __future__ import annotations


class ServoError(Exception):
    """The servo could not be reached, is unfit, or was lost."""


class BackendError(ServoError, LookupError):
    """There is no servo backend of this name, or it cannot be loaded."""


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


class TorqueLostError(ServoLostError):
    """The servo answers, but its torque is gone: watchdog, restart, or another program."""


class ServoHealthError(ServoError):
    """The servo answers and has torque, but is in no state to be driven any longer."""
