"""Several axes in one configuration: each is what it would be in a file of its own."""

import math
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.settings.axes import compact
from haptic_wall.controller.settings.axes_rules import BARE_INERTIA, unlike_model
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.settings.load import load_config, loaded, preset_names
from haptic_wall.hw.dynamixel.rules import OF_PRESETS

TWO = ("axes={shoulder: {servo: {id: 1}}, elbow: {servo: {id: 2}}}",)
OWN: dict[str, list[Any]] = {
    "servo.inertia": [0.01, 0.02],
    "servo.sign": [1, -1],
    "servo.offset": [0.0, 0.5],
    "servo.torque_limit": [None, 1.0],
    "servo.hand": ["none", "push"],
    "wall.stiffness": [0.0, 3, 7.5],
    "wall.position": [-1.0, 1.0],
    "wall.side": ["above", "both"],
    "wall.torque_clip": [None, 0.5],
    "model.inertia": [None, 0.011, {"value": 0.011, "low": 0.01, "high": 0.02}],
    "model.delay": [None, 0.001],
}
SHARED: dict[str, Any] = {
    "loop": {"rate_hz": 500.0, "clock": "simulated"},
    "servo": {"backend": "dynamixel", "port": "emulated", "baud": 4000000, "model": "XM430-W350"},
    "delay": {"steps": 1},
}


def placed(values: dict[str, Any], into: dict[str, Any]) -> dict[str, Any]:
    for path, value in values.items():
        section, name = path.split(".")
        into.setdefault(section, {})[name] = value
    return into


def some_values() -> st.SearchStrategy[dict[str, Any]]:
    fields = {path: st.sampled_from(values) for path, values in OWN.items()}
    return st.fixed_dictionaries({}, optional=fields)


@settings(deadline=None)
@given(some_values(), st.lists(some_values(), min_size=1, max_size=3))
def test_an_axis_is_what_a_file_of_its_own_makes_it(
    default: dict[str, Any], axes: list[dict[str, Any]]
) -> None:
    base = {"servo.inertia": 0.011} | default
    shared = {name: dict(section) for name, section in SHARED.items()}
    whole = placed(base, {name: dict(section) for name, section in shared.items()})
    whole["axes"] = {
        f"axis_{place}": placed(axis, {"servo": {"id": place}}) for place, axis in enumerate(axes)
    }
    config = loaded(whole, "of several axes")
    for place, (name, axis) in enumerate(zip(config.each, axes, strict=True)):
        servo = {"servo.id": place} | ({"model.bare": True} if len(axes) > 1 else {})
        alone = placed(base | axis | servo, {k: dict(v) for k, v in shared.items()})
        own = loaded(alone, "of one")
        assert name == f"axis_{place}"
        assert config.each[name] == own
        assert config.servos()[place] == own.servos()[0]
    assert Config.model_validate_json(config.model_dump_json()) == config
    assert loaded(compact(config.model_dump(mode="json")), "of several axes, short") == config


