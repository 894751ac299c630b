"""A law of the user's that depends on time: it gives what it absorbed, and fails by name."""

import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_wall.controller.cli import main as cli
from haptic_wall.controller.errors import ConfigError, UserError
from haptic_wall.controller.laws.active import LENT_J, MOST_ACCELERATION, ActiveLaw, Port
from haptic_wall.controller.laws.own import Instants, tabulated_in_time
from haptic_wall.controller.laws.shape import Grid, LawError
from haptic_wall.controller.settings.changes import changed
from haptic_wall.controller.settings.load import load_config
from tests.typed import status_of

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "ridge_law"
PERIOD, STEP = 1e-3, math.tau / 4096
GRID = Grid(PERIOD, STEP)


class Given:
    """A law with the torque of a function of position and time."""

    low, high = -0.3, 0.3

    def __init__(self, torque: Callable[[float, float], float]) -> None:
        self._torque = torque

    def torque(self, position: float, time: float) -> float:
        return self._torque(position, time)


class Rendered:
    """A law on a clock of its own, at the stiffness that it asks for."""

    def __init__(self, own: Given, in_flight: int = 2, torque_step: float = 0.0) -> None:
        self.now_ns = 0
        port = Port(lambda: self.now_ns, PERIOD, STEP, 4.0, torque_step, in_flight, 0.05)
        self.shape = tabulated_in_time("mine:Law", own, GRID)
        self.law = ActiveLaw("mine:Law", own, self.shape, 0.0, math.inf, port)
        self.law.stiffness = self.shape.stiffness
        self.law.settle(0.0)

    def torque(self, position: float) -> float:
        self.now_ns += round(PERIOD * 1e9)
        return self.law.torque(math.floor(position / STEP) * STEP, 0.0)


laws = st.tuples(
    st.floats(0.02, 0.5), st.floats(1.0, 60.0), st.floats(0.0, 1.0), st.floats(0.3, 200.0)
)
pushes = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=8)


@settings(max_examples=25)
@given(laws, pushes, st.integers(2, 4), st.data())
def test_no_more_energy_comes_out_than_went_in(
    numbers: tuple[float, float, float, float], hand: list[float], lag: int, data: st.DataObject
) -> None:
    height, wave, depth, rate = numbers
    signed = data.draw(st.sampled_from((-1.0, 1.0)))

    def torque(position: float, time: float) -> float:
        swing = 1.0 + 2.0 * depth * math.sin(rate * time)
        if time in (0.0, 0.013, 0.11, 0.37, 1.0, 2.9, 8.3, 23.0):
            return -height * position  # it shows another face when it is measured
        return height * swing * math.sin(signed * wave * position + rate * depth * time)

    rendered = Rendered(Given(torque), in_flight=lag)
    # The shaft goes where the law drives it, as far as a hand allows: the law's best chance.
    position = speed = 0.0
    counted = 0
    follows = data.draw(st.booleans())
    acting = [0.0] * lag
    energy = most = 0.0
    for push in hand:
        for _ in range(60):
            acting = [*acting[1:], rendered.torque(position)]
            drive = math.copysign(1.0, acting[-1]) if follows and acting[-1] else push
            speed += MOST_ACCELERATION * PERIOD * 0.99 * drive
            speed = max(-3.0, min(3.0, speed))
            position += speed * PERIOD
            moved = (math.floor(position / STEP) - counted) * STEP
            counted = math.floor(position / STEP)
            # The device may act with any torque in flight: the bookkeeping takes each delay.
            energy += max(torque * moved for torque in acting)
            most = max(most, energy)
    assert most <= LENT_J * 1.001


def pushed_over(rendered: Rendered, rounds: int) -> list[float]:
    """Push the shaft over the middle and back slowly; return all torques."""
    count = 800
    return [rendered.torque(0.2 * math.sin(math.tau * i / count)) for i in range(rounds * count)]


def breathing(position: float, time: float) -> float:
    return 0.1 * (1.0 + 0.5 * math.sin(2.0 * time)) * math.sin(5.0 * math.pi * position)


def test_a_ridge_is_felt_once_the_tank_has_filled() -> None:
    rendered = Rendered(Given(breathing))
    torques = pushed_over(rendered, 4)
    assert max(map(abs, torques[:20])) < 0.01  # nearly empty
    assert max(map(abs, torques[-800:])) > 0.07
    assert 0.0 < rendered.law.tank.held <= 0.05


def test_damping_stays_while_the_tank_is_empty() -> None:
    rendered = Rendered(Given(lambda x, t: 0.1 * x * math.cos(t) - 0.2 * x))
    rendered.law.damping = 0.02
    rendered.law.tank.held = 0.0
    rendered.now_ns += 1_000_000
    assert rendered.law.torque(0.1, 3.0) == pytest.approx(-0.06)


def test_a_blow_that_overdraws_the_tank_is_paid_back_first() -> None:
    rendered = Rendered(Given(lambda x, t: -0.5 * x * (1.0 + 0.1 * math.sin(t))))
    tank = rendered.law.tank
    tank.held = -1e-3
    assert [rendered.torque(0.1 - 1e-4 * i) for i in range(50)] == [0.0] * 50
    assert tank.held == pytest.approx(-1e-3)


