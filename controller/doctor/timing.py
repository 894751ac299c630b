"""Judges what was measured: the replies of the bus, the wake-ups, and the real-time rights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from haptic_wall.controller.doctor.replies import Replies, percentile
from haptic_wall.controller.doctor.report import not_applicable
from haptic_wall.controller.runtime.realtime import Profile, missing_for_strict
from haptic_wall.controller.settings.shares import COLLECT_SHARE
from haptic_wall.hw.dynamixel.wire import cycle_s
from haptic_wall.hw.errors import WIRING
from haptic_wall.hw.servo import Check
from haptic_wall.hw.settings import Schedule

_MOST_MISSED: Final = 0.05
"""Largest fraction of missed replies; more would trip a run with default settings"""
_TIMER_NS: Final = 1_200_000
"""Replies delayed for longer are not delayed by a latency timer of 1 ms, the shortest"""
_LATE_SHARE: Final = 4
"""A wake-up later than a period over this leaves too little time for the bus"""
_PERIODS: Final[dict[Schedule, float]] = {
    "immediate": COLLECT_SHARE,
    "pipelined": 1.0 + COLLECT_SHARE,
}
"""Time allowed for a reply, in periods; the one with younger samples first"""
_RATES: Final = (2000, 1500, 1000, 800, 500, 400, 333, 250, 200, 100, 50)
"""Rates to recommend [Hz]"""


@dataclass(frozen=True, slots=True)
class Timing:
    """Measured replies, and the configuration's demands on them."""

    replies: Replies
    """Sent at all phases"""
    asked: Schedule | Literal["auto"]
    """The configured schedule"""
    rate_hz: float
    baud: int
    max_loss: float = 1.0
    """Fraction of missed replies that trips a run"""
    return_delay_ns: int = 0
    """Return delay of the servo; a run sets it to 0"""
    stalls: bool = False
    """This machine wakes up late even without a bus"""

    @property
    def most_missed(self) -> float:
        """Return the largest fraction of missed replies."""
        return min(_MOST_MISSED, self.max_loss)

    @property
    def best(self) -> Schedule | None:
        """Return the schedule with the youngest samples that holds at every phase; None: none does.

        The loop's grid and an adapter's timer drift against each other, so that each reply's time
        is that of some phase, and a run meets all of them: 99 % must be in time.
        """
        if not self.replies.took_ns or self.replies.share_failed > self.most_missed:
            return None
        return next((one for one in _PERIODS if self.sustainable_hz(one) >= self.rate_hz), None)

    @property
    def schedule(self) -> Schedule:
        """Return the configured schedule, or the one that ``auto`` takes."""
        return (self.best or "immediate") if self.asked == "auto" else self.asked

    def sustainable_hz(self, schedule: Schedule) -> float:
        """Return the rate [Hz] at which 99 % of the replies are in time and cycles fit the wire.

        A pipelined reply may take longer than a period, but delays the next request: apart from
        the fraction that may be missed, replies come one after the other. There must be replies.

        Args:
            schedule: Decides the time allowed for a reply.
        """
        replies = self.replies
        in_time = _PERIODS[schedule] * 1e9 / percentile(replies.took_ns, 0.99)
        on_wire = COLLECT_SHARE / cycle_s(self.baud, replies.count, replies.read)
        in_row = (1.0 - self.most_missed) * replies.in_row_ns
        return min(in_time, on_wire, 1e9 / in_row if in_row else on_wire)

    def checks(self) -> list[Check]:
        """Judge the replies, and the rate that they allow."""
        found = [self._reply_time()]
        return [*found, self._rate()] if self.replies.took_ns else found

    def _advice(self) -> str:
        """Return advice against late replies, about the first cause found."""
        replies = self.replies
        if self.stalls:
            return "see wake-up lateness, then examine again"
        needed_ns = 1e9 * cycle_s(self.baud, replies.count, replies.read) + self.return_delay_ns
        if percentile(replies.took_ns, 0.5) - needed_ns > _TIMER_NS:
            return (
                f"replies are held back for {_ms(replies.in_row_ns)}, as by an adapter's latency "
                "timer (factory setting 16 ms): set it to 1 ms"
            )
        if self.return_delay_ns:
            return "set the return delay to 0, as --fix and a run do, then examine again"
        ways = [] if self.best in (None, self.schedule) else [f"set servo.schedule={self.best}"]
        allowed = _PERIODS if self.asked == "auto" else (self.schedule,)
        most = max(map(self.sustainable_hz, allowed))
        lower = next((rate for rate in _RATES if rate <= most and rate < self.rate_hz), None)
        if lower is not None:
            ways.append(f"set loop.rate_hz={lower}")
        return ", or ".join(ways) or "examine again: with such replies no rate is sustainable"

    def _reply_time(self) -> Check:
        replies = self.replies
        found = f"{replies.lost} lost, {replies.corrupt} broken of {replies.asked}"
        wanted = f"at most {self.most_missed:.0%} lost"
        if not replies.took_ns:
            fix = f"check {WIRING}: it answers registers, but not the block of its sample"
            return Check("reply time", False, found, wanted, fix)
        p50, p99 = percentile(replies.took_ns, 0.5), percentile(replies.took_ns, 0.99)
        longest = _ms(replies.took_ns[-1])
        found = f"median {_ms(p50)}, 99 % {_ms(p99)}, longest {longest}; {found}"
        ok = replies.share_failed <= self.most_missed
        fix = "" if ok else f"check {WIRING}, and that no other servo has this id"
        return Check("reply time", ok, found, wanted, fix)

    def _rate(self) -> Check:
        """Judge whether the rate holds with the configured schedule."""
        replies, best = self.replies, self.best
        rates = {schedule: self.sustainable_hz(schedule) for schedule in _PERIODS}
        ok = rates[self.schedule] >= self.rate_hz
        found = ", ".join(f"{schedule} {hz:.0f} Hz" for schedule, hz in rates.items())
        if replies.count > 1:
            found += f" ({replies.count} servos, {replies.read} read)"
        wanted = f"{self.rate_hz:g} Hz ({self.asked})"
        fix = "" if ok else self._advice()
        if ok and best not in (None, self.schedule):
            fix = f"set servo.schedule={best}, which has younger samples"
        return Check("sustainable rate", ok, found, wanted, fix)


