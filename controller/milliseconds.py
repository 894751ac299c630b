"""Formats times for people."""

from __future__ import annotations


def ms(seconds: float) -> str:
    """Format a time in milliseconds, with three digits and no more than microseconds."""
    return f"{round(1e3 * seconds, 3):.3g} ms"
