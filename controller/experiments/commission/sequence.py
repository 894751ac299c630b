"""Executes the steps of a commissioning in order; stores each result, and skips stored ones."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.experiments.commission.outcome import (
    STEPS,
    TITLES,
    Step,
    StepOutcome,
    done,
    partly_done,
)
from haptic_wall.controller.experiments.commission.plan import has_doctor
from haptic_wall.controller.experiments.commission.steps import (
    CONFIG,
    RUN,
    SWEEP,
    StepContext,
    identified,
)
from haptic_wall.controller.experiments.kept import Kept, fingerprint, refuse_foreign
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
)
from haptic_wall.controller.processes.run_report import exit_status
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.signals import interrupting
from haptic_wall.hw.errors import ServoError

JSON, PAGE, ALLOWED, ROWS = "commission.json", "report.html", "allowed.png", "commission.rows"
"""In the folder: report, page, the verdict's picture, the outcomes that are kept"""
HARDWARE, WRONG = 4, 1
_NEEDS_MODEL: frozenset[Step] = frozenset({"rendered", "sweep"})
"""Steps that compare with the identified servo, and are planned with it"""


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
        return (partly_done if step == "sweep" else done)(self.outcomes, step)


def kept_steps(bench: StepContext) -> Kept[Step, StepOutcome]:
    """Return the outcomes of an earlier call.

    Raises:
        UserError: The folder is of other settings, or has files that no commissioning wrote.
    """
    refuse_foreign(bench.folder, ROWS, _written())
    return Kept(
        bench.folder / ROWS,
        {"config": bench.config.model_dump(mode="json"), "reach": bench.reach},
        lambda line: (line["step"], StepOutcome(**line)),
        lambda _step, outcome: json.loads(bench.encode(asdict(outcome))),
        fresh=bench.fresh,
    )


def is_complete(outcomes: Mapping[Step, StepOutcome]) -> bool:
    """Whether no measurement is left."""
    return all(
        step in outcomes and (outcomes[step].state == "done" or step == "doctor") for step in STEPS
    )


def run_steps(bench: StepContext) -> Ended:
    """Execute every step that is not done yet.

    Args:
        bench: The servo and the folder; steps that are done there are kept.

    Raises:
        OSError: Results could not be written.
        UserError: The folder is of other settings, or was changed.
    """
    bench.folder.mkdir(parents=True, exist_ok=True)
    kept = kept_steps(bench)
    earlier = dict(kept.done)
    complete = is_complete(earlier)
    outcomes: dict[Step, StepOutcome] = {}
    config = bench.config
    interrupted = False
    for step in STEPS:
        basis = fingerprint({"config": config.model_dump(mode="json")})
        before = earlier.get(step)
        # The testbed is examined again before new motions.
        usable = complete or (step != "doctor" and before and before.state == "done")
        if usable and before and before.basis == basis:
            bench.tell(f"{step}: kept from an earlier call")
            outcomes[step] = before
        elif not interrupted:
            why_not = _obstacle(step, outcomes, config)
            try:
                with interrupting():
                    outcome, shown = (
                        (StepOutcome(step, "skipped", basis, why_not), ())
                        if why_not is not None
                        else _taken(step, replace(bench, config=config, partly={}), basis)
                    )
                    outcomes[step] = kept.add(step, outcome)
                    if outcome.reason is not None:
                        bench.tell(f"{step}: {outcome.state}: {outcome.reason}")
                    bench.picture(step).unlink(missing_ok=True)
                    if shown and step in bench.plots:
                        _draw(step, shown, bench)
            except (KeyboardInterrupt, ExperimentInterruptedError):
                bench.tell(f"{step}: interrupted")
                interrupted = True  # earlier measurements stay in the report
        if step == "identify" and (found := done(outcomes, step)) is not None:
            config = identified(found["config_text"], bench.config)
            path = bench.folder / CONFIG
            if outcomes[step] is not before or not path.exists():
                with whole(path) as part:
                    part.write_text(found["config_text"], encoding="utf-8")
    return Ended(outcomes, config, interrupted)


def _written() -> list[str]:
    """Return the names of what is written into the folder, beside what is kept."""
    return [CONFIG, PAGE, ALLOWED, JSON, SWEEP, *(f"{step}.png" for step in STEPS)]


def _obstacle(step: Step, outcomes: Mapping[Step, StepOutcome], config: Config) -> str | None:
    """Return the reason why a step cannot be executed; None if it can."""
    for earlier in outcomes.values():
        if earlier.ends_all:
            return f"{earlier.step} ended the commissioning"
    if step == "doctor" and not has_doctor(config):
        return (
            "the servo is simulated, there is no bus to examine"
            if config.servo.kind == "simulated"
            else "its bus is on the simulated clock, there is none in real time to examine"
        )
    if step in _NEEDS_MODEL and done(outcomes, "identify") is None:
        return "it needs the result of identify, for its plan and for comparison"
    return None


def _taken(step: Step, bench: StepContext, basis: str) -> tuple[StepOutcome, tuple[Any, ...]]:
    """Execute a step; return its outcome, errors included, and the data of its plot.

    Raises:
        KeyboardInterrupt: A person has ended it, as ``ExperimentInterruptedError``.
    """
    bench.tell(f"{step}: {TITLES[step]} ...")
    began = time.monotonic()

    def failed(error: Exception | str, status: int, ends_all: bool = False) -> StepOutcome:
        seconds = time.monotonic() - began
        partly = dict(bench.partly)
        return StepOutcome(step, "failed", basis, str(error), status, ends_all, seconds, partly)

    try:
        data, shown = RUN[step](bench)
    except ExperimentTrippedError as error:
        text = f"{error.stop_reason}: {error}"
        return failed(text, exit_status(error.stop_reason), error.gone), ()
    except ServoError as error:
        return failed(error, HARDWARE, ends_all=True), ()
    except HapticWallError as error:
        return failed(error, error.exit_status), ()
    seconds = time.monotonic() - began
    if step == "doctor" and data["fatal"]:
        status = HARDWARE if not data["reached"] else WRONG
        outcome = failed(_fatal_text(data), status, ends_all=True)
        return replace(outcome, data=data), ()
    return StepOutcome(step, "done", basis, seconds=seconds, data=data), shown


def _draw(step: Step, shown: tuple[Any, ...], bench: StepContext) -> None:
    """Draw the picture of a step, if possible."""
    try:
        with whole(bench.picture(step)) as part:
            bench.plots[step](*shown, bench.name, part)
    except Exception as error:  # noqa: BLE001 - whatever may be wrong with what draws
        bench.tell(f"{step}: its picture could not be drawn ({error}); its data are kept")


def _fatal_text(data: Mapping[str, Any]) -> str:
    said = [
        f"{check['name']}: found {check['found']}, wanted {check['wanted']}"
        + (f"; {check['fix']}" if check["fix"] else "")
        for check in data["checks"]
        if check["name"] in data["fatal"]
    ]
    mend = any(c["fixable"] for c in data["checks"] if c["name"] in data["fatal"])
    return "; ".join(said) + ("; `haptic-wall doctor CONFIG --fix` remedies it" if mend else "")
