"""``haptic-wall boundary`` over what is not known: quick, or refused in a sentence."""

from typing import Any

import pytest

from haptic_wall.controller.cli.main import main
from haptic_wall.controller.theory import guaranteed
from haptic_wall.controller.theory.guaranteed import cost_of_each_unknown
from haptic_wall.controller.theory.ranges import Member, Ranges

LOOP = ("--rate=1000", "--delay=0.002", "--virtual-damping=0.005")


@pytest.mark.parametrize(
    "words",
    [
        ("--inertia=1e-9:1e9", "--damping=0.01"),
        ("--inertia=0.01", "--damping=1e-9:1e9"),
        ("--servo=MX-64", "--torque-gain=1e-9:1e9"),
    ],
)
def test_a_range_of_many_decades_is_refused(
    words: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["boundary", *LOOP, *words]) == 2
    told = capsys.readouterr().err
    assert "1e-09:1e+09" in told and "wanted at most 10000 times" in told


def test_a_damping_from_nothing_on_is_no_range_of_many_decades(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["boundary", *LOOP, "--inertia=0.01", "--damping=0:0.01"]) == 0
    assert capsys.readouterr().err == ""


def test_what_is_known_already_is_not_proved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    proofs = []
    prove = guaranteed.guaranteed_limit

    def noted(*given: Any) -> guaranteed.GuaranteedLimit:
        proofs.append(given)
        return prove(*given)

    monkeypatch.setattr(guaranteed, "guaranteed_limit", noted)
    ranges = Ranges((0.008, 0.016), (0.0117, 0.0117), (2e-3, 2e-3), (1.0, 1.0))
    costs = cost_of_each_unknown(ranges, Member(0.012, 0.0117, 2e-3), 0.01, 1e-3)
    assert len(proofs) == 2, "with the range of inertia, and without"
    assert [each.lost > 0.0 for each in costs.unknowns] == [True, False, False, False]
    assert {each.limit for each in costs.unknowns[1:]} == {costs.limit}