def test_the_names_of_the_bus_are_those_of_its_servo(tmp_path: Path) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(yaml.safe_dump(SHARED | {"bus": {"port": "/dev/ttyUSB7", "baud": 1000000}}))
    belief = [f"model.{each}=0.01" for each in ("inertia", "damping", "coulomb", "delay")]
    config = load_config(str(file), [*belief, "model.torque_gain=1", "loop.clock=monotonic"]).config
    assert (config.servo.port, config.servo.baud) == ("/dev/ttyUSB7", 1000000)
    assert config.servo.kind == "hardware"
    with pytest.raises(ConfigError, match=r"bus\.port: found 5, wanted a text or null"):
        loaded(SHARED | {"bus": {"port": 5}}, "of a file")
    later = ["bus.port=/dev/ttyUSB8", "servo.port=emulated", "servo.inertia=0.01"]
    changed = load_config(str(file), later).config
    assert changed.servo.kind == "emulated"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("axes.elbow.wall.stiffness=-3", "axes.elbow.wall.stiffness: found -3, want"),
        ("wall.stiffness=-3", "wall.stiffness: found -3, wanted a number from 0"),
        ("axes.elbow.wall.stifness=3", "unknown; did you mean axes.elbow.wall.stiffness?"),
        ("axes.elbow.loop.rate_hz=3", "axes.elbow.loop: unknown"),
        ("axes.elbow.wall.law=detents", "axes.elbow.wall.count: found nothing, wanted the number"),
        ("axes.elbow=3", "axes.elbow: found 3, wanted a section with servo, model"),
        ("axes={Elbow: {}}", "axes.Elbow: found 'Elbow', wanted small letters"),
        ("axes.elbow.wall={}", "axes.elbow.wall={}: found a whole section; give one setting"),
        ("axes.elbow.servo.id=1", "found 1, which is also that of axes.shoulder, wanted an id"),
        ("axes.elbow.servo.port=/dev/x", "as servo.port: all axes share one bus; set servo.port"),
        ("axes.elbow.servo.sign=0", "axes.elbow.servo.sign: found 0, wanted 1 or -1"),
        ("axes.elbow.model.inertia=0.1", "wanted at most 0.017927, that of a bare XM430-W350"),
        ("axes.elbow.servo.model=XL330-M288", "no supply suits both"),
        ("servo.baud=57600", "at which a cycle with 2 servos takes 14.6 ms on the wire"),
        ("bus.baud=5", "bus.baud: found 5, wanted one of 9600"),
        ("servo.faults=unplug:id=7", "no servo on this bus has the id 7; the ids here are 1, 2"),
    ],
)
def test_what_is_wrong_with_an_axis_is_said_with_its_path(change: str, said: str) -> None:
    assert list(load_config("emulated-ideal", TWO).config.each) == ["shoulder", "elbow"]
    with pytest.raises(ConfigError) as refused:
        load_config("emulated-ideal", [*TWO, change])
    (problem,) = refused.value.problems
    assert said in problem


@pytest.mark.parametrize("silent", ["shoulder", "elbow", "neither"])
def test_another_model_does_not_pass_with_the_inertia_of_the_first(silent: str) -> None:
    """Whichever axis has no law: it may get one while it runs."""
    other = ["model.inertia=0.01", "axes.elbow.servo.model=XM430-W210"]
    other += [] if silent == "neither" else [f"axes.{silent}.wall.law=none"]
    with pytest.raises(ConfigError, match=r"model\.inertia: found that of servo\.model, a bare"):
        load_config("emulated-ideal", [*TWO, *other])
    load_config("emulated-ideal", [*TWO, *other, "axes.elbow.model.inertia=0.004"])


def test_all_axes_do_not_pass_with_the_inertia_of_another_model() -> None:
    other = [f"axes.{name}.servo.model=XM430-W210" for name in ("shoulder", "elbow")]
    with pytest.raises(ConfigError) as refused:
        load_config("emulated-ideal", [*TWO, "model.inertia=0.01", *other])
    assert len(refused.value.problems) == 3  # each axis's, and the bound that they inherit


def test_axes_without_a_common_model_do_not_share_an_inertia() -> None:
    other = ["servo.model=null", "axes.shoulder.servo.model=XM430-W350"]
    other += ["model.inertia=0.01", "axes.elbow.servo.model=XM430-W210"]
    with pytest.raises(ConfigError, match=r"found that of axes\.shoulder, a bare XM430-W350"):
        load_config("emulated-ideal", [*TWO, *other])


@pytest.mark.parametrize(
    ("preset", "model", "bare", "links"),
    [("xl330-m288", "XL330-M077", 0.00019, 0.0002), ("xm430-w350", "XM430-W210", 0.0064, 0.0066)],
)
def test_an_arm_is_no_bare_servo_behind_another_gear(
    preset: str, model: str, bare: float, links: float
) -> None:
    sets = ["axes={one: {servo: {id: 1}}, two: {servo: {id: 2}}}", f"servo.model={model}"]
    load_config(preset, [*sets, f"model.inertia={bare}"])
    with pytest.raises(ConfigError, match=f"that of a bare {model}"):
        load_config(preset, [*sets, f"model.inertia={links}"])