def judge_lateness(lateness_ns: list[int], period_ns: int, *, granted: bool = False) -> Check:
    """Judge the lateness of wake-ups that were measured without a bus.

    Args:
        lateness_ns: Lateness of each wake-up [ns], in increasing order.
        period_ns: Period of the grid [ns].
        granted: They were measured with real-time priority.
    """
    p50, p99 = percentile(lateness_ns, 0.5), percentile(lateness_ns, 0.99)
    limit_ns = period_ns // _LATE_SHARE
    ok = p99 < limit_ns
    rights = "" if granted else "grant real-time rights, "
    return Check(
        "wake-up lateness",
        ok,
        f"median {p50 / 1000:.0f} µs, 99 % {p99 / 1000:.0f} µs, longest "
        f"{lateness_ns[-1] / 1000:.0f} µs",
        f"99 % below {limit_ns / 1000:.0f} µs",
        "" if ok else f"end other programs on this machine, {rights}isolate a core",
    )


def judge_rights(settings: Sequence[Check], profile: Profile) -> list[Check]:
    """Judge the granted real-time rights; only ``strict`` counts a missing one as a fault.

    Args:
        settings: Settings from ``realtime.apply``.
        profile: The configured one.
    """
    if profile == "off":
        return [not_applicable("real-time rights", "realtime.profile is off")]
    required = missing_for_strict(settings) if profile == "strict" else []
    return [
        replace(each, name=f"real time: {each.name}", ok=each not in required) for each in settings
    ]


def _ms(duration_ns: float) -> str:
    return f"{duration_ns * 1e-6:.2f} ms"
