"""Finds settings of the machine that make a loop late, beyond what a process may request."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from haptic_wall.controller.runtime.realtime import Setting

START = "real time:"
"""Beginning of the table at the start"""
_ENOUGH_SHARE = 0.9
"""Fraction of each second for real-time processes: the loop sleeps longer than the rest"""


@dataclass(frozen=True, slots=True)
class SettingState:
    """The state of one setting, and a better one for a loop."""

    name: str
    found: str
    better: str
    remedy: str
    """How to change it; empty: it is fine"""


def machine_setup(core: int, root: Path = Path("/")) -> list[SettingState]:
    """Return the settings of this machine that make a loop late; never a reason to refuse.

    Unknown settings (in a container, on another processor) are omitted.

    Args:
        core: The loop's.
        root: Root of the file system with the kernel's files.
    """
    cpu = root / "sys/devices/system/cpu"
    preempt = _text(root / "sys/kernel/realtime") == "1"
    isolated = core in _cores(_text(cpu / "isolated"))
    line = f"isolcpus={core} nohz_full={core} rcu_nocbs={core}"
    rows = [
        SettingState(
            "kernel",
            "PREEMPT_RT" if preempt else "no PREEMPT_RT",
            "PREEMPT_RT",
            "" if preempt else "install a kernel with PREEMPT_RT, which bounds the lateness",
        ),
        SettingState(
            "core isolation",
            f"core {core} is {'isolated' if isolated else 'shared'}",
            "a core of its own",
            "" if isolated else f"`{line}` on the kernel's command line, realtime.core={core}",
        ),
    ]
    governor = _text(cpu / f"cpu{core}/cpufreq/scaling_governor")
    if governor:
        fix = "" if governor == "performance" else "`sudo cpupower frequency-set -g performance`"
        rows.append(SettingState("frequency scaling", governor, "performance", fix))
    siblings = _cores(_text(cpu / f"cpu{core}/topology/thread_siblings_list")) - {core}
    if siblings:
        other = ", ".join(map(str, sorted(siblings)))
        rows.append(
            SettingState(
                "core's other half",
                f"core {core} shares its hardware with core {other}",
                "nothing runs there",
                f"isolate core {other} too, or switch hyper-threading off",
            )
        )
    rows += _throttle(root / "proc/sys/kernel")
    pages = _text(root / "sys/kernel/mm/transparent_hugepage/enabled")
    if pages:
        chosen = pages.partition("[")[2].partition("]")[0]
        fix = "`echo madvise | sudo tee /sys/kernel/mm/transparent_hugepage/enabled`"
        rows.append(
            SettingState(
                "huge pages", chosen, "madvise or never", fix if chosen == "always" else ""
            )
        )
    if is_virtual(root):
        rows.append(
            SettingState(
                "host",
                "a virtual machine: its host can stall it",
                "a machine of its own",
                "run on the physical machine; no setting of the virtual one helps",
            )
        )
    return rows


def is_virtual(root: Path = Path("/")) -> bool:
    """Whether this is a virtual machine, whose host can take its cores."""
    lines = _text(root / "proc/cpuinfo").splitlines()
    flags = next((line for line in lines if line.startswith("flags")), "")
    return "hypervisor" in flags.split() or bool(_text(root / "sys/hypervisor/type"))


def start_table(settings: Sequence[Setting], setup: Sequence[SettingState]) -> str:
    """Return the settings wanted and granted: one line when all were granted, else a table.

    Args:
        settings: Settings from ``realtime.apply``.
        setup: Settings of the machine from ``machine_setup``; shown in short.
    """
    granted = sum(setting.ok for setting in settings)
    head = f"{START} {granted} of {len(settings)} granted"
    better = [row for row in setup if row.remedy]
    tail = f"could be better: {'; '.join(row.found for row in better)}" if better else ""
    if granted == len(settings):
        head += f" ({', '.join(setting.got for setting in settings)})"
        return f"{head}\n  {tail}" if tail else head
    name = max(len(setting.name) for setting in settings)
    wish = max(len("wanted"), *(len(setting.wanted) for setting in settings))
    lines = [head, f"  {'':<{name}}  {'wanted':<{wish}}  got"]
    for setting in settings:
        lines.append(f"  {setting.name:<{name}}  {setting.wanted:<{wish}}  {setting.got}")
        if setting.remedy:
            lines.append(f"  {'':<{name}}  to grant it: {setting.remedy}")
    return "\n".join([*lines, f"  {tail}"] if tail else lines)


def _throttle(kernel: Path) -> list[SettingState]:
    runtime, period = (_text(kernel / f"sched_rt_{name}_us") for name in ("runtime", "period"))
    if not (runtime and period):
        return []
    share = int(runtime) / int(period)
    found = "never" if share < 0 else f"after {100 * share:.3g} % of {int(period) / 1e6:g} s"
    enough = share < 0 or share >= _ENOUGH_SHARE
    fix = "" if enough else "`sudo sysctl kernel.sched_rt_runtime_us=950000`"
    return [
        SettingState("throttling", f"real-time processes are halted {found}", "95 % or never", fix)
    ]


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _cores(text: str) -> set[int]:
    """Return the numbers of a list such as ``1-3,5``."""
    cores: set[int] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        cores |= set(range(int(first), int(last or first) + 1))
    return cores
