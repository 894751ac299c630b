"""The doctor on emulated buses with something wrong: what it finds, mends, and leaves alone.

What is measured is not held here: a machine that runs tests stalls at will. The judging of it has
tests of its own.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from haptic_wall.controller.doctor.checkup import examine
from haptic_wall.controller.doctor.report import Report
from haptic_wall.controller.doctor.search import BaudSearch, opened, search
from haptic_wall.controller.doctor.text import text
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.dynamixel.register_access import Table
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.errors import BaudRefusedError
from haptic_wall.hw.serialport import port as serial_port
from tests.hw.emulated.test_emulated_server import emulate
from tests.support.program import Cli

TIMED = {
    "reply time",
    "sustainable rate",
    "wake-up lateness",
}
QUIET = ["--set", "realtime.profile=off"]


def report(
    cli: Cli, *arguments: str
) -> tuple[int, dict[str, dict[str, Any]], set[str], dict[str, Any]]:
    status, out, err = cli("doctor", *arguments, *QUIET, "--json")
    assert "Traceback" not in err
    found = json.loads(out)
    checks = {check["name"]: check for check in found["checks"]}
    keys = {"name", "ok", "found", "wanted", "fix"}
    assert all(keys <= check.keys() for check in found["checks"])
    wrong = {name for name, check in checks.items() if not check["ok"]}
    assert status == (4 if not found["reached"] else 1 if wrong else 0)
    return status, checks, wrong - TIMED, found


def at(port: str | Path) -> list[str]:
    return ["xm430-w350", "--set", f"servo.port={port}"]


def set_registers(port: str, **values: int) -> None:
    with opened(port, 4_000_000, MonotonicClock()) as line:
        table = Table.on(line, 4_000_000, 1, port, MODELS["XM430-W350"])
        for name, value in values.items():
            table.write(name, value)


def test_a_simulated_servo_has_no_bus_to_look_at(cli: Cli) -> None:
    _, checks, wrong, found = report(cli, "simulated")
    assert wrong == set()
    assert found["reached"]
    assert not checks["bus"]["applies"]
    assert "simulated" in checks["bus"]["found"]
    assert checks["wake-up lateness"]["applies"]


def test_a_port_that_is_not_there_ends_with_4_and_the_machine_is_examined_all_the_same(
    cli: Cli, tmp_path: Path
) -> None:
    status, checks, wrong, _ = report(cli, *at(tmp_path / "ttyUSB0"))
    assert status == 4
    assert wrong == {"port"}
    assert "servo answers" not in checks
    assert "kernel" in checks


@pytest.mark.realtime
def test_a_servo_as_from_the_factory_is_mended_when_asked(cli: Cli) -> None:
    with emulate() as (_, port):
        status, checks, wrong, found = report(cli, *at(port))
        assert status == 1
        assert wrong == {"return delay"}
        assert checks["return delay"]["found"] == "250"
        assert found["changes"] == []
        assert checks["torque"]["found"] == "off"
        assert checks["latency timer"]["applies"] is False
        _, checks, wrong, found = report(cli, *at(port), "--fix")
        assert wrong == set()
        assert found["changes"] == [
            {"name": "return delay", "before": "250", "after": "0", "verified": True}
        ]
        assert checks["return delay"]["found"] == "0"


@pytest.mark.whole
@pytest.mark.realtime
def test_a_servo_at_another_rate_is_found_examined_and_changed_only_when_asked(cli: Cli) -> None:
    with emulate("--baud", "57600") as (_, port):
        status, checks, wrong, found = report(cli, *at(port), "--fix")
        assert status == 1
        assert wrong == {"servo answers"}
        assert checks["servo answers"]["found"] == "at 57600 bit/s"
        # 57600 is no rate for 1 kHz, so it is not proposed
        fix = checks["servo answers"]["fix"]
        assert fix.startswith("change the servo's rate")
        assert fix.endswith("--fix --change-baud`")
        assert "baud rate" not in checks, "not that of the port alone"
        assert checks["model"]["ok"]
        assert "reply time" not in checks
        _, checks, wrong, found = report(cli, *at(port), "--fix", "--change-baud")
        assert wrong == set()
        assert found["changes"][0]["after"] == "4000000"
        assert "reply time" in checks
        assert checks["baud rate"]["found"] == "4000000 bit/s"


@pytest.mark.realtime
def test_a_servo_that_is_late_is_asked_again(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the process of an emulated bus is on a machine whose cores are all busy."""
    unheard = [BaudSearch(4_000_000, [], 0)] * 3

    def late(*arguments: Any, **options: Any) -> BaudSearch:
        return unheard.pop() if unheard else search(*arguments, **options)

    monkeypatch.setattr("haptic_wall.controller.doctor.locate.search", late)
    with emulate() as (_, port):
        _, checks, _, _ = report(cli, *at(port))
    assert checks["servo answers"]["ok"]


@pytest.mark.realtime
def test_dangers_are_listed_together_and_a_torque_that_is_on_is_left_alone(cli: Cli) -> None:
    with emulate() as (_, port):
        set_registers(
            port, return_delay_time=0, drive_mode=9, startup_configuration=1, torque_enable=1
        )
        _, checks, wrong, found = report(cli, *at(port))
        assert wrong == {
            "torque",
            "drive mode",
            "start-up configuration",
        }
        assert "reply time" not in checks
        assert cli("doctor", *at(port), *QUIET)[1].count("WRONG") >= 3
        _, _, wrong, found = report(cli, *at(port), "--fix", "--yes")
        assert wrong == set()
        assert found["changes"][0]["name"] == "torque"
        assert all(change["verified"] for change in found["changes"])


