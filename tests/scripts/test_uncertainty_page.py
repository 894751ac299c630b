"""The tables of docs/uncertainty.md are what the program computes."""

import pytest

from scripts.studies.uncertainty import STUDY
from tests.scripts.computed import stale


@pytest.mark.whole
def test_the_tables_are_what_is_computed(thorough: bool) -> None:
    assert stale(STUDY, None if thorough else ["costs"]) == [], "run scripts/study uncertainty"
