"""Finds settings of the machine that make a loop late, beyond what a process may request."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from haptic_wall.controller.runtime.realtime import text_of
from haptic_wall.hw.servo import Check

START = "real time:"
"""Beginning of what is told at the start"""


def machine_setup(core: int, root: Path = Path("/")) -> list[Check]:
    """Return the settings of this machine that make a loop late, some with a remedy.

    None is a reason to refuse, so all are ``ok``. Unknown settings (in a container, on another
    processor) are omitted.

    Args:
        core: The loop's.
        root: Root of the file system with the kernel's files.
    """
    cpu = root / "sys/devices/system/cpu"
    preempt = text_of(root / "sys/kernel/realtime") == "1"
    isolated = core in _cores(text_of(cpu / "isolated"))
    line = f"isolcpus={core} nohz_full={core} rcu_nocbs={core}"
    rows = [
        Check(
            "kernel",
            True,
            "PREEMPT_RT" if preempt else "no PREEMPT_RT",
            "PREEMPT_RT",
            "" if preempt else "install a kernel with PREEMPT_RT, which bounds the lateness",
        ),
        Check(
            "core isolation",
            True,
            f"core {core} is {'isolated' if isolated else 'shared'}",
            "a core of its own",
            "" if isolated else f"`{line}` on the kernel's command line, realtime.core={core}",
        ),
    ]
    governor = text_of(cpu / f"cpu{core}/cpufreq/scaling_governor")
    if governor:
        fix = "" if governor == "performance" else "`sudo cpupower frequency-set -g performance`"
        rows.append(Check("frequency scaling", True, governor, "performance", fix))
    lines = text_of(root / "proc/cpuinfo").splitlines()
    flags = next((line for line in lines if line.startswith("flags")), "")
    if "hypervisor" in flags.split() or text_of(root / "sys/hypervisor/type"):
        rows.append(
            Check(
                "host",
                True,
                "a virtual machine: its host can stall it",
                "a machine of its own",
                "run on the physical machine; no setting of the virtual one helps",
            )
        )
    return rows


def start_text(settings: Sequence[Check], setup: Sequence[Check]) -> str:
    """Return what was granted, a line for each setting that was not, and what could be better.

    Args:
        settings: Settings from ``realtime.apply``.
        setup: Settings of the machine from ``machine_setup``; shown in short.
    """
    granted = [each for each in settings if each.ok]
    head = f"{START} {len(granted)} of {len(settings)} granted"
    if len(granted) == len(settings):
        head += f" ({', '.join(each.found for each in settings)})"
    lines = [head]
    for each in settings:
        if not each.ok:
            fix = f"; to grant it: {each.fix}" if each.fix else ""
            lines.append(f"  {each.name}: wanted {each.wanted}, {each.found}{fix}")
    if better := [each.found for each in setup if each.fix]:
        lines.append(f"  could be better: {'; '.join(better)}")
    return "\n".join(lines)


def _cores(text: str) -> set[int]:
    """Return the numbers of a list such as ``1-3,5``."""
    cores: set[int] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        cores |= set(range(int(first), int(last or first) + 1))
    return cores
