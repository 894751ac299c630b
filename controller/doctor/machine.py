"""What this machine grants a loop, and what would make its wake-ups more punctual."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from controller.realtime import Profile, Setting, missing_for_strict
from hw.dynamixel.examine.finding import Finding, not_applicable
from hw.dynamixel.examine.replies import percentile

_LATE_SHARE = 4
"""A wake-up later than a period over this leaves too little for the bus"""


def judge_rights(settings: Sequence[Setting], profile: Profile) -> list[Finding]:
    """What was wanted of the system and got; only ``strict`` insists, and not on everything.

    Args:
        settings: As ``realtime.apply`` gave them.
        profile: The configured one.
    """
    if profile == "off":
        return [not_applicable("real-time rights", "realtime.profile is off")]
    required = missing_for_strict(list(settings)) if profile == "strict" else []
    return [
        Finding(
            f"real time: {setting.name}",
            setting not in required,
            setting.got,
            setting.wanted,
            setting.remedy,
        )
        for setting in settings
    ]


def judge_lateness(lateness_ns: list[int], period_ns: int) -> Finding:
    """How punctual wake-ups on the grid are, without any bus.

    Args:
        lateness_ns: Behind their deadlines [ns], in order of size.
        period_ns: Of the grid [ns].
    """
    p50, p99 = percentile(lateness_ns, 0.5), percentile(lateness_ns, 0.99)
    limit_ns = period_ns // _LATE_SHARE
    ok = p99 < limit_ns
    return Finding(
        "wake-up lateness",
        ok,
        f"median {p50 / 1000:.0f} µs, 99 % {p99 / 1000:.0f} µs, longest "
        f"{lateness_ns[-1] / 1000:.0f} µs",
        f"99 % below {limit_ns / 1000:.0f} µs",
        "" if ok else "end what else runs on this machine, grant real-time rights, isolate a core",
    )


def examine_core(core: int, root: Path = Path("/sys")) -> list[Finding]:
    """Whether kernel, core and processor are set up for a loop; advice only.

    Args:
        core: The loop's.
        root: Where the kernel tells of itself.
    """
    cpu = root / "devices/system/cpu"
    preempt = _text(root / "kernel/realtime") == "1"
    isolated = core in _cores(_text(cpu / "isolated"))
    governor = _text(cpu / f"cpu{core}/cpufreq/scaling_governor")
    line = f"isolcpus={core} nohz_full={core} rcu_nocbs={core}"
    findings = [
        Finding(
            "kernel",
            True,
            "PREEMPT_RT" if preempt else "no PREEMPT_RT",
            "PREEMPT_RT",
            "" if preempt else "a kernel with PREEMPT_RT bounds the wake-up's lateness",
        ),
        Finding(
            "core isolation",
            True,
            f"core {core} is {'isolated' if isolated else 'shared'}",
            "a core of its own",
            "" if isolated else f"`{line}` on the kernel's command line, realtime.core={core}",
        ),
    ]
    if governor:
        fast = governor == "performance"
        fix = "" if fast else "`sudo cpupower frequency-set -g performance`"
        findings.append(Finding("frequency scaling", True, governor, "performance", fix))
    return findings


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _cores(text: str) -> set[int]:
    """The numbers of a list such as ``1-3,5``."""
    cores: set[int] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        cores |= set(range(int(first), int(last or first) + 1))
    return cores
