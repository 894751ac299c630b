"""Confidence bounds of rates, by their number of trials."""

from __future__ import annotations

CONFIDENCE = 0.95
"""Confidence level of every bound; bounds are one-sided."""


def upper_bound(hits: int, trials: int) -> float:
    """Return the largest probability compatible with ``hits`` of ``trials`` [1].

    Source: C. J. Clopper, E. S. Pearson, Biometrika 26(4), 1934.

    Raises:
        ValueError: There are more hits than trials, or fewer than 0.
    """
    _check(hits, trials)
    if hits == trials:
        return 1.0
    from scipy.stats import beta  # not at the top: it takes most of a second

    return float(beta.ppf(CONFIDENCE, hits + 1, trials - hits))


def lower_bound(hits: int, trials: int) -> float:
    """Return the smallest compatible probability [1]."""
    _check(hits, trials)
    return 1.0 - upper_bound(trials - hits, trials)


def most_per_hour(events: int, hours: float) -> float:
    """Return the largest rate compatible with so many independent events [1/h].

    Raises:
        ValueError: The time is not above 0, or there are fewer events than 0.
    """
    if events < 0 or not hours > 0.0:
        raise ValueError(f"{events} events in {hours} h; give 0 or more, and a time above 0")
    from scipy.stats import chi2

    return float(chi2.ppf(CONFIDENCE, 2 * (events + 1))) / 2.0 / hours


def hourly(events: int, hours: float) -> str:
    """Return the rate of events [1/h] for a table, and its largest compatible one behind."""
    most = most_per_hour(events, hours)
    return f"{events / hours:.2g} (<{f'{most:.2g}' if most < 10.0 else round(most)})"


def _check(hits: int, trials: int) -> None:
    if not 0 <= hits <= trials:
        raise ValueError(f"{hits} hits in {trials} trials; give 0 or more, and no more than trials")
