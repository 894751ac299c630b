"""Changes of a running wall in its log: the picture follows them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.logs.walls import made, walls_of
from haptic_wall.controller.logs.writer import LogWriter, append_end
from haptic_wall.controller.report.run_panels import DrawnRun
from haptic_wall.controller.report.sketch import sketched
from haptic_wall.controller.settings.changes import difference
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from tests.support.changed_walls import ChangedRun
from tests.support.program import Cli
from tests.support.rows import rows_of

pytestmark = pytest.mark.usefixtures("undrawn")
METADATA: dict[str, Any] = {"config": load_config("simulated", []).config.model_dump(mode="json")}


Change = dict[str, Any]
Swung = tuple[Path, ChangedRun, NDArray[np.void]]


def event(row: int | None, changed: Change | None, outcome: str = "applied") -> Change:
    return {"row": row, "set": [], "changed": changed, "outcome": outcome, "why": None}


@pytest.fixture(scope="module")
def swung(tmp_path_factory: pytest.TempPathFactory) -> Swung:
    """A wall that oscillates, in turn at two places, with two laws; its log."""
    sets = (
        "loop.clock=simulated",
        "servo.hand=none",
        "servo.kick=0.05",
        "servo.coulomb=0",
        "servo.delay=0.012",
        "model.delay=0",
        "model.inertia=0.012",
        "model.damping=0.0117",
        "model.coulomb=0",
        "wall.side=both",
        "wall.stiffness=3",
        "safety.on_oscillation=report",
    )
    left = {
        300: ("wall.position=0.01", "wall.stiffness=2.5"),
        1500: ("wall.law=profile", "wall.profile=[[-1, 3], [1, -3]]"),
        2500: ("delay.steps=1",),
    }

    def ask(row: int, _config: Config, _position: float) -> Sequence[str]:
        due = [at for at in left if row >= at]
        return left.pop(due[0]) if due else ()

    run = ChangedRun(load_config("simulated", sets).config, ask, 2000)
    _, rows = run.run(5.0)
    path = tmp_path_factory.mktemp("swung") / "run.hwlog"
    written(path, run, rows)
    return path, run, rows


def written(path: Path, run: ChangedRun, rows: NDArray[np.void]) -> None:
    with LogWriter(path, {"config": run.config.model_dump(mode="json")}) as log:
        for start in range(0, len(rows), 250):
            log.append(rows[start : start + 250, None])
            for asked in run.asked:
                if start <= asked.row < start + 250:
                    log.event(event(asked.row, dict(difference(asked.before, asked.new))))


def test_the_picture_has_each_wall_in_its_time(swung: Swung, tmp_path: Path, cli: Cli) -> None:
    path, run, rows = swung
    read = LogReader.open(path)
    walls = walls_of(read.metadata, read.changes)
    drawn = DrawnRun.of(sketched([rows], len(rows), read.origin_ns), walls, None)
    times, surfaces = drawn.over_time(drawn.surface)
    assert surfaces.tolist() == [0.0, 0.0, *[0.01] * 6]
    assert times[1] == times[2] == drawn.time[run.asked[0].row]
    assert drawn.config.delay.steps == 1
    assert cli("log", path, "--plot", tmp_path / "run.png").status == 0
    assert len(cli.json("log", path)["changes"]) == 3


@pytest.mark.parametrize(
    ("law", "status", "said"),
    [
        ("ridge", 2, "the run's law is not available here: wall.law: found ridge, wanted one of"),
        ("nowhere:Law", 0, "quiet"),
    ],
)
def test_a_log_of_an_absent_law_says_so(
    swung: Swung,
    tmp_path: Path,
    cli: Cli,
    law: str,
    status: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("haptic_wall.controller.laws.own._allowed", set())
    path = tmp_path / "run.hwlog"
    config = {**METADATA["config"], "wall": {**METADATA["config"]["wall"], "law": law}}
    with LogWriter(path, {"config": config}) as log:
        log.append(swung[2][:50, None])
    answer = cli("detect", path)
    assert answer.status == status and said in answer.out + answer.err
    assert cli("log", path, "--plot", tmp_path / "a.png").status == status


def test_changes_come_in_the_order_of_their_rows(tmp_path: Path) -> None:
    path = tmp_path / "run.hwlog"
    with LogWriter(path, METADATA) as log:
        log.append(rows_of(20)[:, None])
        for each in (
            event(9, {"wall.position": 0.3}),
            event(9, {"wall.position": 0.3}),
            event(None, None, "refused"),
            event(12, None),
        ):
            log.event(each)
    append_end(path, {"rows": 20}, [event(5, {"wall.position": 0.2})])
    found = made(LogReader.open(path).changes)
    assert [each["row"] for each in found] == [5, 9, 12]
    walls = walls_of(METADATA, found)
    places = [walls.at(seq).wall.position for seq in (0, 4, 5, 8, 9, 19)]
    assert places == [0, 0, 0.2, 0.2, 0.3, 0.3]
