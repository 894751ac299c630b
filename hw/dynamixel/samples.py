"""A sample: where it lies in a servo's memory, and whether the servo's own clock bears it out."""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

from hw.dynamixel.tables import TICK_MODULUS
from hw.servo import Outcome

SAMPLE: Final = struct.Struct("<HxxhhIi")
"""From 120: tick, moving, moving status, PWM, current, velocity, position"""
SAMPLE_ADDRESS: Final = 120
SAMPLE_END: Final = SAMPLE_ADDRESS + SAMPLE.size
LENGTHS: Final = range(16, 28)
"""Sample to position, up to Present Temperature (146); the bytes behind the position are unused"""
QUARANTINE: Final = 10
"""Requests before the length of an unanswered one is used again; fewer than there are lengths, so
that one is always free"""

_TICK_SLACK_MS: Final = 5.0
"""A request may wait in the adapter, and so may the next"""
_TICK_DRIFT: Final = 0.02
"""The servo's clock against ours"""
_TICK_TRUST_NS: Final = 10_000_000_000
"""After such a pause a tick that wraps every 33 s proves nothing"""
_RESTART_PROOFS: Final = 2
"""Samples in step with each other, and not with what was accepted, that prove a restart"""


class Sample(NamedTuple):
    """The answer to one request, in the servo's own units; zeros unless the outcome is OK."""

    outcome: Outcome
    counts: int
    """Multi-turn position"""
    current: int
    """Signed, in the model's current unit"""
    alert: bool
    """A hardware error is latched."""
    sampled_ns: int
    """When the request was sent [ns]"""


class ServoClock:
    """A servo's millisecond tick against the instants at which it was asked for."""

    __slots__ = ("_accepted", "_doubted", "_proofs")

    def __init__(self) -> None:
        self._accepted: tuple[int, int] | None = None
        """Tick and request instant of the last accepted sample"""
        self._doubted: tuple[int, int] | None = None
        """The same of the last one refused"""
        self._proofs = 0

    @property
    def restarted(self) -> bool:
        """Whether it runs on from another reading: the servo has restarted."""
        return self._proofs >= _RESTART_PROOFS

    def accept(self, tick: int, sent_ns: int) -> bool:
        """Whether a tick has advanced by the time that passed since the last accepted one.

        Args:
            tick: What the servo says.
            sent_ns: When it was asked [ns].
        """
        now = (tick, sent_ns)
        if self._accepted is None or _in_step(self._accepted, now):
            self._accepted = now
            self._doubted = None
            self._proofs = 0
            return True
        if self._doubted is not None:
            self._proofs = self._proofs + 1 if _in_step(self._doubted, now) else 0
        self._doubted = now
        return False


def _in_step(before: tuple[int, int], now: tuple[int, int]) -> bool:
    """Whether one tick follows from another, each with the instant it was asked for."""
    passed_ns = now[1] - before[1]
    if passed_ns > _TICK_TRUST_NS:
        return True
    half = TICK_MODULUS // 2
    advance = (now[0] - before[0] + half) % TICK_MODULUS - half
    passed_ms = passed_ns * 1e-6
    slack = _TICK_SLACK_MS + _TICK_DRIFT * passed_ms
    return advance >= 0 and -slack <= advance - passed_ms <= slack
