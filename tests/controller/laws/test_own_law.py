"""A law of the user's own: installed or by its name, measured, and refused in one sentence."""

import json
import math
import os
import random
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.laws.own import OwnLaw, allow, own_law, own_table, tabulated
from haptic_wall.controller.laws.profile import Profile
from haptic_wall.controller.laws.shape import Grid, LawError
from haptic_wall.controller.settings.load import load_config
from tests.support.program import python

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "ridge_law"
GRID = Grid(1e-3, math.tau / 4096)


def install(folder: Path, project: Mapping[str, Any], *modules: Path) -> None:
    """A distribution as an installer leaves it: its modules and its metadata."""
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


@pytest.mark.whole
def test_a_law_of_another_distribution_is_rendered(tmp_path: Path) -> None:
    folder = tmp_path / "site"
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    install(folder, project, EXAMPLE / "ridge_law.py")
    path = os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH", ""))))
    sets = "--set=loop.clock=simulated", "--set=wall.options.height=20"
    done = python(
        *("-P", "-m", "haptic_wall.controller.cli.main", "run", EXAMPLE / "ridge.yaml"),
        *(*sets, "--duration=2", "--no-plot", "--json"),
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
    )
    guard = json.loads(done.stdout)["guard"]
    assert guard["requested"]["stiffness"] == pytest.approx(20 * math.pi / 0.2, rel=1e-4)
    assert guard["binding"] == "exact"
    assert "(ridge, from " in guard["reasons"][0]


def test_a_class_is_found_in_the_folder_where_one_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hillside.py").write_text((EXAMPLE / "ridge_law.py").read_text())
    monkeypatch.chdir(tmp_path)
    sets = ["wall.law=hillside:Ridge", "wall.options={height: 0.3}"]
    config = load_config("simulated", sets, runs=True).config
    law = config.law(math.tau / 4096)
    law.stiffness = config.request().stiffness
    assert law.torque(0.1, 0.0) == pytest.approx(0.3, abs=1e-4)
    assert law.torque(-0.05, 0.0) == pytest.approx(-0.3 * math.sin(math.pi / 4), abs=1e-4)


class Given:
    """A law with the torque of a function."""

    def __init__(self, torque: Any, low: float = -1.0, high: float = 1.0) -> None:
        self.low, self.high, self.torque = low, high, torque


def table(law: OwnLaw) -> Profile:
    return tabulated("mine:Law", law, GRID)


def test_a_law_whose_module_is_hidden_by_another_names_the_path() -> None:
    allow(["random:Ridge"])
    with pytest.raises(LawError) as caught:
        own_law("random:Ridge", {})
    assert f"({random.__file__}) has no Ridge" in str(caught.value)


def test_the_steepest_slope_between_counts_is_measured() -> None:
    made = table(Given(lambda x: -5.0 * x - (0.01 if x > 0.3 else 0.0)))
    assert made.own_stiffness == pytest.approx(5.0 + 0.01 / GRID.step, rel=1e-3)
    assert made.steepest.startswith("from 0.29") or made.steepest.startswith("from 0.3 ")


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (Given(lambda _: math.nan), "gives nan at -1 rad"),
        (Given(lambda _: 1 / 0), "fails at -1 rad (ZeroDivisionError"),
        (Given(lambda x: -x, low=-math.inf), "from -inf to 1.0 rad"),
        (Given(lambda x: x), "drive the shaft away"),
        (Given(lambda _: 0.0), "the same torque everywhere"),
    ],
)
def test_what_is_no_law_is_refused(law: Given, said: str) -> None:
    with pytest.raises(LawError) as refused:
        table(law)
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [("nowhere:Law", "ModuleNotFoundError"), ("math:nothing", "nothing"), ("math:tau", "float")],
)
def test_a_class_that_cannot_be_made_is_refused(name: str, said: str) -> None:
    with pytest.raises(ConfigError, match=r"wall\.law") as refused:
        load_config("simulated", [f"wall.law={name}"], runs=True)
    assert said in refused.value.problems[0]


MODULE = """
import sys
calls = []
print("loaded")

class Counted:
    low, high = -1.0, 1.0
    def __init__(self, k=1.0): self.k = k; calls.append(k); print("made")
    def torque(self, p): return -self.k * p

class NoRange(Counted):
    low = "a"

class NoHigh:
    low = -1.0
    def torque(self, p): return -p

class Leaves(Counted):
    def __init__(self): sys.exit(0)

class Raises(Counted):
    @property
    def low(self): raise ValueError("no range today")
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    name = f"law_{tmp_path.name.replace('-', '_')}"
    (tmp_path / f"{name}.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    return name


@pytest.mark.parametrize(
    ("made", "said"),
    [
        ("NoRange", "could not convert string to float"),
        ("NoHigh", "NoHigh without high"),
        ("Leaves", "SystemExit"),
        ("Raises", "no range today"),
    ],
)
def test_a_class_that_fails_in_any_way_is_refused(module: str, made: str, said: str) -> None:
    allow([name := f"{module}:{made}"])
    with pytest.raises(LawError) as refused:
        own_table(name, {}, Grid(1e-3, 0.1))
    assert said in refused.value.found


def test_a_law_is_asked_once_and_prints_beside_the_answer(
    module: str, capsys: pytest.CaptureFixture[str]
) -> None:
    name, grid = f"{module}:Counted", Grid(1e-3, 0.1)
    allow([name])
    one, same, other = (own_table(name, {"k": k}, grid) for k in (2.0, 2.0, 3.0))
    assert one is same
    assert one is not other
    assert sys.modules[module].calls == [2.0, 3.0]
    heard = capsys.readouterr()
    assert heard.out == ""
    assert "loaded" in heard.err
    assert "made" in heard.err
