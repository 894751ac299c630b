"""The supervisor's side of the dead man: starts the watcher, and reports changes and its end."""

from __future__ import annotations

import json
import os
from dataclasses import asdict

from haptic_wall.controller.laws.engagement import place_text
from haptic_wall.controller.processes.children import Child
from haptic_wall.controller.processes.plan import Plan, Tell
from haptic_wall.controller.runtime.telemetry import FLAG_OFF, FLAG_WARM_UP, Telemetry, Word

_END_S = 2.0
"""Time allowed for the watcher to end [s]"""


class HoldMonitor:
    """Watches the dead man's watcher, and reports when the wall goes off or comes back.

    It does not restart a dead watcher: a run without its dead man has no torque, and a person
    should find out why.

    Attributes:
        trouble: Why the watcher ended by itself; empty: it has not.
    """

    def __init__(self, watcher: Child, telemetry: Telemetry) -> None:
        self._watcher = watcher
        self._telemetry = telemetry
        self._told = ""
        self._gone = False
        self.trouble = ""

    def look(self, tell: Tell) -> None:
        """Report when the wall goes off or comes back, and once when the watcher has ended."""
        self._tell_change(tell)
        if self._gone or not self._watcher.ended():
            return
        self._gone = True
        troubles = [json.loads(line)["trouble"] for line in self._watcher.lines()]
        why = "; ".join(troubles) or f"its process {self._watcher.exit_text()}"
        self.trouble = f"--hold: {why}; from then on the wall was off"
        tell(f"--hold: {why}; the wall is off and stays off: end the run with Ctrl-C")

    def _tell_change(self, tell: Tell) -> None:
        """Report changes of a wall that has been on; the session reports those before."""
        head = int(self._telemetry.words[Word.HEAD])
        rows, _ = self._telemetry.read(max(0, head - 1))
        if not len(rows) or rows[-1]["flags"] & FLAG_WARM_UP:
            return
        if not rows[-1]["flags"] & FLAG_OFF:
            news, text = "on", "the wall is on again" if self._told else ""
        elif self._telemetry.words[Word.HELD_NS] < rows[-1]["deadline_ns"]:
            news, text = "released", "released; the wall is off"
        else:
            where = place_text(float(rows[-1]["position"]))
            news = "waits"
            text = f"held, but the wall waits: at {where} it would push the shaft with a blow"
        if text and news != self._told:
            tell(f"--hold: {text}")
        if text or self._told:
            self._told = news

    def close(self) -> None:
        """End the watcher."""
        self._watcher.dismiss(_END_S)


def start_hold(
    plan: Plan, telemetry: Telemetry, cores: set[int], page: Child | None = None
) -> HoldMonitor | None:
    """Start the dead man's watcher; None: the plan has no dead man.

    The dead man counts as released until the watcher reports otherwise.

    Args:
        plan: Plan of the run.
        telemetry: Shared memory that the watcher writes to.
        cores: Cores on which it runs.
        page: Process of the live page, which is the watcher of a dead man that a page holds.

    Raises:
        UserError: The source cannot be opened.
    """
    hold = plan.hold
    if hold is None:
        return None
    telemetry.words[Word.HELD_NS] = 0
    if hold.kind == "page":
        assert page is not None
        return HoldMonitor(page, telemetry)
    device = hold.open()
    orders = {
        "telemetry": telemetry.descriptor,
        "parent": os.getpid(),
        "hold": asdict(hold),
        "descriptor": device,
        "real_time": plan.config.realtime.profile != "off",
    }
    descriptors = [telemetry.descriptor]
    if device is not None:
        descriptors.append(device)
    try:
        watcher = Child(
            "dead man's watcher",
            ["haptic_wall.controller.processes.hold_watcher"],
            orders,
            descriptors,
            cores,
        )
    finally:
        if device is not None:
            os.close(device)
    return HoldMonitor(watcher, telemetry)
