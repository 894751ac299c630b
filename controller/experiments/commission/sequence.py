"""Executes the steps of a commissioning in order."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.experiments.commission import agreement
from haptic_wall.controller.experiments.commission.plan import has_doctor
from haptic_wall.controller.experiments.commission.steps import (
    CONFIG,
    RUN,
    STEPS,
    TITLES,
    State,
    Step,
    StepContext,
    StepOutcome,
)
from haptic_wall.controller.experiments.commission.verdict import GuardQuestion, verdict
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
)
from haptic_wall.controller.settings import yaml_text
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.json_text import RESULT_MARK
from haptic_wall.controller.system.signals import interrupting
from haptic_wall.hw.errors import ServoError

JSON, TEXT = "commission.json", "report.txt"
"""In the folder: the report as data and as text"""
FILES = (JSON, TEXT, CONFIG, *(f"{step}.png" for step in STEPS))
"""All files of the folder"""
COMPLETE, INCOMPLETE, NOT_MEASURED = "complete", "incomplete", "not measured"
"""Values of ``status``"""
HARDWARE, WRONG = 4, 1


@dataclass(frozen=True, slots=True)
class Ended:
    """The result of a commissioning, which may have ended early."""

    outcomes: Mapping[Step, StepOutcome]
    """Outcomes of the steps that were reached"""
    config: Config
    """With the identified model, where there is one"""
    interrupted: bool

    @property
    def exit_status(self) -> int:
        """Return the command's exit status: 130, or that of the first failed step."""
        if self.interrupted:
            return 130
        return next((o.exit_status for o in self.outcomes.values() if o.exit_status), 0)

    def data(self, step: Step) -> dict[str, Any] | None:
        """Return a step's result, of a sweep also as far as it came; None: there is none."""
        outcome = self.outcomes.get(step)
        if outcome is None or (outcome.state != "done" and step != "sweep"):
            return None
        return outcome.data or None

    def steps(self) -> list[dict[str, Any]]:
        """Return name, title, state, reason and duration of each step, for a report."""
        unknown = dict.fromkeys(("reason", "seconds"))
        return [
            {"step": step, "title": TITLES[step], "state": "not taken", **unknown}
            | {k: getattr(o, k) for o in [self.outcomes.get(step)] if o for k in _TOLD}
            for step in STEPS
        ]


_TOLD = ("state", "reason", "seconds")


def run_steps(bench: StepContext) -> Ended:
    """Execute every step.

    Args:
        bench: The servo and the folder.

    Raises:
        OSError: Results could not be written.
    """
    bench.folder.mkdir(parents=True, exist_ok=True)
    outcomes: dict[Step, StepOutcome] = {}
    ended = Ended(outcomes, bench.config, interrupted=False)
    for step in STEPS:
        try:
            with interrupting():
                outcomes[step], shown = _taken(step, ended, bench)
                if outcomes[step].state == "interrupted":
                    bench.tell(f"{step}: interrupted")
                    return replace(ended, interrupted=True)  # what was measured is reported
                if outcomes[step].reason is not None:
                    bench.tell(f"{step}: {outcomes[step].state}: {outcomes[step].reason}")
                bench.picture(step).unlink(missing_ok=True)
                if shown and step in bench.plots:
                    _draw(step, shown, bench)
        except KeyboardInterrupt:
            return replace(ended, interrupted=True)
        if step == "identify" and (found := ended.data(step)) is not None:
            text = found["config_text"]
            ended = replace(ended, config=Config.model_validate(yaml_text.parse(text, CONFIG)))
            with whole(bench.folder / CONFIG) as part:
                part.write_text(text, encoding="utf-8")
    return ended


def _obstacle(step: Step, ended: Ended) -> str | None:
    """Return the reason why a step cannot be executed; None if it can."""
    for earlier in ended.outcomes.values():
        if earlier.ends_all:
            return f"{earlier.step} ended the commissioning"
    if step == "doctor" and not has_doctor(ended.config):
        return (
            "the servo is simulated, there is no bus to examine"
            if ended.config.servo.kind == "simulated"
            else "its bus is on the simulated clock, there is none in real time to examine"
        )
    if step == "sweep" and ended.data("identify") is None:
        return "it needs the result of identify, for its plan and for comparison"
    return None


