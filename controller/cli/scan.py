"""``haptic-wall scan``: lists the servos on a bus, with ids and baud rates."""

from __future__ import annotations

from typing import Any

import click

from haptic_wall.controller.cli.init import axes_lines
from haptic_wall.controller.cli.options import answer, json_option, say
from haptic_wall.controller.doctor.adapter import (
    adapters,
    kind_of_port,
    may_be_serial,
    only_adapter,
)
from haptic_wall.controller.doctor.search import IDS, LIKELY_FIRST, BaudSearch, scan
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.system.signals import interrupting
from haptic_wall.hw.clock import MonotonicClock
from haptic_wall.hw.errors import WIRING

HARDWARE = 4


@click.command()
@click.option("--port", metavar="P", help="The adapter's device; default: the only one.")
@json_option
def command(port: str | None) -> int:
    """List the servos on a bus: id, baud rate, model, firmware.

    It pings, reads from what answers, and restores the port's settings when it ends. The exit
    status is 4 if no servo answers.
    """
    if port == "":
        raise UserError(
            "found nothing", field="--port", wanted="a serial device such as /dev/ttyUSB0"
        )
    path = only_adapter(adapters()) if port is None else port
    if not may_be_serial(path):  # the search reports a missing one
        raise UserError(
            f"found {path}, which is no serial port",
            field="--port",
            wanted="the adapter's device, such as /dev/ttyUSB0",
        )

    def tell(baud: int) -> None:
        say(f"  {baud} bit/s ...")

    with interrupting():  # the port is closed
        searches = list(scan(path, LIKELY_FIRST, IDS, MonotonicClock(), tell))
    found = _report(path, searches)
    answer(found, lambda: _text(found))
    return 0 if found["servos"] else HARDWARE


def _report(path: str, searches: list[BaudSearch]) -> dict[str, Any]:
    servos = sorted(servo for one in searches for servo in one.servos)
    return {
        "port": path,
        "adapter": kind_of_port(path),
        "servos": [
            {
                "id": servo.id,
                "baud": servo.baud,
                "model": servo.model,
                "model_number": servo.model_number,
                "firmware": servo.firmware,
                "current_mode": servo.current_mode,
                "twins": servo.twins,
            }
            for servo in servos
        ],
        "bauds": [
            {"baud": one.baud, "garbled": one.garbled, "refused": one.refused or None}
            for one in sorted(searches)
        ],
    }


def _text(found: dict[str, Any]) -> str:
    lines = [f"{found['port']}: {found['adapter']}", ""]
    if found["servos"]:
        lines.append(f"{'id':>3}  {'bit/s':>8}  {'model':<14}  {'firmware':>8}")
    for servo in found["servos"]:
        model = servo["model"] or f"unknown ({servo['model_number']})"
        note = "  no current mode: no torque" if servo["current_mode"] is False else ""
        if servo["twins"]:
            note += "  two servos have this id: connect one of them, and give it another"
        lines.append(
            f"{servo['id']:>3}  {servo['baud']:>8}  {model:<14}  {servo['firmware']:>8}{note}"
        )
    usable = [one for one in found["servos"] if one["current_mode"] and not one["twins"]]
    if len(usable) > 1 and len({servo["baud"] for servo in usable}) == 1:
        axes = {
            f"axis_{one['id']}": {"servo": {k: one[k] for k in ("id", "model")}} for one in usable
        }
        lines += axes_lines(axes)
    if not found["servos"]:
        lines.append(
            f"Nothing answers: check {WIRING}; `haptic-wall doctor CONFIG` examines the bus of a"
            " configuration."
        )
    for one in found["bauds"]:
        if one["refused"]:
            lines.append(f"{one['baud']} bit/s was not tried: {one['refused']}")
        elif one["garbled"]:
            lines.append(
                f"{one['baud']} bit/s: bytes arrived that are no reply: two servos with one id, or "
                "noise"
            )
    return "\n".join(lines)
