"""Second-order filters of the velocity that the damper uses: low-pass or notch, and response.

They are bilinear transforms of ``1 / (1 + x/q + x²)`` and ``(1 + x²) / (1 + x/q + x²)``, prewarped
at their frequency w0: with ``s = (z - 1)/(z + 1)``, x is ``s / tan(w0/2)``. On the unit circle s is
``j tan(w/2)``, so that the response of the filter in the tick is exactly that of the prototype.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from haptic_wall.controller.theory.checks import ComplexArray, FloatArray

FilterKind = Literal["lowpass", "notch"]


@dataclass(frozen=True, slots=True)
class VelocityFilter:
    """A filter in units of the sampling: a longer period makes it slower in the same ratio.

    Its gain is 1 at the frequency 0, and nowhere above 1 for a notch and for a low-pass with q up
    to 0.7071.

    Raises:
        ValueError: The frequency is not between 0 and pi, or the quality is not above 0.
    """

    kind: FilterKind
    w0: float
    """Frequency of the notch, or the low-pass's corner, 0 < w0 < pi [rad/sample]"""
    q: float
    """Quality: a notch's frequency over its width; a low-pass has the gain q at its corner"""

    def __post_init__(self) -> None:
        if not 0.0 < self.w0 < math.pi:
            raise ValueError(
                f"a filter's frequency must be above 0 and below half the rate, got"
                f" {self.w0 / math.tau:g} of the rate"
            )
        if not self.q > 0.0:
            raise ValueError(f"a filter's quality must be > 0, got {self.q:g}")

    @property
    def numerator(self) -> FloatArray:
        """Return the coefficients of rising powers of s."""
        x = 1.0 / math.tan(0.5 * self.w0)
        return np.array([1.0, 0.0, x * x if self.kind == "notch" else 0.0])

    @property
    def denominator(self) -> FloatArray:
        """Return the coefficients of rising powers of s."""
        x = 1.0 / math.tan(0.5 * self.w0)
        return np.array([1.0, x / self.q, x * x])

    def taps(self) -> tuple[float, float, float, float, float]:
        """Return b0, b1, b2, a1, a2: ``y = b0 v + b1 v' + b2 v'' - a1 y' - a2 y''``."""
        (n0, n1, n2), (d0, d1, d2) = self.numerator.tolist(), self.denominator.tolist()
        lead = d0 + d1 + d2
        return (
            (n0 + n1 + n2) / lead,
            2.0 * (n0 - n2) / lead,
            (n0 - n1 + n2) / lead,
            2.0 * (d0 - d2) / lead,
            (d0 - d1 + d2) / lead,
        )

    def response(self, w: FloatArray) -> ComplexArray:
        """Return the complex gain at frequencies ``w`` [rad/sample], 0 <= w <= pi."""
        found: ComplexArray = self.above(w) / self.below(w)
        return found

    # over (1 + j t)², with t = tan(w/2), so that it holds at pi too
    def above(self, w: FloatArray) -> FloatArray:
        """Return the numerator of the gain, which is real."""
        n = self.numerator
        found: FloatArray = n[0] * np.cos(0.5 * w) ** 2 - n[2] * np.sin(0.5 * w) ** 2
        return found

    def below(self, w: FloatArray) -> ComplexArray:
        """Return the denominator of the gain."""
        sine, cosine, d = np.sin(0.5 * w), np.cos(0.5 * w), self.denominator
        found: ComplexArray = d[0] * cosine**2 - d[2] * sine**2 + 1j * d[1] * sine * cosine
        return found

    def peak(self, samples: int) -> float:
        """Return the largest output for one encoder count, over the unfiltered velocity's.

        Args:
            samples: N of the velocity difference: the count lasts for N samples.
        """
        b0, b1, b2, a1, a2 = self.taps()
        v1 = v2 = y1 = y2 = most = 0.0
        for k in range(samples + math.ceil(20.0 * max(self.q, 1.0) / self.w0)):
            v = 1.0 if k < samples else 0.0
            y = b0 * v + b1 * v1 + b2 * v2 - a1 * y1 - a2 * y2
            v1, v2, y1, y2 = v, v1, y, y1
            most = max(most, abs(y))
        return most
