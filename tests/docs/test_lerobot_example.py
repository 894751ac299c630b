"""The leader arm of docs/examples as a teleoperator: lerobot's where it is installed."""

import importlib
import importlib.util
import math
import sys
import tomllib
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

NAME = "lerobot_teleoperator_haptic_wall"
EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / NAME
ARM = """
loop: {rate_hz: 100}
realtime: {profile: "off"}
servo: {inertia: 0.006, damping: 0.01}
axes:
  elbow: {servo: {kick: 0.1}}
  gripper: {wall: {law: none}}
"""


class Registered:
    """In place of lerobot's configuration class."""

    @classmethod
    def register_subclass(cls, _name: str) -> Callable[[type], type]:
        return lambda kind: kind


class Base:
    """In place of lerobot's base class."""

    def __init__(self, config: object) -> None:
        pass


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    monkeypatch.syspath_prepend(EXAMPLE)
    if importlib.util.find_spec("lerobot") is None:
        names: dict[str, dict[str, object]] = {
            "teleoperators.config": {"TeleoperatorConfig": Registered},
            "teleoperators.teleoperator": {"Teleoperator": Base},
            "utils.errors": {
                "DeviceAlreadyConnectedError": ConnectionError,
                "DeviceNotConnectedError": ConnectionError,
            },
        }
        for path in ("", "teleoperators", "utils", *names):
            module = types.ModuleType(path)
            vars(module).update(names.get(path, {}))
            monkeypatch.setitem(sys.modules, f"lerobot.{path}".rstrip("."), module)
    (tmp_path / "arm.yaml").write_text(ARM)
    monkeypatch.chdir(tmp_path)
    return importlib.import_module(NAME)


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("arm", "lowest"),
    [("arm.yaml", -0.5), pytest.param("emulated-arm", 0.0, marks=pytest.mark.whole)],
)
def test_an_action_is_a_position_of_each_axis_until_the_run_ends(
    example: Any, arm: str, lowest: float
) -> None:
    config = example.HapticWallConfig(
        arm=arm,
        set=["loop.clock=monotonic"],
        percent={"gripper": [lowest, lowest + 1.0]},
        most_age_s=5.0,
    )
    leader = example.HapticWall(config)
    assert {"elbow.pos", "gripper.pos"} <= leader.action_features.keys()
    assert not leader.is_connected
    with pytest.raises(ConnectionError, match="call connect"):
        leader.get_action()
    leader.connect()
    try:
        action = leader.get_action()
        assert action.keys() == leader.action_features.keys()
        assert abs(math.radians(action["elbow.pos"])) < 1.5 and 0 < action["gripper.pos"] < 100
        with pytest.raises(ConnectionError):
            leader.connect()
        leader._wall.end()
        leader._wall.wait()
        with pytest.raises(ConnectionError, match="has ended: interrupted"):
            leader.get_action()
    finally:
        leader.disconnect()
    leader.disconnect()  # again: lerobot's loops do so after an error
    assert not leader.is_connected


def test_lerobot_finds_it_by_the_name_of_its_distribution(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    plugins = pytest.importorskip("lerobot.utils.import_utils")
    teleoperators = importlib.import_module("lerobot.teleoperators")
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    info = tmp_path / f"{NAME}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\n")
    for folder in (tmp_path, EXAMPLE):
        monkeypatch.syspath_prepend(folder)
    plugins.register_third_party_plugins()
    config = teleoperators.TeleoperatorConfig.get_choice_class("haptic_wall")(arm="simulated")
    leader = teleoperators.make_teleoperator_from_config(config)
    assert isinstance(leader, teleoperators.Teleoperator)
    assert leader.action_features == {".pos": float}
