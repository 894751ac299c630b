"""Holds a value with its standard error, and formats both."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Estimated:
    """A value and its standard error."""

    value: float
    stderr: float

    def report(self) -> dict[str, float]:
        """Return both for JSON."""
        return {"value": self.value, "stderr": self.stderr}

    def __str__(self) -> str:
        """Format both to two digits of the error: "0.0021 ± 0.0001"."""
        if not self.stderr > 0.0:
            return f"{self.value:.4g}"
        digits = max(0, 1 - math.floor(math.log10(self.stderr)))
        return f"{self.value:.{digits}f} ± {self.stderr:.{digits}f}"

    def in_ms(self, digits: int = 3) -> str:
        """Format a time [s] in milliseconds."""
        return f"{1e3 * self.value:.{digits}f} ± {1e3 * self.stderr:.{digits}f} ms"
