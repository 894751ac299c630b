"""A map is the same whoever computes it, and what was done is kept when it is interrupted."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NoReturn

import numpy as np
import pytest

from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.maps.maps import (
    CriticalMap,
    MapQuestion,
    critical_map,
)
from haptic_wall.controller.experiments.maps.servo import MapSettings
from haptic_wall.controller.settings.load import load_config
from tests.support.executors import AtOnce
from tests.support.simulated_limits import simulated_critical_stiffness

DAMPINGS, STEPS, KICKS = [0.0, 0.05], [0, 2], [0.01, 0.1]


@pytest.fixture(scope="module")
def setting() -> MapSettings:
    sets = ("wall.side=both", "servo.coulomb=0.1", "servo.torque_step=0")
    return MapSettings.of(load_config("simulated", sets).config)


def asked(setting: MapSettings, tolerance: float = 0.1) -> MapQuestion:
    return MapQuestion(setting, DAMPINGS, STEPS, KICKS, tolerance)


@pytest.fixture(scope="module")
def found(setting: MapSettings) -> CriticalMap:
    return critical_map(asked(setting, 0.01), executor=AtOnce())


@pytest.mark.whole
def test_the_result_does_not_depend_on_the_executor(setting: MapSettings) -> None:
    seen: list[tuple[int, int]] = []
    found = critical_map(
        asked(setting),
        executor=AtOnce(),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert [total for _, total in seen] == [8] * len(seen), (
        "progress goes up to the number of points"
    )
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert seen[-1] == (8, 8)
    with ThreadPoolExecutor(3) as threads:
        other = critical_map(asked(setting), executor=threads)
        assert threads.submit(int).result() == 0  # the caller's executor stays open
    own = critical_map(asked(setting), workers=2)
    np.testing.assert_array_equal(found.stiffness, other.stiffness)
    np.testing.assert_array_equal(found.stiffness, own.stiffness)
    assert found.complete


def test_every_point_is_the_simulated_critical_stiffness_of_its_settings(
    setting: MapSettings, found: CriticalMap
) -> None:
    servo = setting.servo
    for i, steps in enumerate(STEPS):
        expected = simulated_critical_stiffness(
            servo.inertia,
            servo.damping,
            np.array(DAMPINGS)[:, None],
            setting.period,
            steps * setting.period,
            coulomb=servo.coulomb,
            position_step=2 * np.pi / servo.counts_per_rev,
            torque_limit=servo.torque_limit,
            kick=np.array(KICKS),
            tolerance=0.01,
        )
        np.testing.assert_allclose(found.stiffness[i], expected, rtol=0.02)
    assert found.delay.tolist() == [0.0, 0.002]


def test_an_interrupted_map_keeps_what_was_done_and_cancels_the_rest(setting: MapSettings) -> None:
    class Interrupted(AtOnce):
        def __init__(self) -> None:
            super().__init__(most=1)
            self.futures: list[Future[Any]] = []

        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            self.futures.append(super().submit(fn, *args, **kwargs))
            return self.futures[-1]

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    executor = Interrupted()
    partial = critical_map(asked(setting), executor=executor, progress=interrupt)
    assert not partial.complete
    assert partial.count == 2
    # the longest delay, which takes longest, is computed first
    assert np.isfinite(partial.stiffness[1, 0]).all()
    assert [future.cancelled() for future in executor.futures] == [False, True, True, True]


@pytest.mark.whole
def test_the_servos_own_delay_comes_on_top_and_may_be_a_fraction() -> None:
    sets = ("servo.delay=0.00125", "wall.velocity_samples=2")
    setting = MapSettings.of(load_config("paper-table2", sets).config)
    found = critical_map(MapQuestion(setting, [0.1], [0, 1], [0.01]), executor=AtOnce())
    np.testing.assert_allclose(found.delay, [0.00125, 0.00225])
    np.testing.assert_allclose(found.stiffness[:, :, 0], found.exact, rtol=1e-3)
    assert not setting.kick_matters


@pytest.mark.parametrize(
    ("preset", "given", "told"),
    [
        ("simulated", "servo.current_period=0.0007", r"servo\.current_period: found 0\.0007 s"),
        ("emulated-ideal", "servo.back_emf=true", r"set servo\.backend=simulated"),
    ],
)
def test_a_servo_whose_effect_a_map_leaves_out_is_refused(
    preset: str, given: str, told: str
) -> None:
    with pytest.raises(UserError, match=told):
        MapSettings.of(load_config(preset, (given,)).config)
