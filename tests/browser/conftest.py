"""A browser for the tests of the live page, where it was asked for and is there."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.chromium import Tab, chromium, program

MISSING = (
    "NO BROWSER: the live page was not looked at; found none of chromium, chromium-browser,"
    " google-chrome on PATH (on Debian and Ubuntu: apt-get install chromium)"
)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave these tests out where they were not asked for, or there is no browser."""
    why = ""
    if not config.getoption("browser"):
        why = "looks at the live page in a browser: run with --browser"
    elif program() is None:
        why = MISSING
    here = str(Path(__file__).parent)
    for item in items:
        if why and str(item.path).startswith(here):
            item.add_marker(pytest.mark.skip(reason=why))


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Say it where nobody overlooks it."""
    if config.getoption("browser") and program() is None:
        terminalreporter.section("the live page", sep="!", red=True)
        terminalreporter.line(MISSING)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    """A browser with one tab."""
    with chromium(tmp_path_factory.mktemp("chromium")) as tab:
        yield tab


@pytest.fixture
def tab(browser: Tab) -> Iterator[Tab]:
    """The tab, without complaints before and after."""
    browser.errors.clear()
    browser.look(1280, 860)
    yield browser
    complaints = [*browser.errors]
    browser.open("about:blank")  # or the page would complain of its server's end in the next test
    assert complaints == []
