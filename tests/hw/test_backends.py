"""The registry of servo backends: ours, one of another distribution, and what can be wrong."""

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.settings.fields import fields
from haptic_wall.controller.settings.load import load_config
from haptic_wall.hw.clock import MonotonicClock, SimulatedClock
from haptic_wall.hw.errors import BackendError, PortError
from haptic_wall.hw.open import backend, cut_torque, open_bus, open_port
from haptic_wall.hw.settings import ServoSettings
from haptic_wall.hw.truth import TrueServo
from tests.typed import not_none

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "line_servo"
PROGRAM = (sys.executable, "-P", "-m", "haptic_wall.controller.cli.main")


def install(folder: Path, project: Mapping[str, Any], *modules: Path) -> None:
    """What an installer leaves of a distribution: its modules, and what it says of itself."""
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    lines = []
    for group, entries in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    for module in modules:
        (folder / module.name).symlink_to(module)


def distribution(name: str, **backends: str) -> dict[str, Any]:
    return {"name": name, "version": "1.0", "entry-points": {"haptic_wall.servos": backends}}


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on the path, where distributions can be installed."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    backend.cache_clear()
    yield folder
    for known in (backend, fields):  # the fields name the backends
        known.cache_clear()


@pytest.fixture
def line_servo(tmp_path: Path) -> dict[str, str]:
    """Variables of an environment in which the example is installed."""
    folder = tmp_path / "site"
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    install(folder, project, EXAMPLE / "line_servo.py", EXAMPLE / "line_board.py")
    here = os.environ.get("PYTHONPATH", "")
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, (str(folder), here)))}


@pytest.fixture
def board(line_servo: dict[str, str]) -> Iterator[str]:
    """The port of a board that is there."""
    with subprocess.Popen(
        [sys.executable, "-m", "line_board"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=line_servo,
        text=True,
    ) as process:
        yield not_none(process.stdout).readline().strip()
        not_none(process.stdin).close()


def test_a_backend_of_another_distribution_keeps_the_contract(line_servo: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(EXAMPLE)],
        env=line_servo,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout, "skipped as a whole where it is not installed"


@pytest.mark.whole
@pytest.mark.realtime
def test_a_wall_on_it_runs_end_to_end(
    line_servo: dict[str, str], board: str, tmp_path: Path
) -> None:
    sets = [
        f"servo.port={board}",
        "realtime.profile=best-effort",
        # A machine with other things to do may be away for long; nothing can be hurt.
        *("safety.max_silence_s=1", "safety.max_loss=0.9", "safety.heartbeat_s=5"),
        "loop.rate_hz=200",
    ]
    done = subprocess.run(
        [
            *(*PROGRAM, "run", str(EXAMPLE / "wall.yaml"), "--duration", "1", "--json"),
            *("--no-plot", "--log", str(tmp_path / "run.hwlog")),
            *(word for text in sets for word in ("--set", text)),
        ],
        env=line_servo,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[:2000] + done.stderr
    report = json.loads(done.stdout)
    assert report["stop_reason"] == "duration"
    assert report["wall_came_on"] is True
    assert report["bus"]["cycles"] > 50
    assert 0.0 < report["guard"]["commanded"]["stiffness"] <= 5.0


def test_what_it_requires_is_named(line_servo: dict[str, str]) -> None:
    done = subprocess.run(
        [*PROGRAM, "run", str(EXAMPLE / "wall.yaml"), "--set", "servo.baud=null"],
        env=line_servo,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "servo.baud: found nothing, wanted 115200" in done.stderr


def test_an_unknown_backend_is_named_with_those_that_are_known(site: Path) -> None:
    install(site, distribution("line-servo", line="line_servo:BACKEND"))
    with pytest.raises(BackendError, match=r"'lime': known are simulated, dynamixel, line\.$"):
        backend("lime")
    with pytest.raises(ConfigError) as refused:
        load_config("simulated", ["servo.backend=lime"])
    (problem,) = refused.value.problems
    assert "found 'lime', wanted one of simulated, dynamixel, line; did you mean line?" in problem


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("import a_module_that_nobody_has", "ModuleNotFoundError: No module named 'a_module_that"),
        ("1 / 0", "ZeroDivisionError"),
        ("OTHER = 1", "AttributeError"),
        ("BACKEND = 5", "is a int, wanted a haptic_wall.hw.backend.Backend"),
    ],
)
def test_a_backend_that_cannot_be_loaded_is_named_with_its_distribution(
    site: Path, text: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "broken_servo", raising=False)
    install(site, distribution("broken-servo", broken="broken_servo:BACKEND"))
    (site / "broken_servo.py").write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_config("simulated", ["servo.backend=broken"])
    (problem,) = refused.value.problems
    assert "servo backend 'broken' of the distribution broken-servo" in problem
    assert told in problem
    assert "\n" not in problem


def test_a_simulated_servo_has_no_port_and_ends_with_its_process() -> None:
    settings = ServoSettings(true=TrueServo(0.01))
    assert open_port([settings]) is None
    assert cut_torque([settings], None, SimulatedClock()) is True


def test_a_real_servo_without_a_port_is_never_said_to_be_off() -> None:
    settings = ServoSettings("", 4_000_000, 1, "XM430-W350", backend="dynamixel")
    assert cut_torque([settings], None, MonotonicClock()) is False
    with pytest.raises(PortError, match="No serial port"):
        open_bus([settings], MonotonicClock())
