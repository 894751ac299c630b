"""Opening a log or a configuration runs nothing that it names; only a run imports a law by module.

A canary leaves a file when its module is imported, its function called or its class made.
"""

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest

from haptic_wall.controller.cli.main import COMMANDS, main
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.laws import own
from haptic_wall.controller.logs.writer import LogWriter, append_end
from haptic_wall.controller.settings.changes import changed
from haptic_wall.controller.settings.load import load_config
from tests.cases import sampled
from tests.cli.test_text import REPORT
from tests.support.told_logs import one_turn, rows

RUNS = ("run", "identify", "delay")
"""Commands that run a configuration of any law, and so import it: ``of_walls`` is not theirs"""
WORDS = {
    "boundary": ["--virtual-damping=0.01"],
    "sweep": ["--virtual-damping=0", "--delay-steps=0"],
    "run": ["--duration=0.1"],
    "log": ["--from=0", "--to=0.2"],
}
"""What else a command must be given"""
CANARY = """
from pathlib import Path
def left(name): (Path({folder!r}) / name).touch()
left("imported")
def function(**_): left("called")
class Other:
    def __init__(self, **_): left("made")
    def method(self, **_): left("called")
method = Other.method
class Law(Other):
    low, high = -1.0, 1.0
    def torque(self, position): return -position
"""
SHELL = {"law": "os:system", "options": {"command": "touch called"}}


@pytest.fixture
def canary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Name of a module in the current folder; no other test has imported it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(own, "_allowed", set())
    monkeypatch.setattr("haptic_wall.controller.live.server.LiveServer.run", one_turn)
    name = "canary_" + "".join(filter(str.isalnum, tmp_path.name))
    Path(f"{name}.py").write_text(CANARY.format(folder=str(tmp_path)))
    yield name
    assert str(tmp_path) not in sys.path
    sys.modules.pop(name, None)


def left() -> set[str]:
    """What the canary has left since the last call."""
    found = {name for name in ("imported", "called", "made") if Path(name).exists()}
    for name in found:
        Path(name).unlink()
    return found


def parameters(name: str) -> list[click.Parameter]:
    command: click.Command = importlib.import_module(f"haptic_wall.controller.cli.{name}").command
    return command.params


def takers(argument: str) -> list[str]:
    """The commands with this argument."""
    return [
        name
        for name in COMMANDS
        for each in parameters(name)
        if isinstance(each, click.Argument) and each.name == argument
    ]


def call(name: str, *given: object) -> int:
    """Call a command with a file; whatever it can write is written."""
    words = [name, *map(str, given), *WORDS.get(name, ())]
    for each in parameters(name):
        if each.name in ("csv_path", "log_path", "plot", "plot_path"):
            words += [each.opts[0], f"out.{each.name}.png"]
        elif each.name in ("yes", "force"):
            words += [each.opts[0]]
        elif each.name == "out":
            words += [each.opts[0], "out"]
    try:
        return main(words)
    except SystemExit as ended:
        return int(ended.code or 0)


def laws(name: str) -> list[dict[str, Any]]:
    """What no run makes; ``left`` and ``Path.touch`` are functions that others may call."""
    attributes = ("function", "Other", "method", "left", "Path", "no")
    popen = {"law": "subprocess:Popen", "options": {"args": ["touch", "called"]}}
    return [SHELL, popen, *({"law": f"{name}:{attribute}"} for attribute in attributes)]


def test_every_command_that_takes_a_configuration_is_known() -> None:
    assert {"run", "config", "doctor", "boundary", "map", "sweep"} <= set(takers("config"))
    assert {"live", "detect", "log"} <= set(takers("log"))


@pytest.mark.parametrize("command", sampled(takers("config"), 2))
def test_a_configuration_calls_nothing(canary: str, command: str) -> None:
    parts = laws(canary)
    own_law = {"law": f"{canary}:Law"}  # a run imports it
    for wall in ({"law": "sum", "parts": parts}, *(parts if command in RUNS else [own_law])):
        sets = [f"--set=wall.{key}={json.dumps(value)}" for key, value in wall.items()]
        status = call(command, "simulated", "--set=loop.clock=simulated", *sets)
        assert left() <= ({"imported"} if command in RUNS else set()), wall
        sys.modules.pop(canary, None)
        assert status == 2 or command not in RUNS, wall


def test_a_run_imports_and_makes_its_own_law(canary: str) -> None:
    words = ["--set", "loop.clock=simulated", "--set", f"wall.law={canary}:Law"]
    assert call("run", "simulated", *words) == 0
    assert left() == {"imported", "made"}


def hostile_logs(name: str) -> Iterator[Path]:
    """Logs that name the canary at their start, or in an event."""
    good = load_config("simulated").config.model_dump(mode="json")
    part = {"law": f"{name}:Law"}
    for wall in (SHELL, part, {"law": "sum", "parts": [part]}):
        paths = {f"wall.{key}": value for key, value in wall.items()}
        applied = {"row": 100, "at_s": 0.1, "outcome": "applied", "set": [], "changed": paths}
        applied |= {"waited_s": 0.01}
        for config, events in (({**good, "wall": {**good["wall"], **wall}}, []), (good, [applied])):
            path = Path("hostile.hwlog")
            with LogWriter(path, {"name": "hostile", "config": config}, force=True) as log:
                log.append(rows(200)[:, None])
            append_end(path, REPORT | {"rows": 200}, events)
            yield path


@pytest.mark.usefixtures("undrawn")
def test_a_log_imports_nothing(canary: str) -> None:
    statuses = set()
    for log in hostile_logs(canary):
        for command in takers("log"):
            statuses.add(call(command, log))
        assert left() == set()
    assert statuses == {0}, "its rows, and all of its configuration but the law, are known"


def test_a_change_names_no_module_but_those_of_the_run(canary: str) -> None:
    config = load_config("simulated").config
    for law in (f"{canary}:Law", f"{canary}:function", "os:system"):
        for sets in ([f"wall.law={law}"], ["wall.law=sum", f"wall.parts=[{{law: '{law}'}}]"]):
            with pytest.raises(UserError, match=f"found {law}, whose module is imported only"):
                changed(config, sets)
            assert left() == set()
    load_config("simulated", [f"wall.law={canary}:Law"], runs=True)
    assert changed(config, [f"wall.law={canary}:Law"]).wall.law == f"{canary}:Law"
    assert left() == {"imported", "made"}
