"""A run of several axes: each is what it would be alone, and the end of one is the end of all."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.table import read_log
from haptic_wall.controller.processes.inline import run_inline
from haptic_wall.controller.processes.plan import LogState, Plan
from haptic_wall.controller.processes.run import _finished_log
from haptic_wall.controller.processes.run_report import run_report
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.session_result import all_axes
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import Clock, SimulatedClock
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.dynamixel.tables import MODELS
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.emulated.memory_line import MemoryLine
from haptic_wall.hw.emulated.servo import EmulatedServo
from haptic_wall.hw.errors import UnfitServoError
from haptic_wall.hw.settings import ServoSettings
from tests.support.memory_session import run_in_memory
from tests.support.program import Cli
from tests.support.simulated_run import session

SETS = (
    *("loop.clock=simulated", "loop.rate_hz=500", "servo.hand=none", "wall.side=both"),
    "axes={shoulder: {}, elbow: {}, trigger: {}}",
    *("axes.shoulder.servo.kick=0.1", "axes.shoulder.wall.stiffness=3"),
    *("axes.elbow.servo.kick=-0.05", "axes.elbow.servo.inertia=0.002", "axes.elbow.servo.sign=-1"),
    *("axes.trigger.wall.law=none", "axes.trigger.servo.kick=0.3"),
)
NAMES = ("shoulder", "elbow", "trigger")
TWO = ("axes={one: {servo: {id: 1}}, two: {servo: {id: 2}}}", "servo.hand=none")


def logged(config: Config, log: Path, **otherwise: Any) -> dict[str, Any]:
    """Run half a second into a log, and end it so or otherwise; return the report."""
    telemetry = Telemetry.create(len(config.each))
    plan = Plan(config, 0.5, log, {"name": "a", "config": config.model_dump(mode="json")}, None)
    ended = replace(run_inline(plan, telemetry), **otherwise)
    assert _finished_log(plan, ended, telemetry.words) is LogState.WHOLE
    telemetry.close()
    return run_report(config, ended, None, None)


def test_each_axis_runs_and_is_logged_as_if_it_were_alone(tmp_path: Path) -> None:
    config = load_config("simulated", SETS).config
    whole = logged(config, tmp_path / "all.hwlog")
    assert whole["guard"] is None and whole["stop_axis"] is None
    read = LogReader.open(tmp_path / "all.hwlog")
    assert read.axes == tuple(whole["axes"]) == NAMES
    parts = []
    for name, one in config.each.items():
        alone = logged(one, tmp_path / f"{name}.hwlog")
        assert "axes" not in alone
        assert whole["axes"][name].items() <= (alone | {"bus": None}).items()
        parts.append(alone)
        own, theirs = LogReader.open(tmp_path / f"{name}.hwlog"), read.axis(name)
        assert np.array_equal(own.rows().view(np.int64), theirs.rows().view(np.int64)), "to the bit"
        for key in ("servo", "wall", "model", "loop"):  # a load is beside the bare servo in both
            assert own.metadata["config"][key] == theirs.metadata["config"][key]
        assert own.end is not None and theirs.end is not None
        assert {key: theirs.end[key] for key in ("guard", "oscillation", "torque", "servo")} == {
            key: own.end[key] for key in ("guard", "oscillation", "torque", "servo")
        }
    assert whole["torque"]["max"] == max(part["torque"]["max"] for part in parts) > 0.0
    assert whole["axes"]["trigger"]["torque"]["max"] == 0.0, "its law is none"
    with pytest.raises(UserError, match=r"one of shoulder, elbow, trigger; did you mean elbow\?"):
        read.axis("elbwo")


def test_the_log_of_a_loop_that_died_has_the_torque_of_each_axis(tmp_path: Path) -> None:
    log = tmp_path / "a.hwlog"
    logged(load_config("simulated", SETS).config, log, stop_reason=Trip.LOOP_DIED, result=None)
    read = LogReader.open(log)
    assert read.end is not None and read.end["torque"]["max"] > 0.0
    trigger = read.axis("trigger").end
    assert trigger is not None and trigger["torque"]["max"] == 0.0, "its law is none"


def test_a_log_of_several_axes_is_one_table_with_their_names(tmp_path: Path, cli: Cli) -> None:
    log, all_of, one_of = (tmp_path / name for name in ("a.hwlog", "a.csv", "one.csv"))
    logged(load_config("simulated", SETS).config, log)
    rows = read_log(log).rows
    assert {"time_s", "seq", "elbow.position_rad", "trigger.torque_nm"} <= set(
        rows.dtype.names or ()
    )
    assert cli("log", log, "--csv", all_of).status == 0
    assert cli("log", log, "--axis", "elbow", "--csv", one_of).status == 0
    with all_of.open() as whole, one_of.open() as part:
        pairs = list(zip(csv.DictReader(whole), csv.DictReader(part), strict=True))
    assert len(pairs) == len(rows)
    for both, own in pairs:
        assert both["elbow.position_rad"] == own["position_rad"]
        assert both["time_s"] == own["time_s"]
    refused = cli.refused("detect", log)
    assert "--axis: found none, wanted one of shoulder, elbow, trigger" in refused
    assert cli("detect", log, "--axis", "shoulder", "--stiffness", "3").status == 0


def test_all_axes_count_the_longest_device_delay(tmp_path: Path) -> None:
    sets = (*SETS, "axes.elbow.servo.delay=0.003")
    report = logged(load_config("simulated", sets).config, tmp_path / "a.hwlog")
    delays = [part["delay_s"]["total"] for part in report["axes"].values()]
    assert delays == [pytest.approx(0.003)] * 3
    assert report["delay_s"]["total"] == pytest.approx(0.003)


def test_an_axis_is_decided_for_its_own_delay_too_if_that_of_another_is_longer(
    tmp_path: Path,
) -> None:
    sets = (
        *("loop.clock=simulated", "servo.hand=none", "servo.counts_per_rev=0", "wall.side=both"),
        *("wall.stiffness=1e6", "wall.damping=1e3", "servo.coulomb=0", "servo.kick=0.01"),
    )
    link = {
        **{"inertia": 0.005745, "load_inertia": 0.004255, "damping": 0.0179, "delay": 0.000295},
        **{"transmission_stiffness": 3799.0, "transmission_damping": 0.0918},
    }
    one = [f"axes.one.servo.{name}={value}" for name, value in link.items()]
    pair = (
        *sets,
        "axes={one: {}, other: {}}",
        *one,
        "axes.other.servo.delay=0.001441",
        "axes.other.wall.law=none",
    )
    report = logged(load_config("simulated", pair).config, tmp_path / "a.hwlog")
    both = "model.delay={value: 0.001441, low: 0.000295, high: 0.001441}"
    alone = (*sets, *(f"servo.{name}={value}" for name, value in link.items()), both)
    alone = (*alone, "model.bare=true")
    expected = logged(load_config("simulated", alone).config, tmp_path / "b.hwlog")
    assert report["axes"]["one"]["guard"]["commanded"] == expected["guard"]["commanded"]
    assert report["axes"]["one"]["torque"]["saturated_ticks"] == 0


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("unplug:id=2,at=1", "trip:losses_in_row"),
        ("hardware-error:bits=overload,id=2,at=1", "trip:hardware_error"),
    ],
)
def test_an_axis_that_is_lost_or_ill_takes_the_torque_from_all(fault: str, reason: str) -> None:
    kicked = "axes.one.servo.kick=0.05", "wall.side=both", "wall.stiffness=2"
    run = run_in_memory((*TWO, *kicked), 2.0, faults=[fault])
    assert (run.result.stop_reason, run.result.stop_axis) == (reason, "two")
    assert run.ticks["torque"][-1] == 0.0 and run.ticks["torque"].any(), "of the other axis"
    assert run.result.torque_off is ("unplug" not in fault)
    left = "torque off was not read back from XM430-W350 id 2 on memory"
    assert (left in run.result.message) is not run.result.torque_off
    ends = [event.state.torque for event in run.truth if event.event == "state"][-2:]
    assert ends == [0.0, 0.0]


def test_the_axis_whose_driver_ends_the_run_is_named() -> None:
    run = run_in_memory(TWO, 2.0, faults=["ambient:celsius=79,id=2,at=1"])
    assert (run.result.stop_reason, run.result.stop_axis) == ("trip:servo_health", "two")
    assert "id 2 on memory has 79 °C" in run.result.message


def opened(
    servos: Sequence[ServoSettings], clock: Clock, *models: str
) -> tuple[DynamixelGroup, list[EmulatedServo]]:
    """Servos of these models on a bus in memory, whatever the settings say."""
    truths = [
        EmulatedServo(MODELS[model], one.id, 48, one.true, start_ns=0, baud=one.baud)
        for model, one in zip(models, servos, strict=True)
        if one.true is not None
    ]
    assert isinstance(clock, SimulatedClock)
    line = MemoryLine(EmulatedBus(truths, baud=servos[0].baud, start_ns=0), clock)
    return DynamixelGroup(servos, line), truths


def test_a_servo_that_is_refused_is_named_with_its_axis() -> None:
    def opener(servos: Sequence[ServoSettings], clock: Clock, _port: int | None) -> DynamixelGroup:
        return opened(servos, clock, "XM430-W350", "XM540-W270")[0]

    with pytest.raises(UnfitServoError) as refused:
        session("emulated-ideal", *TWO, telemetry=Telemetry.create(2), opener=opener)
    assert str(refused.value).startswith("two: The servo with id 2")
    assert "set servo.model=XM540-W270" in str(refused.value)


def test_no_further_servo_is_started_once_the_run_is_to_stop() -> None:
    telemetry, made = Telemetry.create(2), list[EmulatedServo]()

    def opener(servos: Sequence[ServoSettings], clock: Clock, _port: int | None) -> DynamixelGroup:
        group, truths = opened(servos, clock, "XM430-W350", "XM430-W350")
        made.extend(truths)
        meet = group.servos[0].meet

        def interrupted() -> int:
            telemetry.words[Word.STOP] = 1
            return meet()

        group.servos[0].meet = interrupted  # type: ignore[method-assign]
        return group

    result, _ = session("emulated-ideal", *TWO, telemetry=telemetry, opener=opener)
    assert (result.stop_reason, result.torque_off) == ("interrupted", True)
    assert [one.memory["torque_enable"] for one in made] == [0, 0]
    assert made[0].memory["bus_watchdog"] > 0 == made[1].memory["bus_watchdog"], "never set up"


def test_of_several_quiet_axes_the_report_tells_the_probes() -> None:
    quiet = {"state": "quiet", "amplitude_rad": None, "probed_s": 2.0}
    parts = [
        {"oscillation": quiet | {"probes": probes}, "wall_came_on": True, "bus": None}
        for probes in (0, 3, 1)
    ]
    assert all_axes(parts)["oscillation"]["probes"] == 3
