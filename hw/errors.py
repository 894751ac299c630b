"""What can be wrong with hardware, as one tree; every message says found, wanted, what to do.

::

    ServoError
    ├── PortError (also OSError)        the serial port cannot be used
    │   └── PortBusyError               another program holds it
    ├── ServoMissingError (LookupError) nothing answers at this id and baud
    ├── UnfitServoError (ValueError)    it answers, but must not be driven as it is
    └── ServoLostError (also OSError)   it answered before and does not any more
        └── TorqueLostError             it answers, but its Bus Watchdog dropped the torque
"""

from __future__ import annotations


class ServoError(Exception):
    """The servo could not be reached, is unfit, or was lost."""


class PortError(ServoError, OSError):
    """The serial port cannot be used."""


class PortBusyError(PortError):
    """Another program holds the port."""


class ServoMissingError(ServoError, LookupError):
    """Nothing answers at this id and baud."""


class UnfitServoError(ServoError, ValueError):
    """The servo answers, but must not be driven as it is set up."""


class ServoLostError(ServoError, OSError):
    """The servo answered before and does not any more."""


class TorqueLostError(ServoLostError):
    """The servo answers, but its Bus Watchdog has dropped the torque."""
