"""The command as a fixture."""

import pytest

from tests.cli.caller import Cli


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Cli:
    """``haptic-wall``, called in this process."""
    return Cli(capsys)
