"""Which effects of a servo stay in its fit, by their sizes and standard errors."""

import numpy as np
import pytest

from haptic_wall.controller.experiments.identify import servo_fit
from haptic_wall.controller.experiments.identify.fit import NAMES, VALUES, Fit
from haptic_wall.controller.experiments.identify.motion import Motion, pieces_of


def fit_with(**found: tuple[float, float]) -> Fit:
    """A fit with values and standard errors by name; inertia, friction and delay are fitted too."""
    usual = {"inertia": (0.01, 1e-5), "damping": (0.01, 1e-3), "coulomb": (0.1, 1e-3)}
    given = {**usual, "delay": (1e-3, 1e-5), **found}
    values = dict.fromkeys(VALUES, 0.0) | {name: value for name, (value, _) in given.items()}
    none = np.zeros(1)
    pieces = pieces_of(Motion(none, none, none, none), [(0, 1)])
    names = (*NAMES[:4], *(name for name in found if name not in NAMES))
    fit = Fit(values, names, pieces, np.zeros((1, 1)))
    fit.__dict__["covariance"] = np.diag([given[name][1] ** 2 for name in names])
    return fit


def test_friction_by_the_gears_load_stays_where_it_is_half_known() -> None:
    found = fit_with(gear=(0.02, 0.01), dead_band=(0.02, 0.01))
    assert servo_fit._needed(found, 3.0) == ("gear",)
    assert servo_fit._needed(fit_with(gear=(0.02, 0.014)), 3.0) == ()


@pytest.mark.parametrize(("damping", "fades"), [(-0.01, True), (0.01, False)])
def test_friction_that_fades_stays_where_else_viscous_friction_is_negative(
    damping: float, fades: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    without = fit_with(damping=(damping, 1e-3), drag=(1e-3, 1e-4))
    monkeypatch.setattr(servo_fit, "fitted", lambda *_, **__: without)
    fit = fit_with(excess=(0.02, 0.01), fading=(1.8, 0.5), drag=(1e-3, 1e-4))
    kept = servo_fit._without_doubtful_fading(fit, None)
    assert ("excess" in kept.names) == fades
