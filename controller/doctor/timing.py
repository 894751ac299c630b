"""Judges how fast the servo's replies come: which schedule and which rate they allow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptic_wall.controller.doctor.replies import Replies, percentile
from haptic_wall.controller.settings.shares import COLLECT_SHARE
from haptic_wall.hw.dynamixel.wire import cycle_s
from haptic_wall.hw.errors import wiring
from haptic_wall.hw.servo import Check
from haptic_wall.hw.settings import Schedule

MOST_MISSED: Final = 0.05
"""Largest fraction of missed replies; more would trip a run with default settings"""
_TIMER_NS: Final = 1_200_000
"""Replies delayed for longer are not delayed by a latency timer of 1 ms, the shortest"""
_HELD_NS: Final = 300_000
"""Replies delayed for longer are delayed by the adapter: a host takes half of it"""
_PERIODS: Final[dict[Schedule, float]] = {
    "immediate": COLLECT_SHARE,
    "pipelined": 1.0 + COLLECT_SHARE,
}
"""Time allowed for a reply, in periods; the one with younger samples first"""
_RATES: Final = (2000, 1500, 1000, 800, 500, 400, 333, 250, 200, 100, 50)
"""Rates to recommend [Hz]"""


@dataclass(frozen=True, slots=True)
class Wanted:
    """The configuration's demands on the bus, and the conditions of the measurement."""

    schedule: Schedule
    rate_hz: float
    baud: int
    most_missed: float = MOST_MISSED
    return_delay_ns: int = 0
    """Return delay of the servo; a run sets it to 0"""
    stalls: bool = False
    """This machine wakes up late even without a bus"""
    wiring: str = wiring("/")
    """What to check where the bus fails"""


def judge_timing(replies: Replies, wanted: Wanted) -> list[Check]:
    """Judge the replies: the resulting rate and schedule, and the noise of the encoder."""
    advice = _advice(replies, wanted)
    found = [_reply_time(replies, wanted, advice)]
    if replies.took_ns:
        found += [_rate(replies, wanted, advice), _encoder(replies)]
    return [*found, _schedule(replies, wanted, advice)]


def suits(
    replies: Replies, rate_hz: float, baud: int, most_missed: float = MOST_MISSED
) -> Schedule | None:
    """Return the schedule with the youngest samples that holds at every phase; None: none does.

    The loop's grid and an adapter's timer drift against each other, so that each reply's time is
    that of some phase, and a run meets all of them: 99 % must be in time.

    Args:
        replies: Sent at all phases.
        rate_hz: The loop's rate [Hz].
        baud: Baud rate of the wire [bit/s].
        most_missed: Fraction of replies.
    """
    if not replies.took_ns or replies.share_failed > most_missed:
        return None
    return next(
        (one for one in _PERIODS if sustainable_hz(replies, one, baud, most_missed) >= rate_hz),
        None,
    )


def sustainable_hz(
    replies: Replies, schedule: Schedule, baud: int, most_missed: float = MOST_MISSED
) -> float:
    """Return the rate at which 99 % of the replies are in time and the cycle fits on the wire [Hz].

    A pipelined reply may take longer than a period, but delays the next request: apart from the
    fraction that may be missed, replies come one after the other.

    Args:
        replies: Single replies, at least one.
        schedule: Decides the time allowed for a reply.
        baud: Baud rate of the wire [bit/s].
        most_missed: Fraction of replies.
    """
    in_time = _PERIODS[schedule] * 1e9 / percentile(replies.took_ns, 0.99)
    on_wire = COLLECT_SHARE / cycle_s(baud, replies.count, replies.read)
    in_row = 1e9 / ((1.0 - most_missed) * replies.in_row_ns) if replies.in_row_ns else on_wire
    return min(in_time, on_wire, in_row)


def _suits(replies: Replies, wanted: Wanted) -> Schedule | None:
    return suits(replies, wanted.rate_hz, wanted.baud, wanted.most_missed)


