"""Fractions that a rule between fields checks and that a run keeps to."""

from __future__ import annotations

from typing import Final

SPIN_SHARE: Final = 0.6
"""Of a period, at most: Linux halts a real-time process that holds its core for more than 0.95 of
a second, and the tick's own work comes on top."""
DRIVEN_SHARE: Final = 0.8
"""Of the no-load speed: a motion that the torque drives must stay below it"""