def test_a_fault_may_name_any_servo_of_the_bus() -> None:
    config = load_config("emulated-ideal", [*TWO, "servo.faults=unplug:id=2"]).config
    assert [each.faults for each in config.servos()] == [("unplug:id=2",)] * 2


@pytest.mark.parametrize(
    ("preset", "known"), [("emulated-arm", "mean base"), ("simulated", "none")]
)
def test_set_adds_no_axis(preset: str, known: str) -> None:
    with pytest.raises(ConfigError, match=rf"axes\.bse: no such axis; .*{known}"):
        load_config(preset, ["axes.bse.servo.inertia=0.02"])


def test_at_most_sixteen_axes() -> None:
    axes: dict[str, dict[str, Any]] = {f"a{place}": {} for place in range(17)}
    with pytest.raises(ConfigError, match="wanted at most 16 names"):
        load_config("simulated", [f"axes={axes}"])


def test_the_bare_inertias_are_those_of_the_presets() -> None:
    presets = [load_config(name).config for name in preset_names()]
    known = {one.servo.model: one.belief().inertia for one in presets if one.model.inertia}
    bare = {model: (known[model].low, known[model].high) for model in BARE_INERTIA}
    assert bare == BARE_INERTIA
    assert {model.lower() for model in OF_PRESETS} <= {*preset_names()}
    assert {*OF_PRESETS} == BARE_INERTIA.keys()


@pytest.mark.parametrize(
    ("preset", "changes", "said"),
    [
        ("xm430-w350", [], ""),
        ("xm430-w350", ["servo.model=XL330-M288"], ""),  # a load may be identified with it
        ("xl330-m288", ["servo.model=XM430-W350"], "at most 0.00272 kg·m².*at least 0.00398"),
        ("xm430-w350", ["servo.model=XM540-W270"], ""),
        ("xl330-m288", ["model.inertia=0.0008"], ""),  # in the unit of a torque twice too large
        ("emulated-xm430", ["servo.model=XL330-M288"], ""),
    ],
)
def test_a_belief_that_cannot_be_of_the_servos_model_is_told(
    preset: str, changes: list[str], said: str
) -> None:
    found = unlike_model(load_config(preset, changes).config)
    assert re.search(said, found) if said else not found


def test_an_axis_believes_its_load_beside_the_motor() -> None:
    flexible = ["model.load_inertia=0.1", "model.transmission_stiffness=200"]
    arm = load_config("emulated-arm", flexible).config
    belief = loaded(arm.each["elbow"].model_dump(), "of one").belief()
    assert belief.load_inertia.high > belief.inertia.high
    hertz = math.sqrt(200.0 * (1.0 / belief.inertia.value + 10.0)) / math.tau
    assert belief.flexible_hz.value == pytest.approx(hertz)


def test_numbers_of_another_law_are_refused_or_go_with_their_law() -> None:
    with pytest.raises(ConfigError, match=r"wall\.low: .*it is for wall.law stops"):
        load_config("simulated", ["wall.low=-0.3"])
    with pytest.raises(ConfigError, match=r"axes\.base\.wall\.low: .*it is for wall.law stops"):
        load_config("emulated-arm", ["axes.base.wall.low=-0.3", "axes.base.wall.law=wall"])
    wall = load_config("emulated-arm", ["axes.base.wall.law=wall"]).config.each["base"].wall
    assert (wall.law, wall.low) == ("wall", None)
    assert load_config("emulated-arm", ["axes.base.wall.law=stops"]).config.each["base"].wall.low
    rests = load_config("emulated-arm", ["axes.base.wall.law=none", "axes.base.wall.low=-0.3"])
    assert rests.config.each["base"].wall.low == -0.3
