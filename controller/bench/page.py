"""The report as one HTML file that needs nothing else: pictures are embedded."""

from __future__ import annotations

import base64
import time
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from haptic_wall.controller.bench import words
from haptic_wall.controller.bench.picture import png


def page(report: Mapping[str, Any]) -> str:
    """The page's text.

    Args:
        report: From ``report.measured``, or read from what ``--json`` printed.
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = (
        files("haptic_wall.controller.bench").joinpath("page.html.j2").read_text(encoding="utf-8")
    )
    pictures = {
        name: [
            (_embedded(png(histogram)), histogram["name"])
            for histogram in section["histograms"]
            if histogram["series"]
        ]
        for name, section in report["sections"].items()
    }
    return environment.from_string(source).render(
        r=report,
        words=words,
        pictures=pictures,
        written=time.strftime("%Y-%m-%d %H:%M"),
    )


def _embedded(picture: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")
