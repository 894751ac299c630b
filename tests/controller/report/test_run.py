"""The picture is drawn for every kind of run, and shows what is there."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from haptic_wall.controller.logs.walls import walls_of
from haptic_wall.controller.report import run as plot
from haptic_wall.controller.report.run_panels import DrawnRun
from haptic_wall.controller.report.sketch import sketched
from haptic_wall.controller.runtime.telemetry import (
    FLAG_ALARM,
    FLAG_PROBED,
    FLAG_WARM_UP,
)
from haptic_wall.hw.servo import Outcome
from tests.support.told_logs import metadata, rows
from tests.typed import not_none

pytestmark = pytest.mark.usefixtures("undrawn")
PNG = b"\x89PNG\r\n\x1a\n"


def run_rows(count: int = 600) -> NDArray[np.void]:
    """A hand that goes in and out of a wall at zero, after a warm-up."""
    made = rows(count)
    made["velocity"], made["work_ns"], made["bus_ns"] = 1.0, 25_000, 90_000
    made["flags"][:100] |= FLAG_WARM_UP
    return made


def draw(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    rows: NDArray[np.void],
    facts: Mapping[str, Any],
    stop_reason: str = "duration",
    saved: bool = True,
    report: Mapping[str, Any] | None = None,
) -> Figure:
    """The figure that was drawn; the file is checked to be a PNG, where that is waited for."""
    figures = []
    save = Figure.savefig

    def keep(figure: Figure, path: Path, **how: Any) -> None:
        figures.append(figure)
        if saved:
            save(figure, path, **how)
        else:
            path.write_bytes(PNG)

    monkeypatch.setattr(Figure, "savefig", keep)
    sketch = sketched([rows[:70], rows[70:]], len(rows), int(rows["deadline_ns"][0]))
    run = DrawnRun.of(sketch, walls_of(facts, ()), report)
    plot.plot_run(run, facts["name"], tmp_path / "run.png", stop_reason)
    assert (tmp_path / "run.png").read_bytes().startswith(PNG)
    (figure,) = figures
    return figure


def legend(ax: Axes) -> list[str]:
    return [text.get_text() for text in not_none(ax.get_legend()).get_texts()]


def test_one_look_tells_wall_torque_and_timing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rows = run_rows()
    rows["missed"][300] = 2
    own = {"servo": {"torque_limit": 3.9}}  # not the configured one: by its Current Limit
    figure = draw(monkeypatch, tmp_path, rows, metadata("emulated-ideal"), report=own)
    assert figure.get_suptitle() == (
        "emulated-ideal: XM430-W350, emulated\n"
        "K 8 N·m/rad (as requested)   B 0.02 N·m·s/rad (as requested)   delay 0.30 ms   1000 Hz"
    )
    position, torque, velocity, timing = figure.axes
    assert legend(position) == [
        "position",
        "wall's surface",
        "wall (fills above)",
        "in contact",
        "warm-up: the wall is off",
    ]
    assert "(limit ±3.9 N·m: off the scale)" in legend(torque)
    assert velocity.get_ylabel() == "velocity [rad/s]"
    assert {"missed ticks", "work", "lateness"} <= {*legend(timing)}
    assert timing.get_xlim() == pytest.approx((0.0, 0.599))


def test_a_clamped_stiffness_is_in_the_title_and_drawn(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rows = run_rows()
    rows["stiffness"][400:] = 5.0
    for asked, told in ((1e6, "(requested K 1e+06: off the scale)"), (12.0, "requested K")):
        facts = metadata("simulated", f"wall.stiffness={asked}")
        figure = draw(monkeypatch, tmp_path, rows, facts, saved=False)
        assert f"K 5 N·m/rad (of {asked:g} requested)" in figure.get_suptitle()
        panel = figure.axes[2]
        assert panel.get_ylabel() == "stiffness\n[N·m/rad]"
        assert told in legend(panel)
    assert panel.get_ylim()[1] > 12.0


def test_each_lost_reading_is_marked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for count in (600, 30_000):
        rows = run_rows(count)
        rows["outcome"][[150, 400]] = Outcome.LOST, Outcome.CORRUPT
        figure = draw(monkeypatch, tmp_path, rows, metadata(), saved=False)
        marks = {str(line.get_label()): line.get_xdata() for line in figure.axes[0].get_lines()}
        assert marks["lost readings"] == pytest.approx([0.15, 0.4])


def test_the_title_tells_a_trip_and_a_guard_that_is_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    facts = metadata("simulated", "guard.mode=off")
    figure = draw(monkeypatch, tmp_path, run_rows(), facts, "trip:overspeed", saved=False)
    first, second = figure.get_suptitle().splitlines()
    assert first.endswith("ENDED BY A SAFETY TRIP: overspeed")
    assert second.endswith("guard off")


def test_the_first_alarm_and_the_probes_are_marked(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The probe before the end, which takes most of the stiffness, is not in the title."""
    rows = run_rows()
    for start in (200, 500):
        rows["flags"][start : start + 100] |= FLAG_PROBED
        rows["stiffness"][start : start + 100] *= 0.25
    rows["flags"][[550, 580]] |= FLAG_ALARM
    figure = draw(monkeypatch, tmp_path, rows, metadata(), "trip:oscillation", saved=False)
    position, torque = figure.axes[:2]
    assert {"probe for an oscillation", "first alarm: oscillation"} <= {*legend(position)}
    for ax in (position, torque):
        dashed = [line for line in ax.get_lines() if line.get_linestyle() == "--"]
        assert 0.55 in [np.asarray(line.get_xdata())[0] for line in dashed]
    assert "K 8 N·m/rad (as requested)" in figure.get_suptitle()


@pytest.mark.parametrize("count", [1, 2, 101])
def test_the_shortest_runs_can_be_drawn(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, count: int
) -> None:
    draw(monkeypatch, tmp_path, run_rows(count), metadata())


def test_a_long_run_is_drawn_as_its_envelope(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rows = run_rows(50_000)
    rows["position"][31_234] = 0.7
    figure = draw(monkeypatch, tmp_path, rows, metadata(), saved=False)
    lines = figure.axes[0].get_lines()
    pieces = [line for line in lines if line.get_color() == lines[0].get_color()]
    drawn = np.concatenate([line.get_ydata() for line in pieces])
    assert len(drawn) < 10_000
    assert max(drawn) == 0.7


@pytest.mark.parametrize(
    ("sets", "drawn"),
    [
        ((), {"wall's surface": 0.0}),
        (("wall.law=detents", "wall.count=24"), {"wall.position": 0.0}),
        (
            ("wall.law=stops", "wall.low=-0.08", "wall.high=0.06", "wall.position=0.01"),
            {"wall.high": 0.07, "wall.low": -0.07},
        ),
    ],
)
def test_each_law_is_drawn_where_it_acts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, sets: tuple[str, ...], drawn: dict[str, float]
) -> None:
    figure = draw(monkeypatch, tmp_path, run_rows(), metadata("simulated", *sets), saved=False)
    axes = figure.axes[0]
    names = {"wall's surface", "wall.position", "wall.low", "wall.high"}
    lines = {str(line.get_label()): line.get_ydata() for line in axes.get_lines()}
    assert {name: float(np.max(lines[name])) for name in names & lines.keys()} == pytest.approx(
        drawn
    )
    filled = {"wall (fills above)", "wall (fills below)"} & set(legend(axes))
    assert len(filled) == {"wall's surface": 1, "wall.position": 0}.get(next(iter(drawn)), 2)
