"""Judges whether this machine is fit for a real-time loop: its rights, wake-ups and settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from haptic_wall.controller.doctor.replies import percentile
from haptic_wall.controller.doctor.report import not_applicable
from haptic_wall.controller.runtime.realtime import Profile, missing_for_strict
from haptic_wall.hw.servo import Check

_LATE_SHARE = 4
"""A wake-up later than a period over this leaves too little time for the bus"""


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


def judge_lateness(lateness_ns: list[int], period_ns: int) -> Check:
    """Judge the lateness of wake-ups that were measured without a bus.

    Args:
        lateness_ns: Lateness of each wake-up [ns], in increasing order.
        period_ns: Period of the grid [ns].
    """
    p50, p99 = percentile(lateness_ns, 0.5), percentile(lateness_ns, 0.99)
    limit_ns = period_ns // _LATE_SHARE
    ok = p99 < limit_ns
    return Check(
        "wake-up lateness",
        ok,
        f"median {p50 / 1000:.0f} µs, 99 % {p99 / 1000:.0f} µs, longest "
        f"{lateness_ns[-1] / 1000:.0f} µs",
        f"99 % below {limit_ns / 1000:.0f} µs",
        "" if ok else "end other programs on this machine, grant real-time rights, isolate a core",
    )
