"""True parameters from texts, one by one and together."""

from typing import Any

import pytest

from haptic_wall.hw.errors import SpecError
from haptic_wall.hw.truth import ABOUT, TrueServo, read, wanted


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("damping", "1e-2", 0.01),
        ("counts_per_rev", "4e3", 4000),
        ("back_emf", "True", True),
        ("damping_back", "null", None),
        ("hand", "push", "push"),
        ("hand_direction", "-1", -1),
    ],
)
def test_a_text_is_read_in_the_parameters_type(name: str, text: str, value: object) -> None:
    found = read(name, text)
    assert (found, type(found)) == (value, type(value))


def test_what_is_no_value_is_refused() -> None:
    for name in ABOUT:
        for text in ("nan", "", "shove", "{}", "1e999", "[[1]]", 5000 * "["):
            with pytest.raises(ValueError, match=wanted(name).split(" ")[0]):
                read(name, text)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("back_emf", 1),
        ("inertia", True),
        ("inertia", "0.01"),
        ("damping", None),
        ("noise_seed", 1.5),
        ("inertia", -1.0),
        ("delay", -1e-3),
        ("torque_limit", 0.0),
        ("gravity", -0.1),
        ("encoder_eccentricity", 1.0),
        ("encoder_noise", -1.0),
        ("encoder_noise", 1.0),  # without counts
    ],
)
def test_the_record_refuses_a_wrong_type_and_an_impossible_servo(name: str, value: Any) -> None:
    with pytest.raises(SpecError, match=f"{name}: "):
        TrueServo(**{"inertia": 0.01, "counts_per_rev": 0, name: value})
