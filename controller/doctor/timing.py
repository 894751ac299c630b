"""What measured replies and cycles mean: which schedule suits the adapter, and which rate it holds.

A schedule holds if the share of replies that miss their tick stays below a limit at *every* phase
of the loop's grid: the adapter's clock drifts against the computer's, so every phase comes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.tick import COLLECT_SHARE
from hw.dynamixel.examine.cycles import Replies, Series, percentile
from hw.dynamixel.examine.finding import Finding
from hw.settings import Schedule
from hw.wire import cycle_s

MOST_MISSED: Final = 0.05
"""Share of replies missed at the worst phase; more than this trips a run with default settings"""
_TIMER_NS: Final = 2_500_000
"""Replies that take longer are held by something: none waits so long on a wire fit for a loop"""
_PERIODS: Final[dict[Schedule, float]] = {
    "immediate": COLLECT_SHARE,
    "pipelined": 1.0 + COLLECT_SHARE,
}
"""How long a reply may take, in periods"""
_RATES: Final = (2000, 1500, 1000, 800, 500, 400, 333, 250, 200, 100, 50)
"""Rates to recommend [Hz]"""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the configuration asks of the bus."""

    schedule: Schedule
    rate_hz: float
    baud: int
    most_missed: float = MOST_MISSED


def judge_replies(replies: Replies, wanted: Wanted) -> list[Finding]:
    """What single replies take, which rate follows from it, and how still the encoder is."""
    asked = len(replies.took_ns) + replies.lost + replies.corrupt
    limit_ns = _PERIODS[wanted.schedule] * 1e9 / wanted.rate_hz
    failed = f"{replies.lost} lost, {replies.corrupt} broken of {asked}"
    limit = f"99 % within {limit_ns * 1e-6:.2f} ms ({wanted.schedule}), none lost"
    if not replies.took_ns:
        fix = "check the cable: it answers single registers but not the block of its sample"
        return [Finding("reply time", False, failed, limit, fix)]
    p50, p99 = percentile(replies.took_ns, 0.5), percentile(replies.took_ns, 0.99)
    good = replies.lost + replies.corrupt <= wanted.most_missed * asked
    fix = ""
    if not good:
        fix = "check the cable and its length, the power supply, and for a second servo"
    elif p99 > limit_ns:
        fix = (
            "something holds replies, as an adapter's latency timer does (16 ms from the "
            "factory): set it to 1 ms"
            if p50 > _TIMER_NS
            else "raise the baud rate, set the return delay to 0, or lower loop.rate_hz"
        )
    found = f"median {_ms(p50)}, 99 % {_ms(p99)}, longest {_ms(replies.took_ns[-1])}; {failed}"
    return [
        Finding("reply time", good and p99 <= limit_ns, found, limit, fix),
        _rate(replies, wanted),
        _encoder(replies),
    ]


def sustainable_hz(replies: Replies, schedule: Schedule, baud: int) -> float:
    """The rate at which 99 % of the replies come in time and the cycle fits on the wire [Hz].

    Args:
        replies: Single replies, at least one.
        schedule: How long a reply may take.
        baud: Of the wire [bit/s].
    """
    on_wire = 1 / cycle_s(baud)
    return min(_PERIODS[schedule] * 1e9 / percentile(replies.took_ns, 0.99), on_wire)


def judge_series(series: Sequence[Series], replies: Replies, wanted: Wanted) -> list[Finding]:
    """What each schedule gives at every phase, and which one suits."""
    findings = []
    for one in series:
        holds = one.worst <= wanted.most_missed
        used = one.schedule == wanted.schedule
        findings.append(
            Finding(
                f"schedule {one.schedule}",
                holds or not used,
                _series_text(one, wanted.most_missed),
                f"at most {wanted.most_missed:.0%} missed at every phase",
                "" if holds or not used else "see the line schedule",
            )
        )
    best = suits(series, wanted.most_missed)
    ok = any(s.schedule == wanted.schedule and s.worst <= wanted.most_missed for s in series)
    fix = ""
    if best is None:
        lower = _lower_rate(replies, wanted)
        fix = f"set loop.rate_hz={lower}" if lower else "no rate holds: mend the reply time first"
    elif best != wanted.schedule:
        fix = f"set servo.schedule={best}" + ("" if ok is False else ": samples would be younger")
    text = best or f"none at {wanted.rate_hz:g} Hz"
    findings.append(Finding("schedule", ok, wanted.schedule, f"what suits: {text}", fix))
    return findings


def suits(series: Sequence[Series], most_missed: float = MOST_MISSED) -> Schedule | None:
    """The schedule with the youngest samples that holds at every phase; None where none does.

    Args:
        series: Measured, each schedule once.
        most_missed: Share of replies.
    """
    holding = [one for one in series if one.worst <= most_missed and one.ages_ns]
    if not holding:
        return None
    return min(holding, key=lambda one: percentile(one.ages_ns, 0.99)).schedule


def _rate(replies: Replies, wanted: Wanted) -> Finding:
    rates = {name: sustainable_hz(replies, name, wanted.baud) for name in _PERIODS}
    found = ", ".join(f"{name} {hz:.0f} Hz" for name, hz in rates.items())
    ok = rates[wanted.schedule] >= wanted.rate_hz
    fix = ""
    if not ok:
        other = next((name for name, hz in rates.items() if hz >= wanted.rate_hz), None)
        lower = _lower_rate(replies, wanted)
        fix = f"set servo.schedule={other}" if other else ""
        if lower:
            fix += (" or " if fix else "set ") + f"loop.rate_hz={lower}"
    text = f"{wanted.rate_hz:g} Hz ({wanted.schedule})"
    return Finding("sustainable rate", ok, found, text, fix or "mend the reply time" * (not ok))


def _lower_rate(replies: Replies, wanted: Wanted) -> int | None:
    """The highest usual rate below the wanted one that the configured schedule can hold."""
    if not replies.took_ns:
        return None
    most = sustainable_hz(replies, wanted.schedule, wanted.baud)
    return next((rate for rate in _RATES if rate <= most and rate < wanted.rate_hz), None)


def _encoder(replies: Replies) -> Finding:
    spread = replies.most_counts - replies.least_counts
    fix = "" if spread <= 1 else "noise, or the shaft is moving: take your hands off and repeat"
    found = f"{spread} counts apart in {len(replies.took_ns)} readings"
    return Finding("encoder at rest", True, found, "at most 1 count apart", fix)


def _series_text(series: Series, most_missed: float) -> str:
    phases = [phase for phase in series.phases if phase.cycles]
    if not phases:
        return "not measured: every tick was late; this machine stalls"
    shares = [phase.share for phase in phases]
    bad = sum(share > most_missed for share in shares)
    text = (
        f"misses {min(shares):.0%} to {max(shares):.0%} of the replies; "
        f"{bad} of {len(phases)} phases miss more than {most_missed:.0%}"
    )
    if ages := series.ages_ns:
        p50, p99 = percentile(ages, 0.5), percentile(ages, 0.99)
        text += f"; sample age median {_ms(p50)}, 99 % {_ms(p99)}, longest {_ms(ages[-1])}"
    return text


def _ms(duration_ns: int) -> str:
    return f"{duration_ns * 1e-6:.2f} ms"
