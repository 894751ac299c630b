"""The configuration means to the rest of the program what its fields say."""

import math

import pytest

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.guard.belief import Bounded
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config, preset_names


def loaded(preset: str, *sets: str) -> Config:
    return load_config(preset, sets).config


@pytest.mark.parametrize("name", preset_names())
def test_a_child_process_gets_the_same_configuration_as_json(name: str) -> None:
    config = loaded(name)
    copy = Config.model_validate_json(config.model_dump_json())
    assert copy == config
    assert copy.servos()[0] == config.servos()[0]
    assert copy.belief() == config.belief()


LINKED = ("servo.load_inertia=0.003", "servo.transmission_stiffness=200")


def test_a_belief_counts_the_lag_of_the_current_loop_as_delay() -> None:
    config = loaded(
        "simulated",
        "servo.delay=0.001",
        "servo.current_bandwidth=100",
        "servo.current_period=0.0005",
    )
    assert config.belief().delay.value == pytest.approx(0.0015 + 0.01 / math.tau)


def test_a_believed_current_loop_adds_its_lag_to_the_believed_delay() -> None:
    loop = "model.current_bandwidth={value: 100, low: 50, high: 200}"
    delay = loaded("xm430-w350", "servo.port=/dev/x", "model.delay=0.001", loop).belief().delay
    assert [delay.low, delay.value, delay.high] == pytest.approx(
        [0.001 + 1.0 / (math.tau * f) for f in (200, 100, 50)]
    )
    with pytest.raises(ConfigError, match=r"model\.delay: found a lag of 0\.11 s"):
        loaded("simulated", "model.delay=0.03", "model.current_bandwidth=2")


def test_belief_and_truth_can_differ() -> None:
    config = loaded(
        "simulated", "model.inertia={value: 0.02, low: 0.01, high: 0.03}", "model.delay=0.001"
    )
    assert config.belief().inertia == Bounded(0.02, 0.01, 0.03)
    assert config.belief().delay == Bounded.exactly(0.001)
    assert config.true_servo().inertia == 0.011951
    assert config.true_servo().delay == 0.0


@pytest.mark.parametrize(("side", "expected"), [("above", 0.9), ("below", 1.1), ("both", 1.0)])
def test_a_simulated_servo_starts_outside_a_one_sided_wall(side: str, expected: float) -> None:
    config = loaded("simulated", f"wall.side={side}", "wall.position=1")
    assert config.true_servo().position == pytest.approx(expected)


def test_an_emulated_bus_on_the_simulated_clock_is_in_memory() -> None:
    settings = loaded("emulated-ideal", "loop.clock=simulated").servos()[0]
    assert settings.port == ""
    assert settings.true is not None
    assert settings.true.inertia == 0.011951


def test_the_driver_does_not_know_the_emulated_torque_constant() -> None:
    config = loaded("emulated-ideal", "servo.torque_constant=2.2", "model.torque_gain=1.2")
    settings = config.servos()[0]
    assert settings.torque_constant == 0.0
    assert config.true_servo().torque_constant == 2.2


@pytest.mark.parametrize(
    ("side", "away"),
    [("above", -1), ("below", 1), ("both", -1)],
)
def test_a_real_servo_is_probed_away_from_the_wall(side: str, away: int) -> None:
    settings = loaded("xm430-w350", f"wall.side={side}", "wall.position=1").servos()[0]
    assert settings.probe_direction == away


def test_a_model_that_makes_no_torque_is_named_with_the_nearest_that_does() -> None:
    with pytest.raises(ConfigError, match=r"servo\.model.*did you mean XM430-W350\?"):
        loaded("xm430-w350", "servo.model=xm430-w305")
    for name, series in (("XL430-W250-T", "XL430"), ("xl430", "XL430"), ("XC430-W150", "XC430")):
        with pytest.raises(ConfigError, match=f"the {series}-.* has no current mode") as found:
            loaded("xm430-w350", f"servo.model={name}")
        assert "did you mean" not in str(found.value)
    with pytest.raises(ConfigError, match=r"servo\.torque_constant.*XD540-T270"):
        loaded("xm430-w350", "servo.model=XD540-T270")
    loaded("xm430-w350", "servo.model=XD540-T270", "servo.torque_constant=2.0")


@pytest.mark.parametrize(
    ("preset", "sets", "room"),
    [
        ("xm430-w350", [], 0.0),
        ("emulated-ideal", [], 0.0),
        ("emulated-ideal", ["wall.side=both"], math.radians(1.0)),
        ("emulated-ideal", ["wall.side=both", "servo.kick=0.3"], math.tau / 4),
        ("emulated-ideal", ["wall.side=both", "servo.kick=1.6"], 0.0),
        ("simulated", ["servo.kick=0.3"], math.tau / 4),
        ("simulated", ["servo.kick=0.3", "loop.clock=simulated"], math.inf),
        ("simulated", ["wall.reference=start", "loop.clock=simulated"], 0.0),
    ],
)
def test_around_what_the_wall_comes_on_at_once(preset: str, sets: list[str], room: float) -> None:
    assert loaded(preset, *sets).start_room == room


NOTCH = ["wall.velocity_filter=notch", "model.load_inertia=0.001"]


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (["wall.velocity_hz=450"], "wall.velocity_hz: .*less than 450 Hz"),
        (["wall.velocity_q=1"], "wall.velocity_q: .*at most 0.7072 for a low-pass"),
        (["wall.side=above"], "wall.velocity_filter: .*wall.side both"),
        (["guard.mode=passive"], "wall.velocity_filter: .*guard.mode stable or off"),
        (
            [*NOTCH, "model.flexible_hz={value: 50, low: 20, high: 90}"],
            "wall.velocity_filter: .*known to 60 Hz for a notch",
        ),
        (
            [*NOTCH, "model.flexible_hz=50", "servo.encoder=motor"],
            "wall.velocity_filter: .*servo.encoder output",
        ),
    ],
)
def test_a_velocity_filter_that_is_not_counted_is_refused(sets: list[str], said: str) -> None:
    plain = ["wall.side=both", "wall.velocity_filter=lowpass"]
    assert load_config("simulated", plain).config.velocity_filter() is not None
    with pytest.raises(ConfigError, match=said):
        load_config("simulated", [*plain, *sets])


def test_a_load_of_nearly_all_is_refused() -> None:
    sets = ["model.inertia=0.01", "model.flexible_hz=40"]
    load_config("simulated", [*sets, "model.load_inertia=0.0099"])
    with pytest.raises(
        ConfigError, match=r"model\.load_inertia.*at most 0\.99 times model\.inertia"
    ):
        load_config("simulated", [*sets, "model.load_inertia=0.00995"])
