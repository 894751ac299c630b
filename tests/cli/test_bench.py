"""``haptic-wall bench``: sections, figures with their limits, and what is not installed.

Nothing is asserted about speed; the work is cut down so that the test is quick.
"""

import importlib.util
import json
import os
import sys

import pytest

from controller.benchmarks import array_simulation, boundary, bus_clients, bus_cycle
from controller.benchmarks.rows import interleaved
from controller.cli import main as cli
from controller.cli.bench import SECTIONS


@pytest.fixture(autouse=True)
def little_work(monkeypatch):
    monkeypatch.setattr(boundary, "_ROUNDS", 1)
    monkeypatch.setattr(boundary, "_MIXED", 500)
    monkeypatch.setattr(boundary, "_COMPARED", 3)
    monkeypatch.setattr(array_simulation, "_ROUNDS", 1)
    monkeypatch.setattr(array_simulation, "BLOCK", 4)
    monkeypatch.setattr(array_simulation, "_PERIODS", 200)
    monkeypatch.setattr(array_simulation, "_PERIODS_ALONE", 200)
    monkeypatch.setattr(bus_cycle, "_ROUNDS", 1)
    monkeypatch.setattr(bus_cycle, "_CYCLES", 5)
    monkeypatch.setattr(bus_clients, "_PATIENCE_NS", 2_000_000_000)
    monkeypatch.setattr(bus_cycle, "_COUNTS", (1, 3))


def call(capsys, *arguments):
    status = cli.main(["bench", *arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_the_json_holds_machine_versions_and_every_section(capsys):
    status, out, _ = call(capsys, "--json")
    assert status == 0
    report = json.loads(out, parse_constant=pytest.fail)
    assert set(report["sections"]) == set(SECTIONS)
    assert {"processor", "cores", "system"} == set(report["machine"])
    ours, peers = {"haptic-wall", "python", "numpy"}, {"control", "dynamixel-sdk", "rustypot"}
    assert ours | peers == set(report["versions"])
    rows = [row for section in report["sections"].values() for row in section["rows"]]
    assert len({row["name"] for row in rows}) == len(rows)
    assert all(row["value"] >= 0 and row["shows_not"] for row in rows)


def test_a_section_can_be_asked_for_alone(capsys):
    status, out, err = call(capsys, "--section", "array_simulation")
    assert status == 0
    assert "array simulation" in out
    assert "python-control" not in out
    assert err == "measuring array_simulation ...\n"
    assert call(capsys, "--section", "loops")[0] == 2


def test_arrays_move_as_one_alone_does():
    rows = {row.name: row.value for row in array_simulation.measure().rows}
    apart = [value for name, value in rows.items() if name.startswith("difference of position")]
    assert apart == [0.0, 0.0]


def test_both_programs_find_the_same_margins():
    pytest.importorskip("control")
    section = boundary.measure()
    (apart,) = (row.value for row in section.rows if "relative difference" in row.name)
    assert apart < 1e-6
    assert section.notes == ()


def test_without_python_control_the_rest_is_measured_and_a_sentence_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    section = boundary.measure()
    assert [row.unit for row in section.rows] == ["ms", "settings/s"]
    (note,) = section.notes
    assert "haptic-wall[bench]" in note


@pytest.mark.realtime
def test_every_client_goes_round_on_one_bus_and_the_process_gets_its_cores_back():
    cores = os.sched_getaffinity(0)
    section = bus_cycle.measure()
    assert os.sched_getaffinity(0) == cores
    names = [row.name for row in section.rows]
    peers = ["dynamixel-sdk"] + ["rustypot"] * (importlib.util.find_spec("rustypot") is not None)
    for client in ("haptic-wall, driver", "haptic-wall, codec alone", *peers):
        assert any(n.startswith(client) and n.endswith("1 servo") for n in names)
        assert any(n.startswith(client) and n.endswith("3 servos") for n in names)
    compared = [row for row in section.rows if "time over that of" in row.name]
    ours = ["codec alone, 10 bytes", "codec alone, 16 or 17 bytes", "driver, 16 or 17 bytes"]
    assert {row.name.split(":")[0] for row in compared} == {
        f"haptic-wall, {one}, {servos}" for one in ours for servos in ("1 servo", "3 servos")
    }
    # One may fail where the machine stalls; not all that were counted.
    assert not [note for note in section.notes if f"{bus_cycle._CYCLES} cycles failed" in note]


@pytest.mark.realtime
def test_without_rustypot_the_others_are_measured_and_a_sentence_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "rustypot", None)
    monkeypatch.setattr(bus_cycle, "_COUNTS", (1,))
    section = bus_cycle.measure()
    assert not [row for row in section.rows if "rustypot" in row.name]
    assert any("haptic-wall[bench]" in note for note in section.notes)


def test_pieces_of_work_take_turns_and_the_first_round_is_not_counted():
    order = []
    times = interleaved({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 2)
    assert order == ["a", "b"] * 3
    assert set(times) == {"a", "b"}
