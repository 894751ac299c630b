"""Assembles the report of the requested sections: figures, machine and versions."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from haptic_wall.controller.bench.machine import machine, versions
from haptic_wall.controller.bench.rows import Section
from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.system.signals import interrupting
from haptic_wall.hw.errors import ServoError


def measured(modules: Mapping[str, str], tell: Callable[[str], None]) -> dict[str, Any]:
    """Measure section by section; a Ctrl-C ends it with the finished sections.

    All modules are imported first, while a Ctrl-C still ends the process: later it is an exception
    that a library may swallow.

    Args:
        modules: The module of each section, which has ``measure() -> Section``.
        tell: Called with each section's name before it begins.

    Returns:
        ``machine``, ``versions``, ``seconds``, ``interrupted`` and ``sections``, each with its
        rows, notes and ``seconds``.
    """
    began = time.monotonic()
    report: dict[str, Any] = {
        "machine": machine(),
        "versions": versions(),
        "interrupted": False,
        "sections": {},
    }
    for module in modules.values():
        with suppress(Exception):  # its section reports the error
            importlib.import_module(module)
    try:
        for name, module in modules.items():
            tell(name)
            report["sections"][name] = measured_section(module)
    except KeyboardInterrupt:
        report["interrupted"] = True
    report["seconds"] = time.monotonic() - began
    return report


def measured_section(module: str) -> dict[str, Any]:
    """Measure one section; return its part of the report.

    Args:
        module: A module with ``measure() -> Section``.
    """
    began = time.monotonic()
    section: Section
    try:
        with interrupting():
            section = importlib.import_module(module).measure()
    except (HapticWallError, ServoError) as error:  # the other sections go on
        section = Section((), (f"not measured: {error}",))
    except Exception as error:  # noqa: BLE001 - nor is a peer that has changed
        section = Section((), (f"not measured: {type(error).__name__}: {error}",))
    return {
        "rows": [asdict(row) for row in section.rows],
        "notes": list(section.notes),
        "seconds": time.monotonic() - began,
    }
