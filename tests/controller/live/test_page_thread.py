"""The live page's thread: it serves the page before the run is there."""

from __future__ import annotations

import subprocess
import sys


def test_the_page_is_served_before_what_is_slow_to_import() -> None:
    """Without these two it starts in a quarter of the time."""
    place = "haptic_wall.controller.live"
    code = f"import sys, {place}.door, {place}.page_thread; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "pydantic"} & set(done.stdout.split())
