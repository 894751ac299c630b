"""The delay ring delays by whole periods, skipped ones included."""

from hypothesis import given
from hypothesis import strategies as st

from haptic_wall.controller.laws.delay import DelayRing

values = st.lists(st.floats(-10, 10), min_size=1, max_size=50)


@given(values, st.integers(0, 20))
def test_out_comes_what_went_in_n_periods_before(inputs: list[float], steps: int) -> None:
    ring = DelayRing(steps)
    out = [ring.push(value) for value in inputs]
    assert out == ([0.0] * steps + inputs)[: len(inputs)]


@given(st.lists(st.tuples(st.floats(-10, 10), st.integers(1, 9)), min_size=1), st.integers(0, 6))
def test_skipped_periods_shift_it_as_if_the_value_before_had_been_pushed(
    pushes: list[tuple[float, int]], steps: int
) -> None:
    ring, plain = DelayRing(steps), DelayRing(steps)
    held = 0.0
    for value, periods in pushes:
        for _ in range(periods - 1):
            plain.push(held)
        assert ring.push(value, periods) == plain.push(value)
        held = value
