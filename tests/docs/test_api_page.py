"""The examples of the page for other people's programs run, in order, in one folder."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import haptic_wall
from tests.docs.pages import text_of

PAGE = "docs/api.md"
EXAMPLES = re.findall(r"^```python\n(.*?)^```", text_of(PAGE), re.M | re.S)


@pytest.mark.realtime
def test_the_examples_run(tmp_path: Path) -> None:
    told = []
    for example in EXAMPLES:
        name = re.match(r"# (\w+\.py)\n", example)
        (tmp_path / (name[1] if name else "example.py")).write_text(example)
        patient = re.sub(r'"servo.(hand|port)"', r'"realtime.profile": "off", \g<0>', example)
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", patient],
            cwd=tmp_path, env=os.environ | {"PYTHONPATH": ""}, capture_output=True, text=True,
            check=False, timeout=120,
        )  # fmt: skip
        assert done.returncode == 0, example + done.stderr
        told.append(done.stdout.split())
    assert told[0][0] == "interrupted"
    assert 0.0 < float(told[0][1]) <= 4.0  # a machine that runs tests has late ticks, which cost K
    assert 20.0 < float(told[1][0]) < 100.0  # of 1e6
    assert float(told[2][-1]) == 1e6
    assert float(told[-2][0]) > 0.0
    assert told[-1][0] == "duration"


def test_every_name_is_on_the_page() -> None:
    named = {*re.findall(r"`([\w.]+)`", text_of(PAGE)), "Boundary", "Log", "RunningWall"}
    assert {*haptic_wall.__all__} - named == set()
