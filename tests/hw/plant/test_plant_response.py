"""The motion in every regime, against a Taylor series summed in 200 digits."""

from decimal import Decimal, localcontext

import pytest

from haptic_wall.hw.plant.motion import response, time_to_rest

# Damping ratios around every place where a closed form would change.
RATIOS = [0.0, 1e-6, 0.3, 0.9, 1 - 1e-9, 1.0, 1 + 1e-9, 1.1, 1.1546, 1.1548, 2.0, 50.0]
RADIANS = [1e-3, 0.1, 0.499, 0.501, 0.999, 1.001, 3.0, 20.0]


def exact(decay_1_s: float, spring_1_s2: float, time_s: float) -> tuple[float, ...]:
    """h', h and its two integrals, term by term."""
    with localcontext() as context:
        context.prec = 200
        decay, spring, t = Decimal(decay_1_s), Decimal(spring_1_s2), Decimal(time_s)
        before, term = Decimal(0), Decimal(1)  # n! times the coefficients of h at n = 0, 1
        power = Decimal(1)  # t^n / n! for the present n
        h1, h, s, r = Decimal(1), t, t * t / 2, t**3 / 6
        for n in range(2, 4000):
            power = power * t / (n - 1)
            before, term = term, -(decay * term + spring * before)
            part = term * power
            h1 += part
            h += part * t / n
            s += part * t * t / (n * (n + 1))
            r += part * t**3 / (n * (n + 1) * (n + 2))
            if abs(part) < Decimal("1e-60") and n > 10 and term != 0:
                break
        return float(h1), float(h), float(s), float(r)


# The series needs about e times as many terms as the fast rate has time constants.
CASES = [(ratio, radians) for ratio in RATIOS for radians in RADIANS if ratio * radians < 200]


@pytest.mark.parametrize(("ratio", "radians"), CASES)
def test_the_response_is_exact_to_rounding(ratio: float, radians: float) -> None:
    frequency = 40.0
    decay, spring, time = 2 * ratio * frequency, frequency**2, radians / frequency
    h1, h, s, r = exact(decay, spring, time)
    found = response(decay, spring, time)
    # Natural sizes: an oscillation passes zero, where no relative precision can be asked for.
    assert found[0] == pytest.approx(h1, abs=2e-14)
    assert found[1] == pytest.approx(h, rel=1e-13, abs=1e-15 * time)
    assert found[2] == pytest.approx(s, rel=1e-12)
    assert found[3] == pytest.approx(r, rel=1e-12)


def test_a_body_all_but_at_rest_comes_to_rest() -> None:
    # Products of such small numbers underflow to zero, which must not read as "never".
    for spring in (0.0, 100.0):
        for velocity in (5e-324, 1e-200, 1e-20):
            rest = time_to_rest(velocity, -0.25, 0.0, 0.0, spring, 1.0)
            assert rest == pytest.approx(velocity / 0.25, rel=1e-9, abs=1e-323)
