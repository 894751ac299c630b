"""The guard's promises one by one: clamps, names, reasons, modes, errors."""

from __future__ import annotations

import json
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from haptic_wall.controller.guard.belief import Bounded, vibration
from haptic_wall.controller.guard.bins import Bins
from haptic_wall.controller.guard.decision_report import assumed, decision_report
from haptic_wall.controller.guard.guard import decide
from haptic_wall.controller.guard.reasons import explain
from haptic_wall.controller.guard.schedule import interval_bins_ns
from haptic_wall.controller.guard.types import (
    WITHIN,
    Decision,
    GuardSettings,
    Mode,
    Request,
    Situation,
)
from haptic_wall.controller.theory import (
    critical_stiffness,
    max_virtual_damping,
    passive_limit,
)
from haptic_wall.controller.theory.boundary import chain_boundary, chain_ceiling
from haptic_wall.controller.theory.chain import Chain, two_masses
from haptic_wall.controller.theory.velocity_filter import FilterKind, VelocityFilter
from tests.support.beliefs import belief

COUNT = 2 * math.pi / 4096


def situation(position_step: float = 0.0, **changes: Any) -> Situation:
    """A servo like an MX-64, known exactly but for the changes, at 1 kHz."""
    servo = {"inertia": 0.011951, "damping": 0.011692, "coulomb": 0.09039, "delay": 0.5e-3}
    return Situation(belief(**servo | changes), 1e-3, 4.1, position_step)


def one(
    request: Request,
    where: Situation | None = None,
    mode: Mode = "stable",
    delay: float = 1.5e-3,
    inserted: float = 0.0,
) -> Decision:
    where = replace(where or situation(), inserted=(inserted, inserted))
    (decision,) = decide(request, GuardSettings(mode), where, [delay])
    return explain(decision, GuardSettings(mode), where)


def test_a_safe_request_is_commanded_as_it_is_without_a_word() -> None:
    decision = one(Request(1.5, 0.01, "above"))
    assert (decision.stiffness, decision.damping) == (1.5, 0.01)
    assert decision.binding is None
    assert decision.reasons == ()


def test_backlash_counts_at_its_widest_and_against_the_least_friction() -> None:
    request = Request(1e6, 0.2, "both")
    assert one(request, situation(COUNT)).limits["backlash"] is None
    loose = Bounded(0.002, 0.0, 0.0044)
    wide = one(request, situation(COUNT, backlash=loose))
    assert wide.binding == "backlash"
    limit = wide.limits["backlash"]
    assert limit is not None
    assert wide.stiffness == pytest.approx(0.8 * limit)
    assert "believed backlash" in wide.reasons[0]
    narrow = one(request, situation(COUNT, backlash=0.002)).limits["backlash"]
    slippery = situation(COUNT, backlash=loose, coulomb=Bounded(0.09039, 0.045, 0.18))
    least = one(request, slippery).limits["backlash"]
    assert narrow is not None
    assert least is not None
    assert least < limit < narrow


LINK: dict[str, Any] = {
    "load_inertia": Bounded(0.003, 0.002, 0.005),
    "flexible_hz": Bounded(46.0, 35.0, 60.0),
    "flexible_damping_ratio": Bounded(0.02, 0.01, 0.05),
}


def test_a_link_on_a_flexible_transmission_lowers_the_damping_first() -> None:
    request = Request(10.0, 0.2, "both")
    rigid = one(request)
    assert (rigid.stiffness, rigid.damping, rigid.limits["flexible"]) == (10.0, 0.2, None)
    linked = one(request, situation(**LINK))
    assert linked.stiffness == 10.0
    assert linked.damping == pytest.approx(0.7 * linked.damping_ceiling)
    # (2 zeta w (J_m + J_l) + b J_l / J_m) / cos(w T) at 35 Hz, 0.01 and the lightest load
    assert 0.05 < linked.damping_ceiling < 0.08
    assert "vibrates on its flexible transmission" in linked.reasons[0]
    assert "encoder on the motor's side" in linked.reasons[0]


