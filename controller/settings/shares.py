"""Fractions of a period and of the no-load speed that both the rules and a run use."""

from __future__ import annotations

from typing import Final

COLLECT_SHARE: Final = 0.8
"""Fraction of a period after which a missing reply is given up [1], so that a cycle takes at most
that on the wire. A pipelined tick that waits sends its next request later, until a phase of the
adapter's timer comes in which the replies are in time. A loop that does not wait misses every reply
at some phases."""
DRIVEN_SHARE: Final = 0.8
"""Fraction of the no-load speed: a motion that the torque drives must stay below it"""
