"""Simulates temperature and overload of an emulated servo, and the hardware errors that they latch.

The manual gives neither thermal constants nor the condition of an overload ("persistent load that
exceeds maximum output"). Two assumptions replace them. The servo is one thermal mass, heated by the
motor's losses; at stall current it would settle ``STALL_RISE`` above ambient. An overload occurs if
a controller's output is at its limit for ``OVERLOAD_NS`` while the shaft stands still. Current and
PWM mode have no overload, because there a user requests full output.
"""

from __future__ import annotations

import math

from haptic_wall.hw.emulated.rules import ControlTable

STALL_RISE = 200.0
"""[K] An assumption: from 32 °C an X430 held at stall then shuts down at 80 °C after 55 s"""
THERMAL_S = 200.0
"""Time constant [s]; an assumption"""
OVERLOAD_NS = 5_000_000_000
"""[ns] Users report "some seconds" and "around 5 s" """
OVERLOAD = 0x20
HEALTH_NS = 100_000_000
"""Period of the temperature updates [ns]"""


class Health:
    """Temperature and overload of a servo.

    Args:
        table: Its registers, which hold the supply's voltage and the temperature.
        stall_current: Stall current of the motor [A].
        now_ns: The time [ns].
    """

    def __init__(self, table: ControlTable, stall_current: float, now_ns: int) -> None:
        self._table = table
        self._stall = stall_current
        self.ambient = table.temperature
        """Settling temperature without load [°C]"""
        self._load = 0.0
        self._heat = 0.0
        self._since_ns = self._settled_ns = now_ns
        self.due_ns = now_ns + HEALTH_NS
        """Time of the next temperature update [ns]"""
        self._at_limit_ns: int | None = None

    def load(self, current: float, now_ns: int) -> None:
        """Set the motor current [A] from ``now_ns`` on."""
        share = current / self._stall
        self._heat += self._load * (now_ns - self._since_ns)
        self._since_ns = now_ns
        self._load = share * share

    def settle(self, now_ns: int) -> None:
        """Update the temperature to ``now_ns``, and latch the resulting errors."""
        self._heat += self._load * (now_ns - self._since_ns)
        self._since_ns = now_ns
        self.due_ns = now_ns + HEALTH_NS
        elapsed = now_ns - self._settled_ns
        if elapsed <= 0:
            return
        table = self._table
        end = self.ambient + STALL_RISE * self._heat / elapsed
        self._heat = 0.0
        self._settled_ns = now_ns
        if end != table.temperature:
            table.temperature = end + (table.temperature - end) * math.exp(
                -elapsed * 1e-9 / THERMAL_S
            )
            table.check_health()

    def watch_output(self, at_limit: bool, now_ns: int) -> None:
        """Latch an overload if the output has been at its limit for too long at a standstill."""
        if not at_limit:
            self._at_limit_ns = None
        elif self._at_limit_ns is None:
            self._at_limit_ns = now_ns
        elif now_ns - self._at_limit_ns >= OVERLOAD_NS:
            self._at_limit_ns = None
            self._table.latch(OVERLOAD)
