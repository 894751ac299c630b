"""Executes the steps of an acceptance on one servo: a commissioning's, then rest and load."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.experiments.acceptance.load import measure_load
from haptic_wall.controller.experiments.acceptance.logged import from_logs, measure_rest
from haptic_wall.controller.experiments.acceptance.predictions import Weight, points
from haptic_wall.controller.experiments.commission.outcome import (
    STEPS,
    Step,
    StepOutcome,
    done,
    partly_done,
)
from haptic_wall.controller.experiments.commission.sequence import run_steps
from haptic_wall.controller.experiments.commission.steps import Plot, StepContext
from haptic_wall.controller.experiments.commission.store import (
    CommissionStore,
    Encode,
    settings_of,
)
from haptic_wall.controller.experiments.kept_folder import replaced
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
)
from haptic_wall.controller.processes.run_report import exit_status
from haptic_wall.controller.settings.config import Config
from haptic_wall.hw.errors import ServoError

Tell = Callable[[str], None]
_HARDWARE = 4


@dataclass(frozen=True, slots=True)
class Bench:
    """The servo, its folder, and the person beside it."""

    config: Config
    predicted_for: Config
    """The configuration whose points are measured"""
    name: str
    folder: Path
    weight: Weight | None
    reach: float
    """Largest excursion during the identification [rad]"""
    encode: Encode
    fresh: bool
    tell: Tell
    before: Callable[[str], None] = lambda _step: None
    """Called before each step that is taken"""
    ready: Callable[[str], None] = lambda _text: None
    """Called with what a person has to do"""
    plots: Mapping[Step, Plot] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Measured:
    """What was measured on one servo."""

    outcomes: Mapping[Step, StepOutcome]
    extra: Mapping[str, Mapping[str, Any]]
    """``rest`` and ``load``: ``data``, or ``reason`` where there are none"""
    logged: Mapping[str, Any]
    interrupted: bool
    exit_status: int

    def data(self, step: str) -> Mapping[str, Any] | None:
        """Return a step's result, of a sweep also as far as it came; None: there is none."""
        if step in self.extra:
            return self.extra[step].get("data")
        found: Any = step
        return (partly_done if step == "sweep" else done)(self.outcomes, found)

    def reason(self, step: str) -> str | None:
        """Return why a step ended early or was not taken; None: it is done, or not reached."""
        return next((each["reason"] for each in self.steps() if each["step"] == step), None)

    def steps(self) -> list[dict[str, Any]]:
        """Return each step with its state and reason."""
        found = [
            {"step": step, "state": outcome.state, "reason": outcome.reason}
            for step in STEPS
            if (outcome := self.outcomes.get(step)) is not None
        ]
        return found + [
            {
                "step": name,
                "state": "done" if "data" in each else "skipped",
                "reason": each.get("reason"),
            }
            for name, each in self.extra.items()
        ]


def measured(bench: Bench) -> Measured:
    """Take every step that is not done yet.

    Raises:
        OSError: Results could not be written.
        UserError: The folder belongs to something else, or was changed.
    """
    basis = settings_of(bench.config, bench.reach)
    store = CommissionStore(bench.folder, basis, bench.name, bench.encode, bench.fresh)
    context = StepContext(
        bench.config,
        bench.name,
        bench.reach,
        store,
        bench.tell,
        bench.plots,
        points=points(bench.predicted_for),
        before=bench.before,
    )
    ended = run_steps(context)
    interrupted, status = ended.interrupted, ended.exit_status
    gone = next((each.step for each in ended.outcomes.values() if each.ends_all), None)
    extra: dict[str, dict[str, Any]] = {}
    for name in ("rest", "load"):
        if interrupted:
            break
        if gone is not None:
            extra[name] = {"reason": f"{gone} ended the acceptance"}
        elif name == "load" and bench.weight is None:
            extra[name] = {"reason": "no weight was given, by --weight KG and --lever M"}
        else:
            try:
                extra[name], failed = _extra(name, bench, ended.config, basis)
                status = status or failed
            except (KeyboardInterrupt, ExperimentInterruptedError):
                bench.tell(f"{name}: interrupted")
                interrupted, status = True, 130
    return Measured(
        ended.outcomes, extra, from_logs(ended.config, bench.folder), interrupted, status
    )


def _extra(name: str, bench: Bench, config: Config, basis: str) -> tuple[dict[str, Any], int]:
    """Return a step that a commissioning does not have, kept or taken, and its exit status."""
    path = bench.folder / f"{name}.json"
    weight = bench.weight
    held_for = {"basis": basis, "weight": [weight.mass, weight.lever] if weight else None}
    if path.is_file() and not path.is_symlink() and not bench.fresh:
        try:
            held = json.loads(path.read_text(encoding="utf-8"))
            if held["for"] == held_for:
                bench.tell(f"{name}: kept from an earlier call")
                return {"data": held["data"]}, 0
        except (ValueError, KeyError, TypeError):
            pass  # it is measured anew
    bench.before(name)
    logs = bench.folder / "logs"
    try:
        if name == "rest":
            data = measure_rest(config, logs, bench.tell)
        else:
            assert weight is not None
            data = measure_load(config, weight, logs, bench.tell, bench.ready).report()
    except ExperimentTrippedError as error:
        bench.tell(f"{name}: failed: {error}")
        return {"reason": f"{error.stop_reason}: {error}"}, exit_status(error.stop_reason)
    except ServoError as error:
        bench.tell(f"{name}: failed: {error}")
        return {"reason": str(error)}, _HARDWARE
    except HapticWallError as error:
        bench.tell(f"{name}: failed: {error}")
        return {"reason": str(error)}, error.exit_status
    with replaced(path) as stream:
        stream.write(bench.encode({"for": held_for, "data": data}) + "\n")
    return {"data": data}, 0
