"""``haptic-wall bench``: what the command tells of its sections, and what some of them find.

Nothing is asserted about speed; the work is cut down so that the test is quick.
"""

import json
import sys
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from haptic_wall.controller.bench import boundary
from haptic_wall.controller.bench.rows import Measurement, Section, over_rounds
from haptic_wall.controller.cli.bench import SECTIONS
from haptic_wall.controller.errors import PlatformError
from tests.support.program import Cli

FOUND = Section(
    (
        over_rounds("first <loop>, p99", [12.25, 11.0, 14.5], "µs"),
        Measurement("settings in a second", 423456.0, "settings/s"),
        Measurement("ratio", 0.875, "1"),
    ),
    ("somebody is not installed",),
)


def test_a_section_that_needs_no_bus_measures(monkeypatch: pytest.MonkeyPatch, cli: Cli) -> None:
    monkeypatch.setattr(boundary, "_ROUNDS", 1)
    monkeypatch.setattr(boundary, "_MIXED", 500)
    monkeypatch.setattr(boundary, "_COMPARED", 3)
    report = cli.json("bench", "--section", "boundary")["sections"]["boundary"]
    assert report["rows"][0]["name"] == "500 mixed settings"
    assert all(row["value"] > 0.0 for row in report["rows"])


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., object]], None]:
    """Every section is a made-up one; the function given takes the place of their ``measure``."""

    def become(measure: Callable[..., object]) -> None:
        monkeypatch.setitem(sys.modules, "made_up", SimpleNamespace(measure=measure))
        for name in SECTIONS:
            monkeypatch.setitem(SECTIONS, name, "made_up")

    become(lambda: FOUND)
    return become


@pytest.mark.usefixtures("made_up")
def test_the_json_holds_machine_versions_and_every_section(cli: Cli) -> None:
    report = cli.json("bench")
    assert list(report["sections"]) == list(SECTIONS)
    on = {"processor", "cores", "system", "kernel"}
    assert on == set(report["machine"])
    ours = {"haptic-wall", "python", "numpy", "scipy"}
    peers = {"control", "cyclictest", "dynamixel-sdk", "loop-rate-limiters", "rustypot"}
    assert ours | peers | {"numba"} == set(report["versions"])
    section = report["sections"]["lateness"]
    assert [row["value"] for row in section["rows"]] == [row.value for row in FOUND.rows]
    assert section["rows"][0]["low"] < 12.25 < section["rows"][0]["high"]
    assert section["notes"] == list(FOUND.notes)


@pytest.mark.parametrize(
    ("error", "said"),
    [(PlatformError("no bus"), "no bus"), (AttributeError("a new peer"), "AttributeError: a new")],
)
def test_a_section_that_fails_costs_no_other(
    made_up: Callable[[Callable[..., object]], None], cli: Cli, error: Exception, said: str
) -> None:
    sections = iter([error])

    def measure() -> Section:
        if (failed := next(sections, None)) is not None:
            raise failed
        return FOUND

    made_up(measure)
    status, out, err = cli("bench", "--json")
    assert status == 0
    assert "measuring lateness (1 of 6)" in err.splitlines()[0]
    first, *others = json.loads(out)["sections"].values()
    assert first["rows"] == []
    assert first["notes"][0].startswith(f"not measured: {said}")
    assert all(len(other["rows"]) == len(FOUND.rows) for other in others)
