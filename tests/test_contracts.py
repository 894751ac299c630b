"""Parts of the program know only those they may: by imports, and by loaded modules."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

from tests.support.program import python

ROOT = Path(__file__).parents[1]
SIMULATED = ("haptic_wall.hw.plant", "haptic_wall.hw.simulated", "haptic_wall.hw.emulated")


def loaded_by(statement: str) -> set[str]:
    """The modules in a fresh interpreter after ``statement``."""
    program = f"{statement}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    return set(json.loads(python("-c", program, cwd=ROOT).stdout))


def within(modules: set[str], *packages: str) -> list[str]:
    return sorted(
        module
        for module in modules
        if any(module == package or module.startswith(f"{package}.") for package in packages)
    )


def test_the_configured_import_contracts_hold(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    # The linter sets logging up anew, which would silence the loggers that later tests listen to.
    monkeypatch.setattr("logging.config.dictConfig", lambda _: None)
    status = lint_imports(no_cache=True)
    assert status == 0, capfd.readouterr().out


def test_opening_loads_only_what_is_opened() -> None:
    none = loaded_by("import haptic_wall.hw.open")
    assert within(none, *SIMULATED, "haptic_wall.hw.dynamixel", "serial") == []
    real = loaded_by(
        "import contextlib\n"
        "from haptic_wall.hw.clock import MonotonicClock\n"
        "from haptic_wall.hw.errors import PortError\n"
        "from haptic_wall.hw.open import open_bus\n"
        "from haptic_wall.hw.settings import ServoSettings\n"
        "with contextlib.suppress(PortError):\n"
        "    settings = ServoSettings('/dev/none', 57600, 1, 'XM430-W350', backend='dynamixel')\n"
        "    open_bus([settings], MonotonicClock())"
    )
    assert "haptic_wall.hw.dynamixel.group" in real
    assert within(real, *SIMULATED) == []
    simulated = loaded_by(
        "from haptic_wall.hw.clock import SimulatedClock\n"
        "from haptic_wall.hw.open import open_bus\n"
        "from haptic_wall.hw.settings import ServoSettings, TrueServo\n"
        "open_bus([ServoSettings(true=TrueServo(0.01))], SimulatedClock())"
    )
    assert "haptic_wall.hw.simulated" in simulated
    assert within(simulated, "haptic_wall.hw.dynamixel", "serial", "dynamixel_sdk") == []


def test_only_tests_of_the_scripts_import_scripts() -> None:
    found = [
        str(path.relative_to(ROOT))
        for path in (ROOT / "tests").rglob("*.py")
        if re.search(r"^\s*(from|import) (scripts|tests\.scripts)\b", path.read_text(), re.M)
    ]
    assert [path for path in found if not path.startswith("tests/scripts/")] == []
