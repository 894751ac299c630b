"""``haptic-wall boundary``: the promised JSON, table and picture, and what wrong input gets."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from haptic_wall.controller.theory import (
    critical_stiffness,
    linear_limit,
    max_virtual_damping,
    one_sided_limit,
    passive_limit,
)
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling, chain_peak
from haptic_wall.controller.theory.chain import one_mass, two_masses
from tests.support.program import Cli

pytestmark = pytest.mark.usefixtures("undrawn")

LOOP = ["--inertia", "0.012", "--damping", "0.0117", "--period", "0.001", "--delay", "0.002"]
POINT = {"virtual_damping", "linear", "exact", "one_sided", "passive", "frequency_hz"}


def test_the_points_are_those_of_the_theory_in_the_order_asked(cli: Cli) -> None:
    found = cli.json("boundary", *LOOP, "--virtual-damping=0.2,-0.01,0,7")
    dampings = [0.2, -0.01, 0.0, 7.0]
    assert [point["virtual_damping"] for point in found["points"]] == dampings
    m, b, t, t_d = 0.012, 0.0117, 1e-3, 2e-3
    columns = {
        "linear": linear_limit(b, dampings, t, t_d),
        "exact": critical_stiffness(m, b, dampings, t, t_d),
        "one_sided": one_sided_limit(m, b, dampings, t, t_d),
        "passive": passive_limit(b, dampings, t, t_d),
        "frequency_hz": chain_boundary(*one_mass(m, b), dampings, t, t_d).frequency,
    }
    assert {*columns, "virtual_damping"} == POINT
    for name, values in columns.items():
        assert [point[name] for point in found["points"]] == pytest.approx(values), name
    assert found["max_virtual_damping"] == pytest.approx(max_virtual_damping(m, b, t, t_d))
    # above the ceiling no stiffness is stable
    assert found["max_virtual_damping"] < 7
    assert found["points"][3]["exact"] == 0
    top = chain_peak(one_mass(m, b)[0], t, t_d)
    assert found["peak"] == pytest.approx(
        {
            "stiffness": top.stiffness[0],
            "virtual_damping": top.virtual_damping[0],
            "frequency_hz": top.frequency[0],
        }
    )


def test_the_stiffest_wall_asked_for_is_named_with_its_limit(cli: Cli) -> None:
    found = cli.json("boundary", *LOOP, "--virtual-damping=0.05,0.2,0.1")
    stiffest = max(found["points"], key=lambda point: point["one_sided"])
    design = found["design"]
    assert design["virtual_damping"] == stiffest["virtual_damping"] == 0.2
    assert (design["binding"], design["stiffness"]) == ("one_sided", stiffest["one_sided"])
    both = cli.json("boundary", *LOOP, "--virtual-damping=0.2", "--side", "both")["design"]
    assert both["binding"] == "exact"


def test_bounds_give_the_least_safe_corner(cli: Cli) -> None:
    sets = ["model.inertia={value: 0.012, low: 0.010, high: 0.014}"]
    sets += ["model.damping={value: 0.01, low: 0.008, high: 0.02}"]
    sets += ["model.torque_gain={value: 1, low: 0.9, high: 1.2}"]
    words = [word for each in sets for word in ("--set", each)]
    found = cli.json("boundary", "simulated", *words, "--delay=0.002", "--virtual-damping=0.1")
    (point,) = found["points"]
    corner = critical_stiffness(0.010, 0.008, 1.2 * 0.1, 1e-3, 2e-3) / 1.2
    assert point["exact"] == pytest.approx(corner)


@pytest.mark.whole
@pytest.mark.parametrize("damping", ["9", "-0.0117", "-1"])
def test_where_no_stiffness_is_stable_the_answer_is_nought(cli: Cli, damping: str) -> None:
    found = cli.json("boundary", *LOOP, f"--virtual-damping={damping}")
    assert found["points"][0]["exact"] == found["design"]["stiffness"] == 0


LOADED = [
    *("--load-inertia", "0.003", "--transmission-stiffness", "200"),
    *("--transmission-damping", "0.0277"),
]


@pytest.mark.parametrize("encoder", ["output", "motor"])
def test_with_a_load_the_limits_are_those_of_two_masses(encoder: str, cli: Cli) -> None:
    found = cli.json(
        "boundary",
        *LOOP,
        *LOADED,
        "--encoder",
        encoder,
        "--virtual-damping=0,0.1,0.3",
        "--side=both",
    )
    servo = (0.012, 0.0117, 0.003, 200.0, 0.0277)
    limits = chain_boundary(*two_masses(*servo, encoder=encoder), [0.0, 0.1, 0.3], 1e-3, 2e-3)
    points = found["points"]
    assert {*points[0]} >= POINT
    assert [point["exact"] for point in points] == pytest.approx(limits.stiffness)
    assert [point["frequency_hz"] for point in points] == pytest.approx(limits.frequency)
    assert [point["passive"] for point in points] == [None] * 3
    assert all(point["one_sided"] <= point["exact"] for point in points)
    ceiling = chain_ceiling(*two_masses(*servo, encoder=encoder), 1e-3, 2e-3)
    assert found["max_virtual_damping"] == pytest.approx(float(ceiling))
    dampings = np.linspace(0.0, float(ceiling), 400)
    top = chain_boundary(*two_masses(*servo, encoder=encoder), dampings, 1e-3, 2e-3).stiffness
    assert found["peak"]["stiffness"] >= np.max(top) * (1 - 1e-9)
    assert found["design"]["binding"] == "exact"


BELIEVED = [
    "simulated",
    *("--set", "servo.load_inertia=0.003", "--set", "servo.transmission_stiffness=200"),
    *("--set", "servo.transmission_damping=0.0277", "--set", "delay.steps=1"),
]


def test_a_configuration_gives_the_limits_of_the_load_that_it_believes(cli: Cli) -> None:
    found = cli.json("boundary", *BELIEVED, "--virtual-damping=0,0.1,0.25", "--side=both")
    servo = (0.011951, 0.011692, 0.003, 200.0, 0.0277)
    exact = chain_boundary(*two_masses(*servo), [0.0, 0.1], 1e-3, 1e-3).stiffness
    limits = [point["flexible"] for point in found["points"]]
    assert np.all(np.array(limits[:2]) < exact)
    assert np.all(np.array(limits[:2]) > 0.8 * exact)
    assert limits[2] == 0.0
    ceiling = float(chain_ceiling(*two_masses(*servo), 1e-3, 1e-3))
    assert 0.8 * ceiling < found["max_virtual_damping"] < ceiling
    assert found["design"]["binding"] == "flexible"
    status, out, _ = cli("boundary", *BELIEVED, "--virtual-damping=0.1")
    assert status == 0
    assert "(flexible)" in out


def test_the_picture_shades_no_vibrating_wall(
    cli: Cli, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    cli("boundary", *BELIEVED, "--virtual-damping=0.1", "--plot", tmp_path / "plane.png")
    (vibrating,) = drawn
    lines = {str(line.get_label()): line for line in vibrating.axes[0].lines}
    flexible = np.asarray(lines["flexible load"].get_ydata())
    for shaded in vibrating.axes[0].collections:
        area, *_ = shaded.get_paths()
        assert np.asarray(area.vertices)[:, 1].max() <= flexible.max()


def test_a_command_for_one_servo_wants_the_name_of_an_axis(cli: Cli) -> None:
    several = ["--set", "axes={a: {servo: {inertia: 0.01}}, b: {servo: {inertia: 0.03}}}"]
    ask = ["boundary", "simulated", "--virtual-damping", "0.1"]
    wanted = "wanted one of a, b: this command works on one servo"
    assert f"--axis: found no name, {wanted}" in cli.refused(*ask, *several)
    assert f"--axis: found c, {wanted}" in cli.refused(*ask, *several, "--axis", "c")
    assert "the configuration has no axes" in cli.refused(*ask, "--axis", "a")
    (of_axis,) = cli.json(*ask, *several, "--axis", "b")["points"]
    (alone,) = cli.json(*ask, "--set", "servo.inertia=0.03")["points"]
    assert of_axis == alone
