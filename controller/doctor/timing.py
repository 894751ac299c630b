"""Judges what was measured: the replies of the bus, the wake-ups, and the real-time rights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
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
_LATE_SHARE: Final = 4
"""A wake-up later than a period over this leaves too little time for the bus"""
_PERIODS: Final[dict[Schedule, float]] = {
    "immediate": COLLECT_SHARE,
    "pipelined": 1.0 + COLLECT_SHARE,
}
"""Time allowed for a reply, in periods; the one with younger samples first"""
_NONE_SUITS: Final = (
    "end what makes replies late: an adapter's latency timer above 1 ms, a return delay, late "
    "wake-ups; else lower loop.rate_hz"
)


def sustainable_hz(replies: Replies, baud: int, most_missed: float) -> dict[Schedule, float]:
    """Return for each schedule the rate [Hz] that it holds with these replies.

    At that rate 99 % of the replies are in time and cycles fit the wire. The loop's grid and an
    adapter's timer drift against each other, so that each reply's time is that of some phase, and a
    run meets all of them. A pipelined reply may take longer than a period, but delays the next
    request: apart from the fraction that may be missed, replies come one after the other.

    Args:
        replies: At least one came.
        baud: Rate of the bus [bit/s].
        most_missed: Fraction of missed replies that a run allows.
    """
    late_ns = percentile(replies.took_ns, 0.99)
    on_wire = COLLECT_SHARE / cycle_s(baud, replies.count, replies.read)
    in_row_ns = (1.0 - most_missed) * replies.in_row_ns
    most = min(on_wire, 1e9 / in_row_ns if in_row_ns else on_wire)
    return {each: min(most, 1e9 * periods / late_ns) for each, periods in _PERIODS.items()}


def judge_replies(
    replies: Replies,
    asked: Schedule | Literal["auto"],
    rate_hz: float,
    baud: int,
    max_loss: float = 1.0,
) -> list[Check]:
    """Judge the replies and the rate that they allow, and name the schedule that suits.

    Args:
        replies: Sent at all phases.
        asked: The configured schedule.
        rate_hz: The configured rate.
        baud: Rate of the bus [bit/s].
        max_loss: Fraction of missed replies that trips a run.
    """
    most_missed = min(_MOST_MISSED, max_loss)
    found = f"{replies.lost} lost, {replies.corrupt} broken of {replies.asked}"
    wanted = f"at most {most_missed:.0%} lost"
    if not replies.took_ns:
        fix = f"check {WIRING}: it answers registers, but not the block of its sample"
        return [Check("reply time", False, found, wanted, fix)]
    p50, p99 = percentile(replies.took_ns, 0.5), percentile(replies.took_ns, 0.99)
    found = f"median {_ms(p50)}, 99 % {_ms(p99)}, longest {_ms(replies.took_ns[-1])}; {found}"
    ok = replies.share_failed <= most_missed
    fix = "" if ok else f"check {WIRING}, and that no other servo has this id"
    reply_time = Check("reply time", ok, found, wanted, fix)

    rates = sustainable_hz(replies, baud, most_missed)
    suits = next((schedule for schedule, hz in rates.items() if hz >= rate_hz), None)
    taken = (suits or "immediate") if asked == "auto" else asked
    found = ", ".join(f"{schedule} {hz:.0f} Hz" for schedule, hz in rates.items())
    if replies.count > 1:
        found += f" ({replies.count} servos, {replies.read} read)"
    fix = _NONE_SUITS if suits is None else "" if suits == taken else f"set servo.schedule={suits}"
    wanted = f"{rate_hz:g} Hz ({asked})"
    rate = Check("sustainable rate", rates[taken] >= rate_hz, found, wanted, fix)
    return [reply_time, rate]


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
