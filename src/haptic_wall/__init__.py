"""A virtual wall for a servo testbed, at a fixed rate.

``haptic_wall.controller`` decides the torque; ``haptic_wall.hw`` moves the servo. The two
folders stand at the top of the repository; links beside this file lead to them.

The names of ``__all__`` are for other people's programs: docs/how-to/api.md says what is held.
Each is imported when it is first used, so that ``import haptic_wall`` takes no time.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from haptic_wall.controller import theory
    from haptic_wall.controller.cli.started import RunError, RunningWall, axes, run
    from haptic_wall.controller.emulated_bus.bus import BusError
    from haptic_wall.controller.emulated_bus.bus import DynamixelBus as emulated_bus  # noqa: N813
    from haptic_wall.controller.errors import (
        ConfigError,
        HapticWallError,
        LogFormatError,
        PlatformError,
        UserError,
    )
    from haptic_wall.controller.laws.own import OwnLaw as Law
    from haptic_wall.controller.live.ask import NotAppliedError
    from haptic_wall.controller.logs.table import Log, read_log
    from haptic_wall.hw.errors import ServoError

__version__ = "0.1.0"
__all__ = [
    "BusError",
    "ConfigError",
    "HapticWallError",
    "Law",
    "Log",
    "LogFormatError",
    "NotAppliedError",
    "PlatformError",
    "RunError",
    "RunningWall",
    "ServoError",
    "UserError",
    "axes",
    "emulated_bus",
    "read_log",
    "run",
    "theory",
]

_HOMES = {
    "BusError": "controller.emulated_bus.bus",
    "ConfigError": "controller.errors",
    "HapticWallError": "controller.errors",
    "Law": "controller.laws.own:OwnLaw",
    "Log": "controller.logs.table",
    "LogFormatError": "controller.errors",
    "NotAppliedError": "controller.live.ask",
    "PlatformError": "controller.errors",
    "RunError": "controller.cli.started",
    "RunningWall": "controller.cli.started",
    "ServoError": "hw.errors",
    "UserError": "controller.errors",
    "axes": "controller.cli.started",
    "emulated_bus": "controller.emulated_bus.bus:DynamixelBus",
    "read_log": "controller.logs.table",
    "run": "controller.cli.started",
}
"""The module of each name, with its name there where that differs"""


if not TYPE_CHECKING:  # a type checker takes the imports above, and finds unknown names

    def __getattr__(name: str) -> object:
        """Import a public name when it is first used."""
        from importlib import import_module

        if name == "theory":
            found: object = import_module(f"{__name__}.controller.theory")
        elif name in _HOMES:
            module, _, inner = _HOMES[name].partition(":")
            found = getattr(import_module(f"{__name__}.{module}"), inner or name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    """Return the public names, imported or not."""
    return sorted({*globals(), *__all__})
