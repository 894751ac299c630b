"""A plugin of mypy that lets it look for garbage rarely: that took a quarter of its time."""

import gc

from mypy.plugin import Plugin

gc.set_threshold(4_000_000, 10, 1000)  # mypy says 200_000: 21 s for it, not 6, and 565 MB, not 895


def plugin(_version: str) -> type[Plugin]:
    """Return a plugin that does nothing else."""
    found: type[Plugin] = Plugin
    return found
