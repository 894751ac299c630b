"""Assembles the data of a commissioning's page, its text and ``--json``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from haptic_wall import __version__
from haptic_wall.controller.experiments.commission import agreement
from haptic_wall.controller.experiments.commission.outcome import STEPS, TITLES
from haptic_wall.controller.experiments.commission.sequence import Ended, is_complete
from haptic_wall.controller.experiments.commission.steps import CONFIG
from haptic_wall.controller.experiments.commission.verdict import GuardQuestion, verdict

COMPLETE, INCOMPLETE, NOT_MEASURED = "complete", "incomplete", "not measured"
"""Values of ``status``"""
_CONFIG_TEXT = "config_text"


def report(ended: Ended, name: str, folder: Path) -> dict[str, Any]:
    """Return the report's data; a step that is not done is null.

    Args:
        ended: The commissioning, as far as it came.
        name: Name of the configuration, for people.
        folder: Folder with the files of the steps.
    """
    config, outcomes = ended.config, ended.outcomes
    found = {step: ended.data(step) for step in STEPS}
    question = GuardQuestion.of(config, found["delay"])
    config_file = folder / CONFIG
    complete = is_complete(outcomes)
    status = COMPLETE if complete else INCOMPLETE
    return {
        "name": name,
        "program": f"haptic-wall {__version__}",
        "servo": config.servo.kind,
        "model": config.servo.model,
        "clock": config.loop.clock,
        "rate_hz": config.loop.rate_hz,
        "interrupted": ended.interrupted,
        "status": NOT_MEASURED if found["identify"] is None else status,
        "complete": complete,
        "verdict": verdict(question, found["identify"] is not None),
        "agreement": _agreement(ended, found),
        "steps": [
            {
                "step": step,
                "title": TITLES[step],
                "state": outcomes[step].state if step in outcomes else "not taken",
                "reason": outcomes[step].reason if step in outcomes else None,
                "seconds": outcomes[step].seconds if step in outcomes else None,
                "picture": f"{step}.png" if (folder / f"{step}.png").exists() else None,
            }
            for step in STEPS
        ],
        # After a fatal finding of the doctor only its checks matter.
        "doctor": (outcomes["doctor"].data or None) if "doctor" in outcomes else None,
        "identify": _without_text(found["identify"]),
        "delay": found["delay"],
        "sweep": found["sweep"],
        "config": str(config_file) if found["identify"] is not None else None,
    }


def _without_text(identify: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if identify is None:
        return None
    return {key: value for key, value in identify.items() if key != _CONFIG_TEXT}


def _agreement(ended: Ended, found: Mapping[Any, dict[str, Any] | None]) -> dict[str, Any]:
    """Return theory beside measurement; null where either is missing."""
    identify, delay, sweep = found["identify"], found["delay"], found["sweep"]
    answer: dict[str, Any] = {"delay": None, "boundary": None}
    if identify is not None and delay is not None:
        answer["delay"] = agreement.delays(identify, delay, ended.config.period_s)
    if identify is not None and sweep is not None:
        answer["boundary"] = agreement.boundary(
            ended.config, sweep["points"], identify.get("effects")
        )
    return answer
