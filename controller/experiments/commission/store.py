"""A commissioning's folder: stores each step at once; only the same settings may continue it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import TypeAdapter, ValidationError

from haptic_wall import __version__
from haptic_wall.controller.errors import UserError
from haptic_wall.controller.experiments.commission.found import (
    file_name,
    picture_name,
    read_outcome,
)
from haptic_wall.controller.experiments.commission.outcome import STEPS, Step, StepOutcome
from haptic_wall.controller.experiments.kept_folder import (
    fingerprint,
    kept_bytes,
    made,
    refused,
    replaced,
)
from haptic_wall.controller.settings.config import Config

MAIN, CONFIG, PAGE, LOGS = "commission.json", "config.yaml", "report.html", "logs"
ALLOWED = "allowed.png"
"""File name of the verdict's picture"""
SWEEP = "sweep"
"""Folder of the sweep"""
_WRITTEN = (CONFIG, PAGE, ALLOWED, SWEEP, *map(file_name, STEPS), *map(picture_name, STEPS))
_FORMAT: Final = "haptic-wall commission 1"
AGAIN = "delete {0}.json to repeat that step, or give --fresh"
"""Advice for a step's unusable file"""

Encode = Callable[[Mapping[str, Any]], str]
"""Returns one JSON object as text; values that are not finite become null"""


@dataclass(frozen=True, slots=True)
class _Head:
    """The head of the folder's main file."""

    format: Literal["haptic-wall commission 1"]
    program: str
    fingerprint: str
    name: str
    """Name of the configuration, for people"""


_HEAD = TypeAdapter(_Head)


def settings_of(config: Config, reach: float) -> str:
    """Return a fingerprint of all settings that affect the results.

    Args:
        config: The effective configuration.
        reach: Largest excursion during the identification [rad].
    """
    return fingerprint({"config": config.model_dump(mode="json"), "reach": reach})


