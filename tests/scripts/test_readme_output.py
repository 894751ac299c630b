"""What the pages show as output is what the program says."""

import pytest

from scripts import readme_output
from tests.docs.test_commands import folder  # noqa: F401 - a fixture


@pytest.mark.parametrize(
    "name", ["commands", "exit_statuses", "limits", "report_keys", "settings", "trips"]
)
def test_the_reference_is_the_program_s(name: str) -> None:
    made = readme_output.table(*readme_output.TABLES[name]())
    found = [page for page in readme_output.pages() if f": {name} -->\n{made}<" in page.read_text()]
    assert found, "run scripts/study readme_output"


@pytest.mark.whole
@pytest.mark.usefixtures("folder")
def test_what_is_shown_is_what_the_program_says() -> None:
    stale = [
        page.name
        for page in readme_output.pages()
        if readme_output.renewed(page, False) != page.read_text()
    ]
    assert not stale, "run scripts/study readme_output"
