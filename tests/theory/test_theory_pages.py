"""The pages on the theory show the answers that Python gives."""

from __future__ import annotations

import doctest
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs" / "concepts"


@pytest.mark.parametrize("page", ["limit-cycles.md"])
def test_the_page_shows_what_comes_out(page: str) -> None:
    found = doctest.testfile(str(DOCS / page), module_relative=False, encoding="utf-8")
    assert found.attempted >= 5
    assert found.failed == 0
