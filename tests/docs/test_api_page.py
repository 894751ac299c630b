"""The examples of the page for other people's programs run, in order, in one folder."""

import os
import re
from pathlib import Path
from typing import Any

import pytest

import haptic_wall
from tests.docs.pages import text_of
from tests.support.program import python

PAGE = "docs/how-to/api.md"
EXAMPLES = re.findall(r"^```python\n(.*?)^```", text_of(PAGE), re.M | re.S)

END = "-- end\n"
EACH = f"""
import runpy, sys
for path in sys.argv[1:]:
    runpy.run_path(path)
    print(end={END!r}, flush=True)
"""


@pytest.mark.whole
@pytest.mark.realtime
def test_the_examples_run(tmp_path: Path, wholly: bool) -> None:
    paths = []
    for number, example in enumerate(EXAMPLES if wholly else EXAMPLES[1:]):
        patient = re.sub(r'"servo.(hand|port)"', r'"realtime.profile": "off", \g<0>', example)
        paths.append(tmp_path / f"example{number}.py")
        paths[-1].write_text(patient)
    told: list[list[str]] = []
    for some in [[path] for path in paths] if wholly else [paths]:  # alone, or in one process
        here = {"cwd": tmp_path, "env": os.environ | {"PYTHONPATH": ""}}
        done = python("-W", "error", "-c", EACH, *some, **here, timeout=300)
        assert done.returncode == 0, done.stderr
        told += [text.split() for text in done.stdout.split(END)[:-1]]
    if wholly:
        ended, stiffness = told.pop(0)
        assert ended == "interrupted"
        assert 0.0 < float(stiffness) <= 4.0  # a machine that runs tests has late ticks: less K
    assert 20.0 < float(told[0][0]) < 100.0  # of 1e6
    assert told[1][0] == "('',)" and told[1][1] == "{'':"
    assert float(told[2][-1]) == 1e6
    assert float(told[-2][0].lstrip("[")) > 0.0
    assert told[-1][0] == "duration"


def test_the_law_on_its_page_is_one() -> None:
    (example,) = re.findall(r"^```python\n(.*?)^```", text_of("docs/how-to/laws.md"), re.M | re.S)
    there: dict[str, Any] = {}
    exec(example, there)
    law: haptic_wall.Law = there["Ridge"]()
    assert law.low < 0.0 < law.high and law.torque(0.1) > 0.0


def test_every_name_is_on_the_page() -> None:
    named = {*re.findall(r"`([\w.]+)`", text_of(PAGE)), "Log", "RunningWall"}
    assert {*haptic_wall.__all__} - named == set()