class CommissionStore:
    """Stores the results after each step.

    Args:
        folder: Made if necessary.
        asked: ``settings_of`` the request.
        name: Name of the configuration, for people.
        encode: Turns results into JSON.
        fresh: Discard the results of an earlier commissioning.
        only_look: Change and create nothing; storing is not possible.

    Attributes:
        folder: See above.
        outcomes: Known outcome of each step.

    Raises:
        UserError: The folder holds foreign files, or cannot be used.
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
        self.outcomes: dict[Step, StepOutcome] = {}
        self._encode = encode
        if folder.exists() and not folder.is_dir():
            raise refused(folder, "found a file", "name another place", "a folder")
        ours = self._ours(asked, fresh)
        self._refuse_what_is_not_ours(ours)
        self._new = not ours
        self._logs_are_new = not (folder / LOGS).exists()
        if ours and not fresh:
            self._resume()
        if only_look:
            return
        made(folder, LOGS)
        self._outdated = fresh
        self._replace(MAIN, self._encode(asdict(_Head(_FORMAT, __version__, asked, name))))

    def _refuse_what_is_not_ours(self, ours: bool) -> None:
        """Refuse foreign files and links, so that nothing of another user is lost."""
        for name in () if ours else _WRITTEN:
            if os.path.lexists(self.folder / name):
                what = f"found a {name} that no commissioning wrote"
                raise refused(self.folder, what, "name another folder, so that it is not lost")
        for name in (LOGS, SWEEP):
            if (self.folder / name).is_symlink():
                advice = "remove the link, or name another folder"
                raise refused(self.folder, f"found a link {name}", advice, "a folder or nothing")

    def _ours(self, asked: str, fresh: bool) -> bool:
        """Whether the folder has an earlier commissioning; raise if its settings differ."""
        path = self.folder / MAIN
        if not os.path.lexists(path):
            return False
        try:
            held = _HEAD.validate_json(kept_bytes(path, "name another folder"), strict=True)
        except ValidationError:
            what = f"found a {MAIN} that haptic-wall did not write"
            raise refused(self.folder, what, "name another folder") from None
        if held.fingerprint != asked and not fresh:
            raise refused(
                self.folder,
                f"found a commissioning with other settings ({held.name}, haptic-wall "
                f"{held.program})",
                "name another folder, or give --fresh to replace it",
            )
        return True

    def _forget(self) -> None:
        """Remove an earlier commissioning; call when a new result is ready to replace it."""
        self._outdated = False
        for name in (CONFIG, PAGE, *map(file_name, STEPS)):
            (self.folder / name).unlink(missing_ok=True)

    def _resume(self) -> None:
        for step in STEPS:
            path = self.folder / file_name(step)
            if not os.path.lexists(path):
                continue
            text = kept_bytes(path, AGAIN.format(step))
            try:
                self.outcomes[step] = read_outcome(text, step)
            except ValueError as error:
                what = f"found a {path.name} that this program cannot have written ({error})"
                raise refused(self.folder, what, AGAIN.format(step)) from None

    @property
    def done(self) -> list[Step]:
        """Return the steps that are not repeated: the doctor only when nothing else is left."""
        return [
            step
            for step, outcome in self.outcomes.items()
            if outcome.state == "done" and (step != "doctor" or self.complete)
        ]

    @property
    def complete(self) -> bool:
        """Whether no measurement is left."""
        return all(step in self.outcomes for step in STEPS) and all(
            o.state == "done" or (o.step == "doctor" and o.state == "skipped")
            for o in self.outcomes.values()
        )

    @property
    def empty(self) -> bool:
        """Whether this commissioning has no result, and no log that explains why."""
        measured = any(
            outcome.data
            if step == "doctor" and outcome.state == "failed"
            else outcome.state == "done" and step != "doctor"
            for step, outcome in self.outcomes.items()
        )
        failed = any(outcome.state == "failed" for outcome in self.outcomes.values())
        return not measured and not (failed and any((self.folder / LOGS).glob("*")))

    def discard(self, keep_folder: bool) -> None:
        """Remove the files of a new commissioning; older files stay.

        Args:
            keep_folder: The folder existed before.

        Raises:
            OSError: It cannot be removed.
        """
        if not self._new:
            return
        for name in (MAIN, *_WRITTEN):
            path = self.folder / name
            if not path.is_dir():
                path.unlink(missing_ok=True)
        if self._logs_are_new:
            shutil.rmtree(self.folder / LOGS, ignore_errors=True)
        if not keep_folder:
            with suppress(OSError):  # it has foreign files
                self.folder.rmdir()

    def keep(self, outcome: StepOutcome) -> StepOutcome:
        """Store one step; the file on disk is never partial.

        Returns:
            The outcome as it will be read again: plain values only.

        Raises:
            OSError: It cannot be written.
        """
        if self._outdated and outcome.state == "done":
            self._forget()
        text = self._encode(asdict(outcome))
        kept = read_outcome(text, outcome.step)
        if outcome.step == "identify":  # later steps belong to the old model
            for later in STEPS[STEPS.index("identify") + 1 :]:
                if self.outcomes.pop(later, None) is not None:
                    (self.folder / file_name(later)).unlink(missing_ok=True)
        self.outcomes[outcome.step] = kept
        self._replace(file_name(outcome.step), text)
        return kept

    def keep_config(self, text: str) -> None:
        """Write the configuration with the identified model.

        Raises:
            OSError: It cannot be written.
        """
        self._replace(CONFIG, text)

    def restore_config(self, text: str) -> bool:
        """Write the configuration of an earlier call if it is missing.

        Returns:
            Whether another one is there: an edited file stays as it is.

        Raises:
            OSError: It cannot be written.
        """
        try:
            return kept_bytes(self.folder / CONFIG, "") != _ended(text).encode()
        except UserError:  # none, or a link
            self.keep_config(text)
            return False

    def keep_page(self, text: str) -> Path:
        """Write the report; return its path.

        Raises:
            OSError: It cannot be written.
        """
        return self._replace(PAGE, text)

    def _replace(self, name: str, text: str) -> Path:
        path = self.folder / name
        with replaced(path) as stream:
            stream.write(_ended(text))
        return path


def _ended(text: str) -> str:
    return text if text.endswith("\n") else f"{text}\n"