def test_an_encoder_on_the_motor_raises_the_limit_of_a_link() -> None:
    decision = one(Request(1e6, 0.2, "both"), situation(**LINK))
    assert decision.binding == "flexible"
    motor = one(Request(1e6, 0.2, "both"), situation(**LINK, encoder="motor"))
    assert motor.stiffness > 2.0 * decision.stiffness
    assert motor.damping == 0.2


def test_doubt_about_a_link_lowers_what_is_commanded() -> None:
    known = {name: each.value for name, each in LINK.items()}
    request = Request(1e6, 0.2, "above")
    least = one(request, situation(**known))
    for name, each in LINK.items():
        doubted = one(request, situation(**{**known, name: each}))
        assert doubted.damping < 0.99 * least.damping
    assert one(request, situation(**LINK)).damping < least.damping


def test_limits_of_a_link_are_the_same_on_all_cores_and_where_no_thread_can_be_had(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    request = Request(1e6, 0.2, "both")
    where = situation(**{**LINK, "flexible_hz": Bounded(46.0, 10.0, 100.0)})
    delays = [16e-3, 18e-3]
    turns: list[int] = []

    def refuse(*_: object, **__: object) -> None:
        turns.append(1)
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0, 1})
    together = decide(request, GuardSettings(), where, delays)
    monkeypatch.setattr(ThreadPoolExecutor, "submit", refuse)
    assert decide(request, GuardSettings(), where, delays) == together
    assert turns, "there was something to share"
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0})
    turns.clear()
    assert decide(request, GuardSettings(), where, delays) == together
    assert not turns


@pytest.mark.parametrize("stiffness", [1e6, 1e12, 1e300])
def test_absurd_stiffness_is_a_legal_request(stiffness: float) -> None:
    asked, absurd = one(Request(1e5, 0.1, "above")), one(Request(stiffness, 0.1, "above"))
    assert absurd.stiffness == asked.stiffness
    assert absurd.binding == "one_sided"


def test_damping_below_what_the_device_has_is_raised() -> None:
    decision = one(Request(1.0, -0.02, "both"))
    assert decision.damping == pytest.approx(-0.7 * 0.011692)
    assert decision.stiffness > 0
    assert any("-0.02" in reason and "-0.01169" in reason for reason in decision.reasons)
    kept = one(Request(1.0, -0.005, "both"))
    assert kept.damping == -0.005


@pytest.mark.parametrize("stiffness", [0.0, 5.0])
def test_damping_below_0_is_not_commanded_where_it_feeds_a_load_by_itself(stiffness: float) -> None:
    load, hertz, samples, damping = 2e-4, 20.0, 32, -0.005
    loop = (damping, 1e-3, 2e-3, samples)
    assert chain_boundary(*two_masses(*linked(load, hertz, 0.0)), *loop).stiffness == 0.0
    link = situation(load_inertia=load, flexible_hz=hertz)
    decision = one(Request(stiffness, damping, "both", samples), link)
    assert (decision.stiffness, decision.damping) == (0.0, 0.0)
    assert any("-0.005" in reason for reason in decision.reasons)


def test_without_any_damping_no_stiffness_is_commanded_and_the_reason_says_what_to_do() -> None:
    decision = one(Request(5.0, 0.0, "above"), situation(damping=0.0))
    assert decision.stiffness == 0
    assert decision.binding == "linear"
    assert any("give the wall virtual damping" in reason for reason in decision.reasons)


def test_quantisation_leaves_the_share_of_one_count() -> None:
    decision = one(Request(1e6, 0.2, "both"), situation(COUNT))
    left = 0.1 * 4.1 - 0.2 * COUNT / 1e-3
    assert decision.limits["quantisation"] == pytest.approx(left / COUNT, rel=0.01)
    # a difference over 4 samples divides what one count commands by 4
    longer = one(Request(1e6, 0.2, "both", velocity_samples=4), situation(COUNT))
    assert longer.limits["quantisation"] == pytest.approx(
        (0.41 - 0.05 * COUNT / 1e-3) / COUNT, rel=0.01
    )
    assert one(Request(1e6, 0.2, "both")).limits["quantisation"] is None


