"""What the report says of a trip, where the reason depends on what is at the port."""

import os
from pathlib import Path
from typing import cast

import pytest

from haptic_wall.controller.processes.plan import Ended
from haptic_wall.controller.processes.run_report import (
    explanation,
    no_stiffness,
    run_report,
    warnings_of,
)
from haptic_wall.controller.runtime.safety import End, Trip
from haptic_wall.controller.runtime.statistics import RunStatistics
from haptic_wall.controller.settings.load import load_config
from tests.typed import not_none

GRANTED = [{"name": "scheduler", "ok": True}]


def ended_by(
    trip: str, port: str | Path, preset: str = "emulated-port", granted: bool = False, **result: str
) -> str:
    """What is said of a trip on a port."""
    servo = load_config(preset, [f"servo.port={port}"]).config.servo
    ended = Ended(Trip(f"trip:{trip}"), cast(RunStatistics, None), ticks=0, missed=0)
    ended.realtime, ended.result = GRANTED if granted else [], result
    return not_none(explanation(ended, servo))


STALL = "this computer stalled for 30 ms"


@pytest.mark.parametrize("trip", ["losses_in_row", "loss_rate", "servo_lost"])
def test_a_lost_servo_of_several_is_named_before_a_stall_of_the_computer(trip: str) -> None:
    said = ended_by(trip, "/dev/ttyUSB0", stalled=STALL, stop_axis="elbow")
    assert said.startswith("elbow: ") and "check " in said
    assert said.index("elbow: ") < said.index("check ") < said.index("against the stall, end")
    assert f", and {STALL} too; check " in said
    said = ended_by(trip, "/dev/ttyUSB0", stop_axis="elbow")
    assert "stall" not in said and "check " in said
    assert ended_by(trip, "/dev/ttyUSB0", stalled=STALL).startswith(f"{STALL}: ")


def test_the_cause_of_a_lost_servo_comes_first() -> None:
    gone = "The serial port is gone (it has hung up): check the cable, then start again."
    for port, own in (("/dev/ttyUSB0", ""), ("emulated", "the emulator at this port may have")):
        preset = "emulated-ideal" if port == "emulated" else "emulated-port"
        said = ended_by("servo_lost", port, preset, message=gone)
        assert said.startswith("The serial port is gone") and own in said
        assert "rights" not in said and "safety.max_loss" not in said
        said = ended_by("servo_lost", port, preset, message=gone, stalled=STALL)
        assert said.index("port is gone") < said.index(STALL) < said.index("end programs")


def test_rights_that_are_granted_are_no_advice() -> None:
    for stalled, port, preset in (
        ("", "emulated", "emulated-ideal"),
        (STALL, "/dev/ttyUSB0", "emulated-port"),
    ):
        assert "setup-testbed" in ended_by("loss_rate", port, preset, stalled=stalled)
        said = ended_by("loss_rate", port, preset, granted=True, stalled=stalled)
        assert "rights" not in said and "end programs that keep the cores busy" in said


@pytest.mark.parametrize(
    ("trip", "setting"),
    [("loss_rate", "safety.max_loss"), ("losses_in_row", "safety.max_silence_s")],
)
def test_on_a_pseudo_terminal_lost_replies_are_the_emulators(
    tmp_path: Path, trip: str, setting: str
) -> None:
    leader, follower = os.openpty()
    link = tmp_path / "bus"
    link.symlink_to(os.ttyname(follower))
    for port in (link, os.ttyname(follower), "emulated"):
        preset = "emulated-ideal" if port == "emulated" else "emulated-port"
        said = ended_by(trip, port, preset)
        assert "the emulator got no processor time" in said
        assert setting in said
        assert "cable" not in said
    os.close(leader)
    os.close(follower)
    assert "check cable, power" in ended_by(trip, "/dev/ttyUSB0")


@pytest.mark.parametrize(
    ("missed", "granted", "said"),
    [
        (0, False, ""),
        (7, False, "the loop missed 7 periods: it had no real-time priority"),
        (1, False, "the loop missed 1 period: it had no real-time priority"),
        (7, True, ""),
    ],
)
def test_missed_periods_have_their_reason_where_it_is_plain(
    missed: int, granted: bool, said: str
) -> None:
    ended = Ended(
        End.DURATION,
        RunStatistics(),
        ticks=100,
        missed=missed,
        realtime=GRANTED if granted else [],
    )
    assert "".join(warnings_of(ended)).startswith(said)
    assert bool(warnings_of(ended)) == bool(said)


def test_each_axis_has_its_own_torque_in_the_report_of_a_loop_that_died() -> None:
    config = load_config("simulated", ["axes={one: {}, two: {}}"]).config
    statistics = RunStatistics(2)
    statistics.max_torque[:] = 0.5, 0.2
    report = run_report(config, Ended(Trip.LOOP_DIED, statistics, 10, 0), None, None)
    assert {name: part["torque"]["max"] for name, part in report["axes"].items()} == {
        "one": 0.5,
        "two": 0.2,
    }


def test_a_belief_of_another_servo_is_warned_of() -> None:
    for model, inertia, warned in (("XM430-W350", 0.001, True), ("XM430-W350", 0.05, False)):
        sets = [f"servo.model={model}", f"model.inertia={inertia}"]
        config = load_config("xm430-w350", sets).config
        ended = Ended(End.DURATION, RunStatistics(), 10, 0, result={"torque_off": True})
        told = run_report(config, ended, None, None)["warnings"]
        assert [f"a bare {model} has at least" in text for text in told] == [True] * warned


def test_a_wall_that_a_stall_fades_out_at_the_end_had_stiffness() -> None:
    """Which walls had stiffness is said of most of their time, not of the last instant."""
    asked, none = {"stiffness": 8.0}, {"stiffness": 0.0}
    guard = {"requested": asked, "commanded": none, "binding": None}
    for limp, said in ((0, None), (50, None), (51, "0 of 8 N·m/rad for 51 %"), (100, "0 of 8 N")):
        statistics = RunStatistics()
        statistics.acted[:], statistics.limp[:] = 100, limp
        found = no_stiffness({"guard": guard}, statistics)
        assert found == said or (said and said in str(found)), limp
        assert no_stiffness({"guard": guard | {"requested": none}}, statistics) is None
