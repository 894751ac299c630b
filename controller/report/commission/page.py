"""Makes the report of a commissioning as one HTML page."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from haptic_wall.controller.report.commission import words
from haptic_wall.controller.report.html import embedded, filled_in

_CAPTIONS = {
    "identify": "The motion to which the model was fitted, the torque, and the fit's residual.",
    "sweep": "Measured critical stiffness, over the limits of the identified servo.",
}


def page(report: Mapping[str, Any], folder: Path, allowed: Path | None) -> str:
    """Return the page's text.

    Args:
        report: The report's data.
        folder: Folder with the steps' pictures.
        allowed: The picture of the verdict; None: there is none.

    Raises:
        OSError: A picture cannot be read.
    """
    pictures = [
        (step["step"], embedded((folder / step["picture"]).read_bytes()), _CAPTIONS[step["step"]])
        for step in report["steps"]
        if step["state"] == "done" and step["picture"]
    ]
    return filled_in(
        __package__,
        r=report,
        written=time.strftime("%Y-%m-%d %H:%M"),
        headline=words.headline(report),
        why=list(words.why(report)),
        agrees=list(words.agrees(report)),
        unknown=list(words.unknown(report)),
        following=list(words.following(report)),
        model=list(words.model_rows(report)),
        wrong=list(words.wrong(report)),
        examined=len((report["doctor"] or {}).get("checks", ())),
        allowed=None if allowed is None else embedded(allowed.read_bytes()),
        pictures=pictures,
    )