def test_mode_passive_keeps_the_wall_passive() -> None:
    decision = one(Request(1e6, 3.0, "both"), mode="passive")
    assert decision.damping == pytest.approx(0.7 * 0.011692)
    assert decision.binding == "passive"
    expected = passive_limit(0.011692, decision.damping, 1e-3, 2e-3)
    assert decision.stiffness == pytest.approx(0.8 * expected)
    assert one(Request(1e6, 3.0, "both")).limits["passive"] is None


def test_mode_off_commands_what_is_asked_and_says_so() -> None:
    decision = one(Request(1e6, 5.0, "above"), mode="off")
    assert (decision.stiffness, decision.damping) == (1e6, 5.0)
    assert decision.binding is None
    assert "the guard is off" in decision.reasons[0]
    assert decision.limits["exact"] is not None


def test_only_friction_is_told_where_the_guard_is_off() -> None:
    critical = float(critical_stiffness(0.011951, 0.011692, 0.0, 1e-3, 2e-3))
    rough, smooth = situation(), situation(coulomb=0.0)
    above, below = Request(1.01 * critical, 0.0, "both"), Request(0.99 * critical, 0.0, "both")
    assert one(above, rough, "off").only_friction
    assert any("friction" in reason for reason in one(above, rough, "off").reasons)
    assert not one(below, rough, "off").only_friction
    assert not one(above, smooth, "off").only_friction
    assert not one(above, rough).only_friction
    ceiling = float(max_virtual_damping(0.011951, 0.011692, 1e-3, 2e-3))
    assert one(Request(0.0, 1.01 * ceiling, "both"), rough, "off").only_friction


def test_the_reasons_say_what_was_asked_what_bound_it_and_what_would_raise_it() -> None:
    request = Request(1000.0, 0.2, "above")
    wide = situation(damping=Bounded(0.011692, 0.006, 0.023))
    decision = one(request, wide, delay=3e-3, inserted=1e-3)
    first, *others = decision.reasons
    assert "instead of 1000 N·m/rad" in first
    assert f"the guard allows {decision.stiffness:.4g}" in first
    assert "one_sided" in first
    # period/2 + 3 ms + the servo's 0.5 ms; the age is 2 ms of it
    age = next(reason for reason in others if "a sample's age" in reason)
    assert "of 1 ms instead of 2 ms, 50 % of the total delay (period/2 + delay = 4 ms)" in age
    at_half = one(request, wide, delay=2e-3, inserted=1e-3)
    # remedies are told to two digits, of limits found to 2 %
    assert float(age.rsplit(" ", 1)[1]) == pytest.approx(at_half.stiffness, rel=0.07)
    other = next(reason for reason in others if "with virtual damping" in reason)
    there = float(other.split()[3])
    at_other = one(replace(request, damping=there), wide, delay=3e-3, inserted=1e-3)
    assert float(other.rsplit(" ", 1)[1]) == pytest.approx(at_other.stiffness, rel=0.1)
    two_sided = one(replace(request, side="both"), wide, delay=3e-3)
    pulling = next(reason for reason in others if "with a two-sided wall" in reason)
    assert float(pulling.rsplit(" ", 1)[1]) == pytest.approx(two_sided.stiffness, rel=0.05)
    assert len(decision.reasons) == 4


@pytest.mark.parametrize("mode", ["stable", "passive", "off"])
@pytest.mark.parametrize("damping", [0.0, -1.0, 1e9])
def test_the_report_is_plain_json(mode: Mode, damping: float) -> None:
    report = decision_report(one(Request(1e12, damping, "above"), situation(COUNT), mode))
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert set(report) == {
        "requested", "commanded", "limit", "damping_ceiling", "encoder_damping", "margin",
        "binding", "reasons", "only_friction", "interval_s", "velocity_filter",
    }  # fmt: skip