@pytest.mark.realtime
def test_a_port_that_somebody_else_has_names_him(cli: Cli) -> None:
    with emulate() as (_, port), Path(port).open("rb") as end:
        other = subprocess.Popen(
            [sys.executable, "-c", "input()"], stdin=subprocess.PIPE, stdout=end.fileno()
        )
        try:
            status, checks, wrong, _ = report(cli, *at(port))
        finally:
            other.communicate(b"\n")
    assert status == 4
    assert wrong == {"used by"}
    assert str(other.pid) in checks["used by"]["found"]
    # He may be driving a servo: his core is not taken from him to measure how punctual it is.
    assert not {"wake-up lateness", "model"} & checks.keys()


@pytest.mark.whole
@pytest.mark.realtime
def test_a_servo_is_never_set_to_a_rate_that_this_adapter_cannot_make(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    opens = serial_port.open_port

    def refuses_4_mbit(path: str, baud: int) -> int:
        if baud == 4_000_000:
            raise BaudRefusedError(f"Port {path} refuses {baud} baud: set servo.baud.")
        return opens(path, baud)

    monkeypatch.setattr("haptic_wall.controller.doctor.search.open_port", refuses_4_mbit)
    with emulate("--baud", "1000000") as (_, port):
        _, checks, wrong, found = report(cli, *at(port), "--fix", "--change-baud")
        assert "baud rate" not in [change["name"] for change in found["changes"]]
        assert {"baud rate", "servo answers"} <= wrong
        assert checks["servo answers"]["found"] == "at 1000000 bit/s"
        assert checks["servo answers"]["fix"] == "set servo.baud=1000000"


@pytest.mark.whole
@pytest.mark.realtime
@pytest.mark.parametrize(("level", "fix"), [(2, []), (0, ["--fix"]), (1, ["--fix"])])
def test_two_servos_with_one_id_are_told_from_a_bad_cable(
    cli: Cli, level: int, fix: list[str]
) -> None:
    """One that keeps silent replies when the status return level may be written, as in a start."""
    with emulate("--servo", "XM430-W350:1", "--servo", "XM430-W350:2") as (_, port):
        with opened(port, 4_000_000, MonotonicClock()) as line:
            table = Table.on(line, 4_000_000, 2, port, MODELS["XM430-W350"])
            table.try_write("status_return_level", level, (3_000_000,))
            table.try_write("id", 1, (3_000_000,))
        _, checks, wrong, _ = report(cli, *at(port), *fix)
    assert wrong == {"servo answers"}
    assert "connect one of them, and give it another id" in checks["servo answers"]["fix"]


def arm(port: str, **ids: int) -> Report:
    """Of a doctor that examines axes by their ids."""
    axes = {name: {"servo": {"id": number}} for name, number in ids.items()}
    sets = [f"axes={axes}", f"servo.port={port}", "realtime.profile=off", "loop.rate_hz=500"]
    config = load_config("xm430-w350", sets).config
    return examine(config, lambda _: None, None, change_baud=False)


@pytest.mark.realtime
@pytest.mark.parametrize(
    "models",
    [
        ("XM430-W350", "XM430-W350"),
        pytest.param(("XM430-W350", "XM430-W210"), marks=pytest.mark.whole),
    ],
)
def test_two_servos_with_one_id_hide_no_other_axis(models: tuple[str, str]) -> None:
    servos = [f"--servo={each}:2" for each in models]
    with emulate("--servo=XM430-W350:1", *servos, "--servo=XM430-W350:3") as (_, port):
        found = arm(port, shoulder=1, elbow=2, wrist=3)
    assert "elbow.servo answers" in {check.name for check in found.wrong}
    elbow = found.found["elbow.servo answers"]
    assert "connect" in elbow.fix and "another id" in elbow.fix
    assert "id 2" in f"{elbow.found} {elbow.fix}"
    assert {"shoulder.drive mode", "wrist.drive mode"} <= found.found.keys()
    shown = text("arm", found).splitlines()
    assert shown[2].split() == ["shoulder", "elbow", "wrist"]
    assert "reply time" not in found.found


@pytest.mark.realtime
def test_the_servos_of_several_axes_are_examined_in_one_table() -> None:
    servos = [f"--servo=XM430-W350:{each}" for each in ("1", "2:44", "3")]
    with emulate(*servos) as (_, port):
        set_registers(port, drive_mode=1)
        found = arm(port, shoulder=1, elbow=2, wrist=3)
    wrong = {check.name for check in found.wrong}
    assert "shoulder.drive mode" in wrong
    assert not any(name.startswith(("elbow.drive", "wrist.drive")) for name in wrong)
    assert "(3 servos, sync read)" in found.found["sustainable rate"].found
    shown = text("arm", found).splitlines()
    assert shown[2].split() == ["shoulder", "elbow", "wrist"]
    (row,) = [line for line in shown if line.startswith("drive mode ")]
    assert row.split() == ["drive", "mode", "WRONG", "ok", "ok"]
    assert sum("servo answers" in line for line in shown) == 1
    assert sum("shoulder, elbow, wrist: 250 (wanted: 0)" in line for line in shown) == 1
