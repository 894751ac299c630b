"""The tuning says what each of its numbers is, and a variant of it is what the detector uses."""

import math
from dataclasses import FrozenInstanceError, fields, replace

import pytest

from haptic_wall.controller.detector.backstop import Backstop, Phase
from haptic_wall.controller.detector.backstop_settings import BackstopSettings, sizes
from haptic_wall.controller.detector.half_cycles import HalfCycles
from haptic_wall.controller.detector.oscillation import Detector, DetectorSettings
from haptic_wall.controller.detector.tuning import TUNING, Origin, Tuning

NUMBERS = [
    (group.name, one) for group in fields(TUNING) for one in fields(getattr(TUNING, group.name))
]
PERIOD, COUNT = 1e-3, math.tau / 4096


def test_each_number_has_a_unit_a_meaning_and_a_source() -> None:
    for group, one in NUMBERS:
        origin = one.metadata["origin"]
        assert isinstance(origin, Origin), f"{group}.{one.name}"
        assert origin.unit
        assert len(origin.meaning) > 10
        kind = origin.source.split(":")[0]
        assert kind in ("measured", "quantisation", "arithmetic", "physics", "chosen"), one.name


def test_a_value_that_leaves_a_criterion_out_is_another_one() -> None:
    for group, one in NUMBERS:
        origin = one.metadata["origin"]
        assert origin.off != getattr(getattr(TUNING, group), one.name), f"{group}.{one.name}"


def test_nobody_changes_it() -> None:
    with pytest.raises(FrozenInstanceError):
        TUNING.probe.first = 2.0  # type: ignore[misc]


def oscillation(tuning: Tuning) -> Backstop:
    """A backstop that has seen 5 Hz with 0.1 rad to either side for two seconds."""
    threshold, small = sizes(COUNT, tuning)
    seen = HalfCycles(PERIOD, COUNT, tuning.half_cycles)
    settings = BackstopSettings(
        period=PERIOD,
        position_step=COUNT,
        threshold=threshold,
        small=small,
        light=0.0,
        heavy=math.inf,
        heaviest=0.02,
        rest_torque=0.1,
        torque_limit=4.1,
        tuning=tuning,
    )
    stop = Backstop(settings, seen)
    for k in range(2000):
        away = round(0.1 * math.sin(math.tau * 5.0 * k * PERIOD) / COUNT) * COUNT
        ended = seen.update(away, -10.0 * away, PERIOD)
        stop.update(PERIOD, away, 10.0, ended=ended)
        if stop.phase == Phase.PROBING:
            break
    return stop


def test_the_backstop_uses_the_tuning_that_it_is_given() -> None:
    assert oscillation(TUNING).stiffness_scale == 0.25
    deeper = replace(TUNING, probe=replace(TUNING.probe, scale=0.125))
    assert oscillation(deeper).stiffness_scale == 0.125
    blind = replace(TUNING, backstop=replace(TUNING.backstop, large_counts=1e6))
    assert oscillation(blind).probes == 0


def first_alarm(tuning: Tuning) -> int | None:
    """Samples until a growing oscillation of a wall without friction is an alarm."""
    inertia, stiffness = 0.012, 20.0
    natural = math.sqrt(stiffness / inertia)
    detector = Detector(
        DetectorSettings(PERIOD, inertia, 0.0, 0.0, COUNT, tuning=tuning),
    )
    detector.stiffness = stiffness
    detector.balance.surface = 0.0
    for k in range(3000):
        place = 0.05 * math.exp(0.4 * k * PERIOD) * math.cos(natural * k * PERIOD)
        detector.update(place, -stiffness * place)
        if detector.alarm:
            return k
    return None


def test_the_detector_uses_the_tuning_that_it_is_given() -> None:
    assert first_alarm(TUNING) is not None
    deaf = replace(
        TUNING,
        energy=replace(TUNING.energy, clear=math.inf),
        belief=replace(TUNING.belief, grown=(), grown_evenly=(), grown_unpaid=(), outward=math.inf),
    )
    assert first_alarm(deaf) is None
