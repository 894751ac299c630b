"""What the pages show as output is what the program says."""

import subprocess
import sys

import pytest

from scripts import readme_output
from tests.docs.test_commands import folder  # noqa: F401 - a fixture


@pytest.mark.parametrize("name", ["commands", "limits", "settings"])
def test_the_reference_is_the_program_s(name: str) -> None:
    # in a fresh process: other tests bring laws and backends of their own
    ask = f"from scripts import readme_output as o; print(o.table(*o.TABLES[{name!r}]()), end='')"
    made = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    found = [
        page
        for page in readme_output.pages()
        if f": {name} -->\n{made.stdout}<" in page.read_text()
    ]
    assert found, "run scripts/study readme_output"


@pytest.mark.whole
@pytest.mark.usefixtures("folder")
def test_what_is_shown_is_what_the_program_says() -> None:
    stale = [
        page.name
        for page in readme_output.pages()
        # the settings have a test of their own, above
        if page.name != "settings.md" and readme_output.renewed(page, False) != page.read_text()
    ]
    assert not stale, "run scripts/study readme_output"