def test_the_report_names_the_filter_at_the_counted_interval() -> None:
    notch = VelocityFilter("notch", math.tau * 46e-3, 0.7)
    report = decision_report(one(Request(1.0, 0.1, "both", velocity_filter=notch), situation()))
    told = {"kind": "notch", "frequency_hz": pytest.approx(46.0), "q": 0.7}
    assert report["velocity_filter"] == told
    assert decision_report(one(Request(1.0, 0.1, "both"), situation()))["velocity_filter"] is None


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Request(-1.0, 0.0, "above"), "stiffness must be finite and >= 0, got -1"),
        (lambda: Request(math.nan, 0.0, "above"), "stiffness must be finite and >= 0, got nan"),
        (lambda: GuardSettings(margin=1.0), "margin must be between 0 and 1, got 1"),
        (lambda: replace(situation(), torque_limit=0.0), "torque_limit must be > 0, got 0"),
        (lambda: situation(-1.0), "position_step must be >= 0, got -1"),
        (lambda: one(Request(1.0, 0.0, "above"), delay=-1.0), "delays must be >= 0, got -1"),
        (
            lambda: one(Request(1.0, 0.0, "above"), situation(inertia=0.0)),
            "inertia must be > 0, got 0",
        ),
        (
            lambda: Request(1.0, 0.1, "above", velocity_filter=VelocityFilter("notch", 0.3, 0.7)),
            "one-sided wall with a velocity filter",
        ),
    ],
)
def test_errors_name_what_is_wrong(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=message):
        make()


def linked(load: float, hz: float, ratio: float) -> tuple[float, float, float, float, float]:
    """Motor, friction, load, stiffness and damping of a servo of 0.011951 kg·m² in all."""
    motor = 0.011951 - load
    moving, rate = motor * load / 0.011951, 2 * math.pi * hz
    return motor, 0.011692, load, moving * rate**2, 2 * ratio * moving * rate


@pytest.mark.parametrize("load", [0.001, 0.003, 0.006, 0.009])
def test_the_believed_inertia_is_that_of_motor_and_load(load: float) -> None:
    where = situation(load_inertia=load, flexible_hz=46.0, flexible_damping_ratio=0.02)
    decision = one(Request(1e6, 1.0, "both"), where, inserted=1.5e-3)
    servo = linked(load, 46.0, 0.02)
    ceiling = chain_ceiling(*two_masses(*servo), 1e-3, 2e-3)
    limit = chain_boundary(*two_masses(*servo), decision.damping, 1e-3, 2e-3).stiffness
    assert 0.8 * ceiling < decision.damping_ceiling < ceiling
    assert decision.limits["flexible"] is not None
    assert 0.85 * limit < decision.limits["flexible"] < limit


def test_jitter_also_makes_an_inserted_delay_longer() -> None:
    """In the first bin ticks may be 5 % longer apart, and so may a torque wait in the ring."""
    inertia, load, hz, ratio = 5.482e-3, 3.668e-3, 322.1, 7.6e-4
    where = situation(
        inertia=inertia,
        damping=6.5e-3,
        load_inertia=load,
        flexible_hz=hz,
        flexible_damping_ratio=ratio,
    )
    asked = Request(1e9, 1.0, "both"), GuardSettings(), where
    intervals = interval_bins_ns(1_000_000, flexible=True)
    (wall,) = Bins(*asked, 1, [70_000], intervals).decide_interval(0)
    moving, rate = (inertia - load) * load / inertia, math.tau * hz
    servo = (inertia - load, 6.5e-3, load, moving * rate**2, 2.0 * ratio * moving * rate)
    period = WITHIN * 1e-3
    late = period + 70e-6 + 5e-4
    limit = chain_boundary(*two_masses(*servo), wall.damping, period, late).stiffness
    assert 0.5 * limit < wall.stiffness < 0.85 * limit


def test_a_bare_horn_is_counted_by_a_formula_below_its_exact_limits() -> None:
    random = np.random.default_rng(3)
    for _ in range(8):
        load, hz = (
            float(np.exp(random.uniform(*np.log(ends)))) for ends in ((1e-7, 3e-4), (500.01, 9e3))
        )
        ratio = float(random.uniform(0.003, 0.1))
        encoder = random.choice(["output", "motor"])
        where = situation(
            load_inertia=load, flexible_hz=hz, flexible_damping_ratio=ratio, encoder=encoder
        )
        assert where.belief.is_fast(1e-3)
        decision = one(Request(1e6, 20.0, "both"), where)
        servo = linked(load, hz, ratio)
        ceiling = chain_ceiling(*two_masses(*servo, encoder=encoder), 1e-3, 2e-3)
        assert decision.damping_ceiling < ceiling
        found = chain_boundary(*two_masses(*servo, encoder=encoder), decision.damping, 1e-3, 2e-3)
        assert decision.limits["flexible"] is not None
        assert decision.limits["flexible"] < found.stiffness


