"""What the scan command lists, and what it says of wrong input."""

import json
from pathlib import Path

import pytest
import yaml

from haptic_wall.controller.cli import scan as module
from tests.hw.emulated.test_emulated_server import emulate
from tests.support.program import Cli


def test_without_an_adapter_the_port_is_asked_for(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("haptic_wall.controller.doctor.adapter.list_ports.comports", list)
    status, out, err = cli("scan")
    assert (status, out) == (4, "")
    assert "--port" in err


def test_a_port_that_is_not_there_ends_with_4(cli: Cli, tmp_path: Path) -> None:
    status, _, err = cli("scan", "--port", str(tmp_path / "ttyUSB0"))
    assert status == 4
    assert "does not exist" in err


@pytest.mark.whole
@pytest.mark.realtime
def test_servos_are_found_at_whatever_rate_they_are(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    servos = [f"--servo={each}" for each in ("XM430-W350:3", "XL330-M288:7", "XH430-W350:9")]
    with emulate(*servos, "--baud=57600") as (_, port):
        status, out, err = cli("scan", "--port", port, "--json")
        found = json.loads(out)
        assert status == 0
        assert [(s["id"], s["baud"], s["model"]) for s in found["servos"]] == [
            (3, 57600, "XM430-W350"),
            (7, 57600, "XL330-M288"),
            (9, 57600, "XH430-W350"),
        ]
        assert [s["current_mode"] for s in found["servos"]] == [True] * 3
        assert len(found["bauds"]) == 8
        assert "4000000 bit/s" in err
        monkeypatch.setattr(module, "LIKELY_FIRST", (57600,))
        axes = yaml.safe_load(cli("scan", "--port", port).out.partition("\naxes:")[2])
        assert axes["axis_9"] == {"servo": {"id": 9, "model": "XH430-W350"}}
        assert list(axes) == ["axis_3", "axis_7", "axis_9"]
        monkeypatch.setattr(module, "LIKELY_FIRST", (1_000_000, 2_000_000))
        status, out, _ = cli("scan", "--port", port)
        assert status == 4
        assert "Nothing answers" in out


@pytest.mark.realtime
def test_two_servos_with_one_id_are_named_though_they_answer_a_ping_alike(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LIKELY_FIRST", (4_000_000,))
    servos = ["--servo=XM430-W350:3", "--servo=XM430-W350:3", "--servo=XM430-W350:4"]
    with emulate(*servos) as (_, port):
        status, out, _ = cli("scan", "--port", port)
    assert status == 0
    (two,) = [line for line in out.splitlines() if "two servos have this id" in line]
    assert two.split()[0] == "3"
