"""The search for one point, on simulated servos whose limits are known."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from haptic_wall.controller.experiments.holding import without_hand
from haptic_wall.controller.experiments.sweep.critical import PointSearch
from haptic_wall.controller.experiments.sweep.decrement import Growth
from haptic_wall.controller.experiments.sweep.device import Device
from haptic_wall.controller.experiments.sweep.growth_fit import Trial
from haptic_wall.controller.experiments.sweep.plan import Options, PlanePoint, soft_spring
from haptic_wall.controller.experiments.sweep.result import PointResult, point_text
from haptic_wall.controller.experiments.sweep.sweep import excursion
from haptic_wall.controller.experiments.testbed import ExperimentTrippedError, Testbed
from haptic_wall.controller.laws.program import Phase
from haptic_wall.controller.logs.reader import LogReader
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.theory import critical_stiffness
from haptic_wall.controller.theory.harmonic import Lossy, kick_limit
from haptic_wall.hw.errors import Problem
from tests.cases import sampled
from tests.typed import not_none

LINEAR = ("servo.coulomb=0", "servo.counts_per_rev=0", "servo.torque_step=0")


def config(*sets: str, preset: str = "simulated") -> Config:
    return without_hand(load_config(preset, ("loop.clock=simulated", *sets)).config)


def search(
    folder: Path, damping: float, steps: int, *sets: str, preset: str = "simulated", **options: Any
) -> PointResult:
    bed = Testbed(config(*sets, preset=preset), folder)
    return PointSearch(bed, PlanePoint(damping, steps), Options(**options)).run()


@pytest.mark.parametrize(
    ("damping", "steps", "lag"), sampled([(0.02, 2, 0.0), (0.0, 0, 1.3e-3), (0.1, 2, 0.45e-3)], 3)
)
def test_a_linear_servo_has_the_exact_boundary_and_stays_within_what_is_announced(
    tmp_path: Path, damping: float, steps: int, lag: float
) -> None:
    """Each batch leaves the shaft where it took it: the next one begins there."""
    sets = (*LINEAR, f"servo.delay={lag}")
    found = search(tmp_path, damping, steps, *sets)
    delay = lag + steps * 1e-3
    exact = float(critical_stiffness(0.011951, 0.011692, damping, 1e-3, delay))
    assert found.measured == pytest.approx(exact, rel=0.005)
    assert found.exact == pytest.approx(exact)
    assert found.delay_s == pytest.approx(delay)
    assert not_none(found.uncertainty) < 0.005 * exact
    assert found.reason is None
    furthest = 0.0
    for log in found.logs:
        moved = LogReader.open(tmp_path / log).rows()["position"]
        assert moved[-1] == pytest.approx(moved[0], abs=0.02)
        furthest = max(furthest, np.abs(moved - moved[0]).max())
    said = excursion(config(*sets), (PlanePoint(damping, steps),), Options())
    assert furthest < said < 4.0 * furthest


@pytest.mark.whole
def test_it_measures_the_servo_and_not_the_belief(tmp_path: Path) -> None:
    believed = ("model.damping=0.03", "model.inertia=0.008", "model.delay=0")
    found = search(tmp_path, 0.02, 2, *LINEAR, "servo.delay=0.0005", *believed)
    true = float(critical_stiffness(0.011951, 0.011692, 0.02, 1e-3, 2.5e-3))
    assert found.measured == pytest.approx(true, rel=0.005)
    assert found.exact > 1.5 * true
    assert found.delay_s == pytest.approx(2e-3)


@pytest.mark.whole
@pytest.mark.parametrize("kick", sampled([0.1, 0.04], 2))
def test_with_friction_it_is_the_stiffness_that_sustains_the_kick(
    tmp_path: Path, kick: float
) -> None:
    found = search(tmp_path, 0.02, 2, kick=kick)
    # The describing function is within a few per cent; 4096 counts add little at 26 counts.
    assert found.measured == pytest.approx(found.predicted_with_friction, rel=0.05)
    assert found.kick_rad == pytest.approx(kick)
    assert not_none(found.measured) > 1.5 * found.exact


@pytest.mark.whole
def test_with_backlash_and_noise_it_is_what_sustains_the_kick(tmp_path: Path) -> None:
    sets = ("servo.coulomb=0.09", "servo.delay=0.0012", "servo.torque_step=0")
    loose = ("servo.backlash=0.00436", "servo.encoder_noise=0.34", "model.backlash=0.00436")
    found = search(tmp_path, 0.1, 0, *sets, *loose, kick=0.03, tolerance=0.02)
    # Friction alone would let it rest at 1.6 times this stiffness.
    assert found.measured == pytest.approx(found.predicted_with_friction, rel=0.05)
    assert not_none(found.measured) < found.exact


@pytest.mark.whole
def test_a_shaft_that_sticks_is_aimed_at_again_and_not_judged(tmp_path: Path) -> None:
    """A shaft at rest in its wall moves by a count or two, which says nothing of the wall."""
    sets = ("servo.coulomb=0.0615", "servo.static_friction=0.0854", "servo.dead_band=0.1")
    delay = ("servo.delay=0.0012", "servo.torque_step=0")
    found = search(tmp_path, 0.0891, 0, *sets, *delay, kick=0.03, tolerance=0.02)
    servo = Lossy(0.011951, 0.011692, 0.0615, dead_band=0.1)
    true = kick_limit(servo, 0.0891, 1e-3, 1.2e-3, not_none(found.kick_rad))
    assert found.measured == pytest.approx(true, rel=0.05)


@pytest.mark.whole
def test_a_shaft_that_noise_shakes_beyond_its_kick_is_aimed_at_again(tmp_path: Path) -> None:
    """Friction holds it short of the soft spring's centre, until noise is commanded as damping."""
    sets = ("servo.backlash=0.002", "servo.encoder_noise=1")
    assert search(tmp_path, 0.0891, 3, *sets, tolerance=0.02).trials >= 4


