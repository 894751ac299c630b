"""Options of the whole test suite."""

import pytest


def pytest_addoption(parser):
    parser.addoption(
        "--thorough", action="store_true", help="as many random cases as the documentation claims"
    )


@pytest.fixture(scope="session")
def thorough(pytestconfig):
    """Whether the full number of random cases is wanted, however long it takes."""
    return pytestconfig.getoption("thorough")
