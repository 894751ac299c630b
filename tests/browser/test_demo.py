"""The lesson in a headless Chromium: a step asks both servos for its wall, and both get it."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from haptic_wall.controller.logs.reader import LogReader
from tests.browser.test_page import program
from tests.support.chromium import Tab

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser")]
PATIENT_S = 60.0


def applied(folder: Path, servo: str) -> list[str]:
    """Return the changes that a servo's run has made; its log may not be there yet."""
    return [
        text
        for log in folder.glob(f"haptic-wall-demo-*/{servo}/run.hwlog")
        for change in LogReader.open(log).changes
        if change["outcome"] == "applied"
        for text in change["set"]
    ]


def test_a_step_changes_both_walls(
    tab: Tab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with program("demo") as (_, address):
        tab.open(address)
        assert tab.wait("document.getElementById('title').textContent") == "1. A soft wall"
        assert tab.value("[...document.querySelectorAll('iframe')].every((each) => each.src)")
        time.sleep(5.0)  # the pages in the frames connect
        tab.value("document.getElementById('next').click()")
        assert tab.value("document.getElementById('title').textContent").startswith("2. ")
        end_s = time.monotonic() + PATIENT_S
        while time.monotonic() < end_s:
            time.sleep(0.5)
            if all(
                "wall.stiffness=10.1" in applied(tmp_path, each) for each in ("free", "guarded")
            ):
                return
        pytest.fail(f"changes: {applied(tmp_path, 'free')}, {applied(tmp_path, 'guarded')}")