def _advice(replies: Replies, wanted: Wanted) -> str:
    """Return advice against late replies, about the first cause found."""
    if not replies.took_ns:
        return f"check {wanted.wiring}: it answers single registers but not the block of its sample"
    if replies.share_failed > wanted.most_missed:
        return f"check {wanted.wiring}, and that no other servo has this id"
    needed_ns = 1e9 * cycle_s(wanted.baud, replies.count, replies.read) + wanted.return_delay_ns
    held_ns = percentile(replies.took_ns, 0.5) - needed_ns
    if held_ns > _TIMER_NS:
        return (
            f"replies are held back for {_ms(replies.in_row_ns)}, as by an adapter's latency timer "
            "(factory setting 16 ms): set it to 1 ms"
        )
    if wanted.return_delay_ns:
        return "set the return delay to 0, as --fix and a run do, then examine again"
    disturbed = wanted.stalls or replies.disturbed
    ways = []
    best = _suits(replies, wanted)
    if best not in (None, wanted.schedule) and not (disturbed and held_ns < _HELD_NS):
        ways.append(f"set servo.schedule={best}")
    elif disturbed:
        return (
            "a few replies are slow, as on a busy machine: end other programs on this machine (see "
            "wake-up lateness), then examine again"
        )
    most = sustainable_hz(replies, wanted.schedule, wanted.baud, wanted.most_missed)
    lower = next((rate for rate in _RATES if rate <= most and rate < wanted.rate_hz), None)
    if lower is not None:
        ways.append(f"set loop.rate_hz={lower}")
    return ", or ".join(ways) or "examine again: with such replies no rate is sustainable"


def _reply_time(replies: Replies, wanted: Wanted, advice: str) -> Check:
    limit_ns = _PERIODS[wanted.schedule] * 1e9 / wanted.rate_hz
    found = f"{replies.lost} lost, {replies.corrupt} broken of {replies.asked}"
    limit = (
        f"99 % within {_ms(limit_ns)} ({wanted.schedule}), at most {wanted.most_missed:.0%} lost"
    )
    ok = replies.share_failed <= wanted.most_missed
    if replies.took_ns:
        p50, p99 = percentile(replies.took_ns, 0.5), percentile(replies.took_ns, 0.99)
        ok &= p99 <= limit_ns
        longest = _ms(replies.took_ns[-1])
        found = f"median {_ms(p50)}, 99 % {_ms(p99)}, longest {longest}; {found}"
    return Check("reply time", ok, found, limit, "" if ok else advice)


def _rate(replies: Replies, wanted: Wanted, advice: str) -> Check:
    rates = {
        schedule: sustainable_hz(replies, schedule, wanted.baud, wanted.most_missed)
        for schedule in _PERIODS
    }
    ok = rates[wanted.schedule] >= wanted.rate_hz
    found = ", ".join(f"{schedule} {hz:.0f} Hz" for schedule, hz in rates.items())
    if replies.count > 1:
        found += f" ({replies.count} servos, {replies.read} read)"
    text = f"{wanted.rate_hz:g} Hz ({wanted.schedule})"
    return Check("sustainable rate", ok, found, text, "" if ok else advice)


def _encoder(replies: Replies) -> Check:
    spread = replies.spread
    fix = "" if spread <= 1 else "noise, or the shaft is moving: take your hands off and repeat"
    found = f"{spread} counts apart in {replies.asked - replies.lost - replies.corrupt} readings"
    return Check("encoder at rest", True, found, "at most 1 count apart", fix)


def _schedule(replies: Replies, wanted: Wanted, advice: str) -> Check:
    """Judge whether the configured schedule is suitable."""
    best = _suits(replies, wanted)
    ok = best in (wanted.schedule, "immediate")  # pipelined holds wherever immediate does
    fix = "" if ok else advice
    if ok and best != wanted.schedule:
        fix = f"set servo.schedule={best}, which has younger samples"
    suitable = best or f"replies in time at {wanted.rate_hz:g} Hz, which no schedule has"
    return Check("schedule", ok, wanted.schedule, suitable, fix)


def _ms(duration_ns: float) -> str:
    return f"{duration_ns * 1e-6:.2f} ms"
