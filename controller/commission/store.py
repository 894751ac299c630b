"""A commissioning's folder: each step as soon as it is known; only the same settings may go on."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from controller import __version__
from controller.commission.outcome import STEPS, Outcome, Step
from controller.errors import UserError
from controller.experiments.kept_folder import fingerprint, made, replaced
from controller.settings.config import Config

MAIN, CONFIG, PAGE, LOGS = "commission.json", "config.yaml", "report.html", "logs"
_FORMAT = "haptic-wall commission 1"
_WRITTEN = (
    *(CONFIG, PAGE),
    *(f"{step}{suffix}" for step in STEPS for suffix in (".json", ".png")),
)

Encode = Callable[[Mapping[str, Any]], str]
"""One JSON object as text; what is not finite is null"""


def settings_of(config: Config, reach: float) -> str:
    """Fingerprint of everything that the figures depend on.

    Args:
        config: The effective configuration.
        reach: How far the shaft may come while it is identified [rad].
    """
    return fingerprint({"config": config.model_dump(mode="json"), "reach": reach})


class CommissionStore:
    """Keeps what is known, after each step.

    Args:
        folder: Made if need be.
        asked: ``settings_of`` what is asked for.
        name: Of the configuration, for people.
        encode: Turns results into JSON.
        fresh: Forget what an earlier commissioning left here.
        only_look: Change nothing, make nothing; nothing can be kept.

    Attributes:
        folder: See above.
        outcomes: What is known of each step.

    Raises:
        UserError: The folder holds something else, or cannot be used.
    """

    def __init__(
        self,
        folder: Path,
        asked: str,
        name: str,
        encode: Encode,
        fresh: bool,
        only_look: bool = False,
    ) -> None:
        self.folder = folder
        self.outcomes: dict[Step, Outcome] = {}
        self._encode = encode
        if folder.exists() and not folder.is_dir():
            raise UserError(f"--out {folder}: found a file, wanted a folder; name another place")
        ours = self._ours(asked, fresh)
        held = [name for name in _WRITTEN if not ours and (folder / name).exists()]
        if held:
            raise UserError(
                f"--out {folder}: it holds a {held[0]} that no commissioning wrote; name another"
                " folder, so that it is not lost"
            )
        if ours and not fresh:
            self._resume()
        if only_look:
            return
        made(folder, LOGS)
        self._outdated = fresh
        head = {"format": _FORMAT, "program": __version__, "fingerprint": asked, "name": name}
        self._replace(MAIN, self._encode(head))

    def _ours(self, asked: str, fresh: bool) -> bool:
        """Whether an earlier commissioning was here; of other settings it is refused."""
        path = self.folder / MAIN
        if not path.exists():
            return False
        try:
            held = json.loads(path.read_text(encoding="utf-8"))
            right = held["format"] == _FORMAT
        except (OSError, ValueError, KeyError, TypeError):
            right = False
        if not right:
            raise UserError(
                f"--out {self.folder}: {MAIN} there is not a commissioning of ours; name another"
                " folder"
            )
        if held["fingerprint"] != asked and not fresh:
            raise UserError(
                f"--out {self.folder}: it holds a commissioning with other settings"
                f" ({held['name']}, haptic-wall {held['program']}); name another folder, or give"
                " --fresh to begin anew and replace it"
            )
        return True

    def _forget(self) -> None:
        """Remove what an earlier commissioning left: now there is something to replace it with."""
        self._outdated = False
        for name in (CONFIG, PAGE, *(f"{step}.json" for step in STEPS)):
            (self.folder / name).unlink(missing_ok=True)

    def _resume(self) -> None:
        for step in STEPS:
            path = self.folder / f"{step}.json"
            if not path.exists():
                continue
            try:
                self.outcomes[step] = Outcome(**json.loads(path.read_text(encoding="utf-8")))
            except (OSError, ValueError, TypeError) as error:
                raise UserError(
                    f"--out {self.folder}: {path.name} cannot be read ({error}); delete it to do"
                    " that step again, or give --fresh"
                ) from error

    @property
    def done(self) -> list[Step]:
        """The steps that are not taken again: a doctor's only when there is nothing left to do."""
        return [
            step
            for step, outcome in self.outcomes.items()
            if outcome.state == "done" and (step != "doctor" or self.complete)
        ]

    @property
    def complete(self) -> bool:
        """Whether there is nothing left to measure."""
        return all(step in self.outcomes for step in STEPS) and all(
            o.state == "done" or (o.step == "doctor" and o.state == "skipped")
            for o in self.outcomes.values()
        )

    def keep(self, outcome: Outcome) -> Outcome:
        """Keep one step; what is on disk is never half of it.

        Returns:
            The outcome as it will be read again: plain values only.

        Raises:
            OSError: It cannot be written.
        """
        if self._outdated and outcome.state == "done":
            self._forget()
        text = self._encode(asdict(outcome))
        kept = Outcome(**json.loads(text))
        if outcome.step == "identify":  # what comes after it was measured of another model
            for later in STEPS[STEPS.index("identify") + 1 :]:
                if self.outcomes.pop(later, None) is not None:
                    (self.folder / f"{later}.json").unlink(missing_ok=True)
        self.outcomes[outcome.step] = kept
        self._replace(f"{outcome.step}.json", text)
        return kept

    def keep_config(self, text: str) -> None:
        """Write the configuration with the identified model.

        Raises:
            OSError: It cannot be written.
        """
        self._replace(CONFIG, text)

    def keep_page(self, text: str) -> Path:
        """Write the report; its path.

        Raises:
            OSError: It cannot be written.
        """
        return self._replace(PAGE, text)

    def _replace(self, name: str, text: str) -> Path:
        path = self.folder / name
        with replaced(path) as stream:
            stream.write(text if text.endswith("\n") else f"{text}\n")
        return path