@pytest.mark.parametrize("ratio", [0.0, 1e-7, 1e-5])
def test_a_bare_horn_hardly_damped_is_fed_by_the_spring_alone(ratio: float) -> None:
    """Without virtual damping, far below the rigid servo's limit."""
    where = situation(
        load_inertia=1e-5,
        flexible_hz=530.0,
        flexible_damping_ratio=ratio,
    )
    with np.errstate(all="raise"):
        decision = one(Request(1e6, 1e-4, "both"), where, delay=4.5e-3)
    if ratio == 0.0:
        assert (decision.damping_ceiling, decision.damping) == (0.0, 0.0)
    limit = chain_boundary(
        *two_masses(*linked(1e-5, 530.0, ratio)), decision.damping, 1e-3, 5e-3
    ).stiffness
    assert decision.limits["flexible"] is not None
    assert decision.limits["flexible"] < limit
    assert decision.limits["exact"] is not None
    if ratio < 1e-6:
        assert limit < 0.8 * decision.limits["exact"]
        assert decision.binding == "flexible"


def test_a_load_follows_from_the_gear_trains_stiffness() -> None:
    whole, load = Bounded(0.012, 0.010, 0.015), Bounded(0.003, 0.002, 0.004)
    found = vibration(whole, load, Bounded(200.0, 100.0, 400.0))
    random = np.random.default_rng(5)
    for _ in range(300):
        m, j, k = (
            float(random.uniform(*ends)) for ends in ((0.010, 0.015), (0.002, 0.004), (100, 400))
        )
        hz = math.sqrt(k * (1 / (m - j) + 1 / j)) / math.tau
        assert found.low * (1 - 1e-12) <= hz <= found.high * (1 + 1e-12)


def test_what_is_assumed_of_an_unknown_vibration_is_said() -> None:
    train: dict[str, Any] = {
        "load_inertia": Bounded(3e-7, 1e-7, 1e-6),
        "flexible_hz": Bounded(4100.0, 1125.0, 14_000.0),
        "flexible_damping_ratio": Bounded(0.03, 0.005, 0.1),
        "transmission_stiffness": Bounded(200.0, 50.0, 800.0),
    }
    decision = one(Request(5.0, 0.04, "both"), situation(**train))
    said = assumed(situation(**train).belief, decision)
    assert "a gear train of 50 to 800 N·m/rad with a load of at most 1e-06 kg·m² is assumed" in said
    assert "a rigid servo without a link is assumed" in assumed(situation().belief, decision)


def test_a_shorter_delay_than_the_longest_may_be_the_less_safe_one() -> None:
    """Past a quarter turn of the vibration's phase more delay raises the ceiling."""
    link = {"load_inertia": 0.005, "flexible_hz": 94.0, "flexible_damping_ratio": 0.006}
    request = Request(1e6, 5.0, "both")
    doubted = situation(**link, delay=Bounded(1e-3, 0.0, 2e-3))
    decision = one(request, doubted, delay=1e-3, inserted=1e-3)
    servo = linked(0.005, 94.0, 0.006)
    ceilings = chain_ceiling(*two_masses(*servo), 1e-3, np.array([1e-3, 3e-3]))
    assert ceilings[0] < 0.5 * ceilings[1]
    assert decision.damping_ceiling < ceilings[0]
    # and so may be an age below the one that is counted
    late = situation(**link, delay=1e-3)
    by_age = one(request, late, delay=2e-3)
    inserted = one(request, late, delay=2e-3, inserted=2e-3)
    assert by_age.damping_ceiling < ceilings[0]
    assert inserted.damping_ceiling > ceilings[0]


def test_a_falling_law_has_the_limit_of_a_spring_and_is_named() -> None:
    spring = one(Request(1e6, 0.01, "both"))
    law = one(Request(1e6, 0.01, "both", law="detents, its crest", linear=False))
    assert law.stiffness == spring.stiffness
    assert "(detents, its crest): 0.8 of the limit" in law.reasons[0]
    assert "detents" not in spring.reasons[0]


