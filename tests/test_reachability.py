"""Nothing is kept that nobody uses."""

import re
from pathlib import Path

import pytest

from tests.support.program import python

ROOT = Path(__file__).parents[1]


@pytest.mark.whole
def test_every_definition_is_used_by_the_program_a_page_or_a_script() -> None:
    """Fields are left out: reports are made of them by their names."""
    said = python("-m", "vulture", cwd=ROOT)
    assert said.stderr == "" and said.returncode in (0, 3)
    kinds = r"unused (class|function|method|property|import) "
    assert [line for line in said.stdout.splitlines() if re.search(kinds, line)] == []