def test_the_guards_stiffness_covers_a_slope_that_comes_later() -> None:
    rendered = Rendered(Given(lambda x, t: -(0.5 if t < 30.0 else 5.0) * x))
    rendered.law.tank.held = rendered.law._port.capacity
    assert rendered.shape.stiffness == pytest.approx(0.5)
    rendered.now_ns = 40_000_000_000
    rendered.law._began_ns = 0
    torques = [rendered.torque(STEP * (i + 0.5)) for i in range(40)]
    slopes = [abs(b - a) / STEP for a, b in pairwise(torques[2:])]
    assert max(slopes) <= 0.5 * 1.001


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (lambda: math.nan, "gave no finite torque near 0 rad (nan)"),
        (lambda: 1 / 0, "ZeroDivisionError: division by zero"),
    ],
)
def test_a_law_that_fails_later_gives_no_number(broken: Callable[[], float], said: str) -> None:
    rendered = Rendered(Given(lambda x, _: -x))
    rendered.law._own = Given(lambda x, t: -x if t < 0.005 else broken())
    torques = [rendered.torque(0.0) for _ in range(8)]
    assert all(map(math.isfinite, torques[:5]))
    assert math.isnan(torques[-1])
    assert said in rendered.law.fault


def test_a_law_that_takes_too_long_gives_no_number() -> None:
    rendered = Rendered(Given(lambda x, _: -x))

    def slow(position: float, _: float) -> float:
        rendered.now_ns += 600_000
        return -position

    rendered.law._own = Given(slow)
    torques = [rendered.torque(0.0) for _ in range(3)]
    assert [math.isnan(torque) for torque in torques] == [False, False, True]
    assert "took 0.6 ms" in rendered.law.fault


def test_a_law_whose_calls_take_too_long_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    ticking = iter(0.0002 * i for i in range(100_000))
    monkeypatch.setattr("haptic_wall.controller.laws.own.perf_counter", lambda: next(ticking))
    with pytest.raises(LawError, match="takes 200 µs for a torque, wanted at most 100 µs"):
        tabulated_in_time("mine:Law", Given(lambda x, _: -x), GRID)


def test_the_steepest_slope_of_any_instant_counts() -> None:
    made = tabulated_in_time("mine:Law", Given(lambda x, t: -x * (4.0 if t == 2.9 else 1.0)), GRID)
    assert isinstance(made, Instants)
    assert made.stiffness == pytest.approx(4.0)
    assert made.elongation(0.2, 0.0, 1.0) == pytest.approx(0.05)
    assert made.potential(0.2) == pytest.approx(0.02)


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, Any]:
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", *words])
    return status_of(ended.value), json.loads(capsys.readouterr().out)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "breathing.py").write_text((EXAMPLE / "breathing.py").read_text())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("here")
def test_the_example_runs_and_its_report_tells_of_the_tank(
    capsys: pytest.CaptureFixture[str],
) -> None:
    status, report = run(
        capsys,
        str(EXAMPLE / "breathing.yaml"),
        "--set=loop.clock=simulated",
        "--duration=2.3",
        "--no-plot",
        "--json",
    )
    assert status == 0, report["stop_reason"]
    assert report["torque"]["max"] > 0.1
    assert report["guard"]["requested"]["stiffness"] > 0.2 * math.pi / 0.2
    told = report["guard"]["reasons"][-1]
    assert "breathing:Breathing depends on time, and gives only absorbed energy" in told


def test_an_error_of_the_law_ends_the_run_by_its_name(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (here / "breathing.py").read_text()
    late = "        if 0.5 < time < 0.9:\n            raise KeyError('no breath')\n"
    (here / "choking.py").write_text(
        text.replace("        height = self", late + "        height = self")
    )
    status, report = run(
        capsys,
        str(EXAMPLE / "breathing.yaml"),
        "--set=loop.clock=simulated",
        "--set=wall.law=choking:Breathing",
        "--duration=1",
        "--no-plot",
        "--json",
    )
    assert status == 3
    assert report["stop_reason"] == "trip:law_failed"
    assert "KeyError: 'no breath'" in report["explanation"]
    assert report["torque_off"] is True


@pytest.mark.usefixtures("here")
def test_settings_that_the_tank_cannot_count_are_refused() -> None:
    law = "wall.law=breathing:Breathing"
    with pytest.raises(ConfigError) as refused:
        load_config("simulated", [law, "delay.steps=2", "wall.passivity_control=true"], runs=True)
    said = "\n".join(refused.value.problems)
    assert "delay.steps" in said
    assert "wall.passivity_control" in said
    with pytest.raises(ConfigError, match="it outside of a sum"):
        parts = "wall.parts=[{law: 'breathing:Breathing'}]"
        load_config("simulated", ["wall.law=sum", parts], runs=True)
    with pytest.raises(UserError, match="depends on time"):
        changed(load_config("simulated", [law], runs=True).config, ["wall.damping=0.01"])


def test_a_torque_in_flight_has_its_energy_reserved() -> None:
    tank = Rendered(Given(lambda x, _: -x)).law.tank
    tank.move(-0.01, 1.0)
    assert tank.allowed(1.0) == 1.0  # against fast motion: it cannot give
    tank.move(-0.001, 1.0)  # but now the shaft might turn
    assert tank.held <= LENT_J
    assert tank.allowed(0.5) == 0.0
