"""How long an adapter may keep a short reply to itself: the latency timer of FTDI parts."""

from __future__ import annotations

from pathlib import Path

CLASSES = Path("/sys/class/tty")


def timer_file(path: str, classes: Path = CLASSES) -> Path:
    """The file that holds the latency timer of the adapter behind a port, if it has one."""
    return classes / Path(path).resolve().name / "device" / "latency_timer"


def timer_ms(path: str, classes: Path = CLASSES) -> int | None:
    """The latency timer now [ms]; None: this adapter has none that the system knows of.

    Args:
        path: The port's device.
        classes: Where the system describes its ports.
    """
    try:
        return int(timer_file(path, classes).read_text())
    except (OSError, ValueError):
        return None