def _taken(step: Step, ended: Ended, bench: StepContext) -> tuple[StepOutcome, tuple[Any, ...]]:
    """Execute a step; return its outcome, errors included, and the data of its plot."""
    if (why_not := _obstacle(step, ended)) is not None:
        return StepOutcome(step, "skipped", why_not), ()
    bench = replace(bench, config=ended.config, partly={})
    bench.tell(f"{step}: {TITLES[step]} ...")
    began = time.monotonic()

    def failed(
        error: Exception | str, status: int, ends_all: bool = False, state: State = "failed"
    ) -> StepOutcome:
        seconds = time.monotonic() - began
        partly = dict(bench.partly)
        return StepOutcome(step, state, str(error), status, ends_all, seconds, partly)

    try:
        data, shown = RUN[step](bench)
    except ExperimentInterruptedError as error:
        return failed(error.problem.advice, 0, state="interrupted"), ()
    except KeyboardInterrupt:
        return failed("", 0, state="interrupted"), ()
    except ExperimentTrippedError as error:
        return failed(error, error.exit_status, error.gone), ()
    except ServoError as error:
        return failed(error, HARDWARE, ends_all=True), ()
    except HapticWallError as error:
        return failed(error, error.exit_status), ()
    if step == "doctor" and data["fatal"]:
        status = HARDWARE if not data["reached"] else WRONG
        return replace(failed(_fatal_text(data), status, ends_all=True), data=data), ()
    return StepOutcome(step, "done", seconds=time.monotonic() - began, data=data), shown


def _draw(step: Step, shown: tuple[Any, ...], bench: StepContext) -> None:
    """Draw the picture of a step, if possible."""
    try:
        with whole(bench.picture(step)) as part:
            bench.plots[step](*shown, bench.name, part)
    except Exception as error:  # noqa: BLE001 - whatever may be wrong with what draws
        bench.tell(f"{step}: its picture could not be drawn ({error}); its data are kept")


def check_text(check: Mapping[str, Any]) -> str:
    """Return one of the doctor's faults, and its remedy, in words."""
    fix = f"; {check['fix']}" if check["fix"] else ""
    return f"{check['name']}: found {check['found']}, wanted {check['wanted']}{fix}"


def _fatal_text(data: Mapping[str, Any]) -> str:
    fatal = [check for check in data["checks"] if check["name"] in data["fatal"]]
    said = [check_text(check) for check in fatal]
    if any(check["fixable"] for check in fatal):
        said.append("`haptic-wall doctor CONFIG --fix` remedies it")
    return "; ".join(said)


def report(ended: Ended, name: str, folder: Path) -> dict[str, Any]:
    """Return the data of a commissioning's text and JSON; a step not done is null.

    Args:
        ended: The commissioning, as far as it came.
        name: Name of the configuration, for people.
        folder: Folder with the files of the steps.
    """
    config, doctor = ended.config, ended.outcomes.get("doctor")
    identify, sweep = ended.data("identify"), ended.data("sweep")
    done = {step for step, outcome in ended.outcomes.items() if outcome.state == "done"}
    complete = {*STEPS} <= {*done, "doctor"}
    status = COMPLETE if complete else INCOMPLETE
    age = boundary = None
    if identify is not None:
        age = float(identify["sample_age_s"])
        if sweep is not None:
            boundary = agreement.boundary(config, sweep["points"], identify.get("effects"))
    return {
        **RESULT_MARK,
        "name": name,
        "servo": config.servo.kind,
        "model": config.servo.model,
        "clock": config.loop.clock,
        "rate_hz": config.loop.rate_hz,
        "interrupted": ended.interrupted,
        "status": NOT_MEASURED if identify is None else status,
        "complete": complete,
        "verdict": verdict(GuardQuestion.of(config, age), identify is not None),
        "agreement": {"boundary": boundary},
        "steps": [
            {**each, "picture": picture if (folder / picture).exists() else None}
            for each in ended.steps()
            for picture in [f"{each['step']}.png"]
        ],
        # After a fatal finding of the doctor only its checks matter.
        "doctor": (doctor.data or None) if doctor else None,
        "identify": identify and {k: v for k, v in identify.items() if k != "config_text"},
        "sweep": sweep,
        "config": str(folder / CONFIG) if identify is not None else None,
    }
