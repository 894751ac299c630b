"""Executes the steps of a commissioning in order; stores each result, and skips stored ones."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from haptic_wall.controller.errors import HapticWallError
from haptic_wall.controller.experiments.commission.outcome import (
    STEPS,
    TITLES,
    Step,
    StepOutcome,
    done,
)
from haptic_wall.controller.experiments.commission.plan import has_doctor
from haptic_wall.controller.experiments.commission.steps import RUN, StepContext, identified
from haptic_wall.controller.experiments.commission.store import settings_of
from haptic_wall.controller.experiments.kept_folder import without_link
from haptic_wall.controller.experiments.testbed import (
    ExperimentInterruptedError,
    ExperimentTrippedError,
)
from haptic_wall.controller.processes.run_report import exit_status
from haptic_wall.controller.settings.config import Config
from haptic_wall.controller.system.files import whole
from haptic_wall.controller.system.signals import interrupting
from haptic_wall.hw.errors import ServoError

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


def run_steps(bench: StepContext) -> Ended:
    """Execute every step that is not done yet.

    Args:
        bench: The servo and the folder; steps that are done there are kept.

    Raises:
        OSError: Results could not be written.
        UserError: A file of an earlier commissioning was changed.
    """
    outcomes: dict[Step, StepOutcome] = {}
    config = bench.config
    interrupted = False
    for step in STEPS:
        basis = settings_of(config, bench.reach)
        outcome = bench.store.outcomes.get(step)
        if outcome is not None and outcome.basis == basis and _is_kept(outcome, bench):
            if outcome.state == "done":
                bench.tell(f"{step}: kept from an earlier call")
            outcomes[step] = outcome
        elif not interrupted:
            why_not = _obstacle(step, outcomes, config)
            try:
                with interrupting():
                    outcome, shown = (
                        (StepOutcome(step, "skipped", basis, why_not), ())
                        if why_not is not None
                        else _taken(step, replace(bench, config=config, partly={}), basis)
                    )
            except (KeyboardInterrupt, ExperimentInterruptedError):
                bench.tell(f"{step}: interrupted")
                interrupted = True  # earlier measurements stay in the report
                continue
            outcome = bench.store.keep(outcome)
            outcomes[step] = outcome
            if outcome.reason is not None:
                bench.tell(f"{step}: {outcome.state}: {outcome.reason}")
            try:
                if shown and step in bench.plots:
                    outcomes[step] = _drawn(outcome, shown, bench)
            except KeyboardInterrupt:
                bench.tell(f"{step}: interrupted")
                interrupted = True
        if step == "identify" and (found := done(outcomes, step)) is not None:
            config = identified(found["config_text"], bench.config)
            if bench.store.restore_config(found["config_text"]):
                bench.tell(
                    "config.yaml was edited, so it is not replaced; delete it to get a new one"
                )
    return Ended(outcomes, config, interrupted)


def _is_kept(outcome: StepOutcome, bench: StepContext) -> bool:
    """Whether an earlier step need not be repeated."""
    if outcome.step == "doctor":  # the testbed is examined again before new motions
        return bench.store.complete
    return outcome.state == "done"


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
    bench.before(step)
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


def _drawn(outcome: StepOutcome, shown: tuple[Any, ...], bench: StepContext) -> StepOutcome:
    """Draw the picture of a stored step, if possible; return the outcome."""
    picture = bench.picture(outcome.step)
    try:
        with whole(without_link(picture)) as part:
            bench.plots[outcome.step](*shown, bench.name, part)
        return bench.store.keep(replace(outcome, picture=picture.name))
    except Exception as error:  # noqa: BLE001 - whatever may be wrong with what draws
        bench.tell(f"{outcome.step}: its picture could not be drawn ({error}); its data are kept")
        return outcome


def _fatal_text(data: Mapping[str, Any]) -> str:
    said = [
        f"{check['name']}: found {check['found']}, wanted {check['wanted']}"
        + (f"; {check['fix']}" if check["fix"] else "")
        for check in data["checks"]
        if check["name"] in data["fatal"]
    ]
    mend = any(c["fixable"] for c in data["checks"] if c["name"] in data["fatal"])
    return "; ".join(said) + ("; `haptic-wall doctor CONFIG --fix` remedies it" if mend else "")