def test_a_law_of_more_than_one_slope_is_passive_by_a_bound_of_its_own() -> None:
    # 2 ms of delay in all, and a period of 1 ms
    request = Request(1e6, 0.001, "both", law="detents", linear=False)
    law = one(request, mode="passive")
    assert law.binding == "passive"
    assert law.limits["passive"] == pytest.approx((0.011692 - 0.001) / 3e-3)
    spring = one(Request(1e6, 0.001, "both"), mode="passive")
    assert law.stiffness < spring.stiffness


def test_a_law_that_the_encoder_does_not_resolve_further_is_bound_there() -> None:
    request = Request(1e6, 0.01, "both", law="friction", linear=False, resolved=0.5)
    law = one(request)
    assert law.binding == "resolution"
    assert law.stiffness == pytest.approx(0.4)
    assert "slips before the encoder" in law.reasons[0]


def test_a_notch_at_the_vibration_allows_many_times_the_damping() -> None:
    jittery = situation(load_inertia=0.003, flexible_hz=46.0, flexible_damping_ratio=0.02)
    where = replace(jittery, served=(1.0, 1.0))
    notch = VelocityFilter("notch", math.tau * 46.0e-3, 0.7)
    plain = one(Request(1e6, 5.0, "both"), where, inserted=1.5e-3)
    wall = one(Request(1e6, 0.3, "both", velocity_filter=notch), where, inserted=1.5e-3)
    servo = linked(0.003, 46.0, 0.02)
    ceiling = chain_ceiling(*two_masses(*servo), 1e-3, 2e-3, velocity_filter=notch)
    limit = chain_boundary(*two_masses(*servo), 0.3, 1e-3, 2e-3, velocity_filter=notch).stiffness
    assert wall.damping == 0.3 > 2.0 * plain.damping
    assert 0.8 * ceiling < wall.damping_ceiling < ceiling
    assert wall.limits["flexible"] is not None
    assert 0.85 * limit < wall.limits["flexible"] < limit
    assert wall.stiffness > 1.4 * plain.stiffness
    jittered = one(Request(1e6, 0.3, "both", velocity_filter=notch), jittery, inserted=1.5e-3)
    slower = chain_ceiling(*two_masses(*servo), 1.05e-3, 2e-3, velocity_filter=notch)
    assert 0.8 * slower < jittered.damping_ceiling < slower < ceiling


@pytest.mark.parametrize("kind", ["lowpass", "notch"])
def test_a_rigid_servos_limits_count_the_filter(kind: FilterKind) -> None:
    """With fractions of a period and an interval of two periods."""
    slow = VelocityFilter(kind, 0.2, 0.7)
    none = np.empty((1, 0))
    chain = Chain(np.array([[0.011951]]), np.array([[0.011692]]), none, none)
    for period, delay in ((1e-3, 0.2e-3), (1e-3, 3.7e-3), (2e-3, 1e-3)):
        where = replace(situation(), period=period)
        for asked in (0.0, 0.05, 1e3):
            wall = one(Request(1e6, asked, "both", velocity_filter=slow), where, delay=delay)
            loop = (period, delay + 0.5e-3, 1, slow)
            ceiling = float(chain_ceiling(chain, (1,), *loop)[0])
            limit = float(chain_boundary(chain, (1,), wall.damping, *loop).stiffness[0])
            assert wall.damping_ceiling == pytest.approx(ceiling, rel=1e-9)
            assert wall.limits["exact"] == pytest.approx(limit, rel=1e-9)
            assert wall.limits["flexible"] is None


def test_a_low_pass_leaves_more_damping_to_the_encoder() -> None:
    request = Request(1e6, 0.3, "both")
    smooth = replace(request, velocity_filter=VelocityFilter("lowpass", 0.3, 0.7))
    rough, filtered = (one(each, situation(COUNT)).limits for each in (request, smooth))
    assert rough["quantisation"] is not None
    assert filtered["quantisation"] is not None
    assert filtered["quantisation"] > 3.0 * rough["quantisation"]
