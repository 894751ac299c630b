"""What every law keeps: slopes within the stated ones, a potential, no pull, no hidden NaN."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.errors import ConfigError
from haptic_wall.controller.laws.shape import Grid, Shape
from haptic_wall.controller.laws.shaped import ShapedLaw
from haptic_wall.controller.laws.table import EXAMPLES, SUM, shape_of
from haptic_wall.controller.settings.load import load_config
from haptic_wall.controller.settings.model import Wall
from tests.cases import sampled

GRID = Grid(1e-3, math.tau / 4096)
PLACES = np.linspace(-1.5, 1.5, 3001)


def numbers(law: str, **changes: Any) -> Wall:
    return Wall.model_validate({"law": law, **EXAMPLES[law], **changes})


def shape(law: str) -> Shape:
    return shape_of(numbers(law), GRID)


@pytest.mark.parametrize("law", EXAMPLES)
def test_the_slope_stays_within_what_is_stated(law: str) -> None:
    made = shape(law)
    places = np.concatenate([PLACES, PLACES[-2::-1]])  # there and back
    e = np.array([made.elongation(x, 0.0, 8.0) for x in places])
    slopes = np.diff(e) / np.diff(places)
    assert made.lowest_slope - 1e-6 <= slopes.min()
    assert slopes.max() <= made.highest_slope + 1e-6
    assert max(-made.lowest_slope, made.highest_slope) == (0.0 if law == "damper" else 1.0)
    if law != SUM:  # its parts need not be steepest at one place
        assert max(-slopes.min(), slopes.max()) == pytest.approx(
            max(-made.lowest_slope, made.highest_slope), abs=0.01
        )


@pytest.mark.parametrize("law", [law for law in EXAMPLES if law != "friction"])
def test_the_potential_is_what_the_elongation_adds_up_to(law: str) -> None:
    made = shape(law)
    e = np.array([made.elongation(x, 0.0, 8.0) for x in PLACES])
    u = np.array([made.potential(x) for x in PLACES])
    work = 0.5 * (e[1:] + e[:-1]) * np.diff(PLACES)
    assert np.diff(u) == pytest.approx(work, abs=2e-6)
    assert u.min() >= 0.0
    assert (np.abs(e) <= np.sqrt(2.0 * u) + 1e-6).all()


@pytest.mark.parametrize("law", sampled(EXAMPLES, 3))
def test_a_law_that_says_so_stores_its_work_on_any_path_at_any_speed(law: str) -> None:
    made, random = shape(law), np.random.default_rng(1)
    worst = 0.0
    for _ in range(20):
        ends = [float(random.uniform(-1.0, 1.0)), *random.uniform(-1.0, 1.0, 4).tolist()]
        made.settle(ends[0])
        path = np.concatenate([np.linspace(a, b, 2001) for a, b in itertools.pairwise(ends)])
        speeds = np.exp(random.uniform(-3.0, 5.0)) * np.sign(np.diff(path, prepend=path[0]))
        e = np.array([made.elongation(x, v, 8.0) for x, v in zip(path, speeds, strict=True)])
        work = float(np.sum(0.5 * (e[1:] + e[:-1]) * np.diff(path)))
        worst = max(worst, abs(work - (made.potential(path[-1]) - made.potential(path[0]))))
    assert (worst < 1e-5) == made.stores_work


@pytest.mark.parametrize("law", EXAMPLES)
def test_out_of_contact_nothing_acts_and_nothing_pulls(law: str) -> None:
    made = ShapedLaw(law, shape(law), 0.2)
    made.stiffness, made.damping = 8.0, 0.05
    for x, speed in itertools.product(PLACES[::20].tolist(), (-3.0, 3.0)):
        torque = made.torque(x + 0.2, speed)
        if not made.in_contact(x + 0.2):
            assert torque == 0.0
        if made.one_sided:
            assert torque * shape(law).elongation(x, 0.0, 8.0) <= 0.0


@pytest.mark.parametrize("law", EXAMPLES)
def test_no_torque_is_above_the_clip_and_nan_is_not_hidden(law: str) -> None:
    made = ShapedLaw(law, shape(law), 0.0, 0.05)
    made.stiffness, made.damping = 50.0, 0.05
    assert max(abs(made.torque(x, 1.0)) for x in PLACES[::50].tolist()) <= 0.05
    assert math.isnan(made.torque(math.nan, 0.0))
    assert math.isnan(made.elongation(math.nan))


@pytest.mark.parametrize("law", EXAMPLES)
def test_a_softened_law_is_softer_everywhere(law: str) -> None:
    whole, soft = ShapedLaw(law, shape(law), 0.0), ShapedLaw(law, shape(law), 0.0)
    whole.stiffness = soft.stiffness = 8.0
    soft.derating.scale = 0.25
    for x in PLACES[::20].tolist():
        assert soft.torque(x, 0.0) == pytest.approx(0.25 * whole.torque(x, 0.0))


def test_a_softened_law_has_its_whole_limit_deeper_than_the_motion() -> None:
    """A push of more than the softer limit went through it by turns."""
    law = ShapedLaw("stops", shape("stops"), 0.0)
    law.stiffness = 8.0
    law.derating.scale, law.derating.elastic_limit = 0.25, 0.25 * 2.0
    end = next(x for x in PLACES.tolist() if x > 0.0 and law.in_contact(x))
    for deep in (0.4, 0.8, 1.6):
        law.derating.soft_to = end + 0.4
        spring = 2.0 * law._shape.elongation(end + deep, 0.0, 8.0)
        wanted = min(spring, 0.5 + max(2.0 * (deep - 0.4), 0.0))
        assert law.torque(end + deep, 0.0) == pytest.approx(-wanted, abs=1e-6)


def test_friction_slips_at_its_torque_and_starts_anew_at_rest() -> None:
    law = ShapedLaw("friction", shape("friction"), 0.0)
    law.stiffness = 8.0
    law.settle(0.3)
    assert law.torque(0.3, 0.0) == 0.0
    assert law.torque(0.305, 0.0) == pytest.approx(-0.04)
    assert law.torque(0.5, 0.0) == pytest.approx(-0.1)
    assert law.torque(0.49, 0.0) == pytest.approx(-0.02)
    assert law.elongation(0.49) == pytest.approx(0.0025)
    law.settle(0.0)
    assert law.torque(0.0, 0.0) == 0.0


def test_a_texture_fades_with_speed() -> None:
    made, full = shape("texture"), 0.1 / 8e-3
    e = [made.elongation(0.025, speed, 1.0) for speed in (full, 1.5 * full, -2.0 * full)]
    assert e == pytest.approx([0.1 / math.tau, 0.05 / math.tau, 0.0])


def test_parts_of_a_sum_keep_their_shares() -> None:
    made, detents = shape(SUM), shape_of(Wall(law="detents", width=0.2, snap=0.1), GRID)
    assert made.elongation(0.02, 0.0, 1.0) == pytest.approx(detents.elongation(0.02, 0, 1) / 4.0)
    assert made.potential(0.8) == pytest.approx(0.75 * 0.5 * 0.2**2, rel=1e-3)
    assert made.steepest == "stops"
    assert made.damped_everywhere


def test_a_sum_whose_parts_pull_apart_holds_no_energy_where_it_rests() -> None:
    parts = [{"law": "spring"}, {"law": "stops", "low": 0.2, "high": 5.0}]
    made = shape_of(Wall.model_validate({"law": "sum", "parts": parts}), GRID)
    assert made.elongation(0.1, 0.0, 1.0) == pytest.approx(0.0)
    assert made.potential(0.1) == pytest.approx(0.0, abs=1e-6)
    assert made.potential(0.2) == pytest.approx(0.5 * 0.1**2, rel=1e-3)
    assert made.potential(0.0) == pytest.approx(0.5 * 0.1**2, rel=1e-3)


def test_the_guard_learns_what_a_law_is() -> None:
    sets = ["law=stops", "low=-1", "high=1"], ["law=detents", "count=24", "snap=0.4"], ["law=none"]
    stops, detents, none = (
        load_config("simulated", [f"wall.{each}" for each in numbers]).config.request()
        for numbers in sets
    )
    assert (stops.side, stops.linear, stops.law) == ("above", False, "stops")
    assert (detents.side, detents.linear, detents.law) == ("both", False, "detents, its crest")
    assert (none.side, none.linear, none.stiffness, none.damping) == ("both", True, 0.0, 0.0)
    assert [shape(law).lowest_slope < 0.0 for law in ("stops", "detents")] == [False, True]
    assert shape("profile").own_stiffness == pytest.approx(2.0 / 0.3)
    dampers = Wall.model_validate({"law": "sum", "parts": [{"law": "damper"}] * 2})
    assert shape_of(dampers, GRID).own_stiffness == 0.0
    assert shape("friction").resolved == pytest.approx(0.1 / (4 * GRID.step))


@pytest.mark.parametrize(
    ("sets", "field", "said"),
    [
        (["law=stops", "low=0"], "high", "found nothing"),
        (["law=stops", "low=1", "high=0.9"], "high", "an end above wall.low"),
        (["law=detents"], "count", "found nothing"),
        (["law=detents", "count=8", "width=1"], "count", "found wall.width too"),
        (["law=detents", "count=512"], "count", "at least 16 encoder counts"),
        (["law=detents", "count=8", "snap=0.5"], "snap", "from 0.05 to 0.45"),
        (["law=texture", "period=0.01"], "period", "at least 8 encoder counts"),
        (["law=friction"], "friction", "the torque at which it slips"),
        (["law=profile", "profile=[[0, 1], [0, 0]]"], "profile", "rising positions"),
        (["law=profile", "profile=[[0, -1], [1, 0]]"], "profile", "drive the shaft away"),
        (["law=profile", "profile=[[0, 1], [1e-320, -1]]"], "profile", "between two positions"),
        (["law=sum"], "parts", "found none"),
        (["law=sum", "parts=[{law: stops, low: 0}]"], "parts", "in part 0, stops.high"),
        (["law=sum", "parts=[{law: sum}]"], "parts", "a sum in part 0"),
        (
            ["law=texture", "period=0.1", "passivity_control=true"],
            "passivity_control",
            "the law texture",
        ),
        (
            ["law=sum", "parts=[{law: friction, friction: 0.1}]", "passivity_control=true"],
            "passivity_control",
            "the law friction",
        ),
        (["law=ridges"], "law", "one of wall, stops"),
    ],
)
def test_numbers_that_make_no_law_are_refused(sets: list[str], field: str, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load_config("simulated", [f"wall.{each}" for each in sets])
    (problem,) = refused.value.problems
    assert problem.startswith(f"wall.{field} ") or problem.startswith(f"wall.{field}:")
    assert said in problem


def test_the_encoder_of_the_servo_that_is_there_decides() -> None:
    config = load_config("simulated", ["wall.law=detents", "wall.count=200"]).config
    with pytest.raises(ConfigError, match=r"wall\.count"):
        config.law(math.tau / 1024)
