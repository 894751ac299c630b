"""Compiles the modules of a tick, and of a simulated servo, with mypyc, in a copy of the package.

The sources are not changed. Four modules with code of a tick are left out. mypyc refuses
``controller.laws.wall``, whose class assigns several names at once, and
``controller.runtime.loop``, where a name holds a float and later an int.
``controller.detector.tuning`` compiles, and then fails to import, because a dataclass has a field
of type ``object``; it holds numbers only. ``hw.clock`` would gain nothing: its function is one of
C.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

from haptic_wall.controller.errors import PlatformError
from scripts.whole_program import ROOT

PACKAGE = "haptic_wall"
_NOT_IN_A_TICK = {"__init__", "detection", "envelope", "servo_fit", "tuning", "wall_fit"}
"""Of the detector"""
DRIVER = (
    "hw.dynamixel.codec.frames",
    "hw.dynamixel.codec.cyclic",
    "hw.dynamixel.codec.parser",
    "hw.dynamixel.samples",
    "hw.serialport.line",
    "hw.dynamixel.station",
    "hw.dynamixel.exchange",
    "hw.dynamixel.jump_filter",
    "hw.dynamixel.torque_law",
    "hw.dynamixel.watchdog",
    "hw.dynamixel.health",
    "hw.dynamixel.driven",
    "hw.dynamixel.group",
    "hw.dynamixel.servo",
)
TICK = (
    "hw.servo",
    "controller.laws.delay",
    "controller.laws.velocity",
    "controller.laws.engagement",
    "controller.guard.schedule",
    "controller.runtime.sampler",
    "controller.runtime.gains",
    "controller.runtime.safety",
    "controller.runtime.missed",
    "controller.runtime.overspeed",
    "controller.runtime.motion_watch",
    "controller.runtime.telemetry",
    "controller.runtime.deadlines",
    "controller.runtime.cache_warm_up",
    "controller.runtime.tick",
)
DETECTOR = tuple(
    f"controller.detector.{path.stem}"
    for path in sorted((ROOT / "controller" / "detector").glob("*.py"))
    if path.stem not in _NOT_IN_A_TICK
)
MODULES = (*DRIVER, *TICK, *DETECTOR)
"""Modules with code that a tick on the emulated bus executes"""
PLANT = (
    "hw.plant.chain",
    "hw.plant.current_loop",
    "hw.plant.encoder",
    "hw.plant.mechanics",
    "hw.plant.mechanism",
    "hw.plant.motion",
    "hw.plant.step",
)
SIMULATED = (*MODULES, *PLANT)
"""These, and those that move a simulated servo"""
_CONFIG = "[mypy]\nplugins = pydantic.mypy\nignore_missing_imports = True\n"


def compiled(folder: Path, modules: tuple[str, ...] = MODULES) -> Path:
    """Compile modules in a copy of the package; return the folder that holds the package.

    Args:
        folder: An empty folder for the copy.
        modules: Names without the package's.

    Raises:
        PlatformError: There is no compiler, or it refuses the modules.
    """
    if importlib.util.find_spec("mypyc") is None or importlib.util.find_spec("setuptools") is None:
        raise PlatformError(
            "found no mypyc with setuptools beside it",
            advice=f"install both: {sys.executable} -m pip install mypy setuptools",
        )
    if not (shutil.which("cc") or shutil.which("gcc")):
        raise PlatformError("found no C compiler", advice="install one (on Debian: gcc)")
    shutil.copytree(
        ROOT / "src" / PACKAGE, folder / PACKAGE, ignore=shutil.ignore_patterns("__pycache__")
    )
    (folder / "mypy.ini").write_text(_CONFIG, encoding="utf-8")
    files = [f"{PACKAGE}/{module.replace('.', '/')}.py" for module in modules]
    environment = {**os.environ, "PYTHONPATH": str(folder), "MYPYC_DEBUG_LEVEL": "0"}
    done = subprocess.run(
        [sys.executable, "-m", "mypyc", *files],
        check=False,
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
    )
    if done.returncode:
        raise PlatformError(f"mypyc failed: {(done.stdout + done.stderr)[-2000:]}")
    return folder
