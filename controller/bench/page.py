"""Makes an HTML page of the bench's results."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from haptic_wall.controller.bench import words
from haptic_wall.controller.bench.picture import png
from haptic_wall.controller.report.html import embedded, filled_in


def page(report: Mapping[str, Any]) -> str:
    """Return the page's text.

    Args:
        report: Report from ``report.measured``, or read from the output of ``--json``.
    """
    pictures = {
        name: [
            (embedded(png(histogram)), histogram["name"])
            for histogram in section["histograms"]
            if histogram["series"]
        ]
        for name, section in report["sections"].items()
    }
    return filled_in(
        __package__,
        r=report,
        words=words,
        pictures=pictures,
        written=time.strftime("%Y-%m-%d %H:%M"),
    )