@pytest.mark.parametrize(
    ("damping", "sets", "words"),
    [
        (8.0, (), ("above the ceiling", "nothing was tried")),
        (-0.02, (), ("cancels all of the servo's own",)),
        (0.02, ("servo.torque_limit=0.5",), ("servo.torque_limit allows only up to", "--kick")),
        (5.0, (), ("servo.torque_limit allows only up to", "nothing was tried")),
        (0.02, ("safety.max_speed=2",), ("safety.max_speed allows only up to", "--kick")),
    ],
)
def test_a_point_out_of_reach_says_why(
    tmp_path: Path, damping: float, sets: tuple[str, ...], words: tuple[str, ...]
) -> None:
    found = search(tmp_path, damping, 2, *LINEAR, *sets, kick=0.1)
    assert found.measured is None
    assert found.uncertainty is None
    for word in words:
        assert word in not_none(found.reason)


@pytest.mark.whole
def test_a_trip_ends_a_trial_and_softer_ones_follow(tmp_path: Path) -> None:
    # Believed so heavy that far stiffer trials seem slow enough.
    heavy = ("model.inertia=0.1", "model.damping=0.06", "model.coulomb=0")
    found = search(tmp_path, 0.02, 2, "servo.coulomb=0", *heavy, "safety.max_speed=4", kick=0.1)
    assert [trip.split(" at ")[0] for trip in found.trips] == ["trip:overspeed"]
    true = float(critical_stiffness(0.011951, 0.011692, 0.02, 1e-3, 2e-3))
    assert found.measured == pytest.approx(true, rel=0.005)
    assert all((tmp_path / log).exists() for log in found.logs)


@pytest.mark.parametrize(
    ("grew", "value", "error", "told"),
    [
        ((False, True), 10.49, 0.5, "between 10, where motion died, and 11, where it grew"),
        ((False, True, False), 10.95, 1.0, "between 10 and 12 some motions grew and some died"),
    ],
)
def test_outcomes_that_contradict_each_other_are_less_certain(
    grew: tuple[bool, ...],
    value: float,
    error: float,
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    none = Growth(np.empty(0), np.empty(0))

    def watched(search: PointSearch) -> None:
        search._trials.made += [Trial(10.0 + n, none, 0.1, each) for n, each in enumerate(grew)]

    monkeypatch.setattr(PointSearch, "_search", watched)
    found = search(tmp_path, 0.02, 2, kick=0.1)
    assert found.measured == pytest.approx(value, abs=0.01)
    assert found.uncertainty == pytest.approx(error)
    assert not_none(found.reason).startswith(told)


def test_a_loop_that_hung_and_may_have_left_torque_on_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def play(*_: object) -> NoReturn:
        raise ExperimentTrippedError(Trip.LOOP_HUNG, "stalled", Problem("no rows"), False)

    monkeypatch.setattr(Testbed, "play", play)
    with pytest.raises(ExperimentTrippedError, match="stalled"):
        search(tmp_path, 0.02, 2, *LINEAR, kick=0.1)


def test_three_trips_give_a_point_up(tmp_path: Path) -> None:
    heavy = ("model.inertia=1", "model.damping=0.3", "model.coulomb=0")
    found = search(tmp_path, 0.02, 2, *LINEAR, *heavy, "safety.max_speed=1.2", kick=0.1)
    assert len(found.trips) == 3
    assert found.measured is None
    assert not_none(found.reason).startswith("given up after 3 trips: trip:overspeed at ")


def test_three_losses_that_are_not_the_walls_end_the_search_and_are_no_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[str] = []

    def play(_bed: Testbed, name: str, _phases: Sequence[Phase], _steps: int) -> NoReturn:
        tried.append(name)
        raise ExperimentTrippedError(Trip.LOSSES_IN_ROW, "check cable")

    monkeypatch.setattr(Testbed, "play", play)
    with pytest.raises(ExperimentTrippedError, match="check cable"):
        search(tmp_path, 0.02, 2, *LINEAR, kick=0.1)
    assert len(set(tried)) == 3


def test_the_soft_spring_is_stable_in_the_worst_corner() -> None:
    effective = config(
        "model.inertia={value: 0.012, low: 0.008, high: 0.018}",
        "model.damping={value: 0.01, low: 0.001, high: 0.02}",
        "model.delay={value: 0.001, low: 0, high: 0.002}",
        "model.torque_gain={value: 1, low: 0.7, high: 1.35}",
    )
    device = Device.of(effective)
    hold = soft_spring(effective, device, 5)
    gain = 1.35
    limit = critical_stiffness(0.008, 0.001, gain * hold.damping, 1e-3, 7e-3) / gain
    assert 0.0 < hold.stiffness < 0.45 * float(limit)


@pytest.mark.parametrize(("hertz", "end"), [(19.4, " at 19.4 Hz"), (None, "")])
def test_a_point_tells_its_frequency_where_it_is_known(hertz: float | None, end: str) -> None:
    point = PointResult(0.0, 2, 0.002, 23.05, 24.0, 0.01, 177.6, 1.3, hertz)
    assert point_text(point) == f"B 0, 2 steps: 177.6 ± 1.3 N·m/rad (exact 23.05){end}"
