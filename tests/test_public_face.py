"""The names that other people's programs import, how they are called, and what they promise."""

import inspect
from pathlib import Path
from typing import TYPE_CHECKING, assert_type

import numpy as np
import pytest
from numpy.typing import NDArray

import haptic_wall
from haptic_wall.controller.cli.started import RunningWall
from haptic_wall.controller.logs.columns import COLUMNS
from tests.test_contracts import loaded_by, within

CALLED = {
    "run": (
        "(config: 'str | os.PathLike[str]', changes: 'Mapping[str, Any] | Sequence[str]' = (), *,"
        " duration_s: 'float | None' = None, log: 'str | os.PathLike[str] | None' = None)"
        " -> 'Iterator[RunningWall]'"
    ),
    "RunningWall.set": (
        "(self, changes: 'Mapping[str, Any]', wait_s: 'float' = 10.0) -> 'dict[str, Any]'"
    ),
    "RunningWall.positions": "(self, most_age_s: 'float' = 0.1) -> 'dict[str, float]'",
    "axes": (
        "(config: 'str | os.PathLike[str]', changes: 'Mapping[str, Any] | Sequence[str]' = ())"
        " -> 'tuple[str, ...]'"
    ),
    "RunningWall.running": "(self) -> 'bool'",
    "RunningWall.wait": "(self) -> 'dict[str, Any]'",
    "RunningWall.report": "(self) -> 'dict[str, Any]'",
    "read_log": (
        "(path: 'str | os.PathLike[str]', *, start_s: 'float' = -inf, end_s: 'float' = inf)"
        " -> 'Log'"
    ),
    "emulated_bus": (
        "(servos: 'Sequence[str]' = ('XM430-W350:1',), *, baud: 'int' = 4000000,"
        " latency_timer: 'int' = 0, block: 'int | None' = None, faults: 'Sequence[str]' = (),"
        " seed: 'int' = 0, truth: 'Mapping[str, float | str] | None' = None,"
        " own: 'Mapping[int, Mapping[str, float | str]] | None' = None,"
        " arm: 'Mapping[str, float | str] | None' = None) -> 'None'"
    ),
}
ERRORS = {
    "HapticWallError": Exception,
    "UserError": ValueError,
    "ConfigError": haptic_wall.UserError,
    "LogFormatError": haptic_wall.UserError,
    "PlatformError": OSError,
    "NotAppliedError": haptic_wall.HapticWallError,
    "RunError": haptic_wall.HapticWallError,
    "ServoError": Exception,
    "BusError": Exception,
}


def test_the_names_are_these() -> None:
    of_types = {"Law", "Log", *ERRORS, "RunningWall", "theory"}
    assert {*haptic_wall.__all__} == of_types | {name for name in CALLED if "." not in name}
    assert {*haptic_wall.__all__} <= {*dir(haptic_wall)}
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        haptic_wall.nothing  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize("name", CALLED)
def test_each_is_called_so(name: str) -> None:
    found = haptic_wall
    for step in name.split("."):
        found = getattr(found, step)
    assert str(inspect.signature(found)) == CALLED[name]  # type: ignore[arg-type]


def test_the_types_have_these_fields_and_methods() -> None:
    assert [*haptic_wall.Log.__dataclass_fields__] == ["rows", "metadata", "end", "changes"]
    law = haptic_wall.Law
    named = {name for name in {*vars(law), *law.__annotations__} if name[0] != "_"}
    assert named == {"high", "low", "torque"}


@pytest.mark.parametrize("name", ERRORS)
def test_errors_are_of_these_kinds(name: str) -> None:
    assert issubclass(getattr(haptic_wall, name), ERRORS[name])


def test_importing_it_imports_nothing_else() -> None:
    assert within(loaded_by("import haptic_wall"), "haptic_wall", "numpy", "scipy", "pydantic") == [
        "haptic_wall"
    ]
    bus = loaded_by("import haptic_wall; haptic_wall.emulated_bus")
    assert within(bus, "numpy", "pytest", "pydantic") == []


def test_the_package_says_that_it_is_typed() -> None:
    assert Path(haptic_wall.__file__).with_name("py.typed").exists()


if TYPE_CHECKING:  # read by mypy, which says where an error that is ignored here is none

    def _a_type_checker_knows_them() -> None:
        assert_type(haptic_wall.read_log("run.hwlog").rows, NDArray[np.void])
        with haptic_wall.run("simulated") as wall:
            assert_type(wall, RunningWall)
        haptic_wall.nothing  # type: ignore[attr-defined]  # noqa: B018


def test_a_log_is_a_table_in_documented_units(tmp_path: Path) -> None:
    path = tmp_path / "run.hwlog"
    changes = {"loop.clock": "simulated", "wall.stiffness": np.int64(4)}
    moment: float = np.float64(0.4)
    with haptic_wall.run("simulated", changes, duration_s=moment, log=path) as wall:
        assert not wall.running(), "on the simulated clock a run is over at once"
        report = wall.report()
        with pytest.raises(haptic_wall.UserError, match="has ended"):
            wall.set({"wall.stiffness": 2.0})
    assert report["guard"]["requested"]["stiffness"] == 4.0
    log = haptic_wall.read_log(path)
    assert log.rows.dtype.names == tuple(COLUMNS)
    assert len(log.rows) == report["ticks"] and log.end is not None
    assert log.metadata["config"]["wall"]["stiffness"] == 4.0
    assert np.diff(log.rows["time_s"]) == pytest.approx(1e-3)
    part = haptic_wall.read_log(str(path), start_s=0.2, end_s=0.3)
    assert part.rows["time_s"][[0, -1]] == pytest.approx([0.2, 0.299]) and len(part.rows) == 100
    path.write_text("position\n1\n")
    with pytest.raises(haptic_wall.LogFormatError, match="is not a log of haptic-wall"):
        haptic_wall.read_log(path)
    with pytest.raises(haptic_wall.UserError, match=r"nowhere: cannot be read: No such file"):
        haptic_wall.read_log(tmp_path / "nowhere")
