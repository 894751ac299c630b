"""Runs the emulated bus as a process: starts it, injects faults, reads its record, ends it."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Self

from haptic_wall.controller.emulated_bus.record import BusRow, read_rows, written_until

_PATIENCE_S: Final = 30.0
"""Time allowed for the process to start, to reply or to end: a loaded machine may take seconds."""
_POLL_S: Final = 0.02
_READ_SIZE: Final = 65536
PROGRAM: Final = "haptic_wall.controller.emulated_bus.program"


class BusError(Exception):
    """The emulated bus did not start, died, or cannot do what was asked."""


class DynamixelBus:
    """An emulated bus in a process of its own, for the duration of a ``with`` block.

    Args:
        servos: ``MODEL``, ``MODEL:ID`` or ``MODEL:ID:FIRMWARE`` each.
        baud: Baud rate of the servos [bit/s].
        latency_timer: Latency timer of the USB adapter [ms]; 0: replies are handed over at once.
        block: Bytes that the adapter hands over without waiting; None: 510.
        faults: Faults from the start, as for ``inject``.
        seed: Decides the start of the servos' clocks, and the random choices of the faults.
        truth: True parameters of the servos, by name without ``servo.``, e.g.
            ``{"position": 1.0}``; see ``haptic-wall emulate --help``. SI units.
        own: The same of single servos, by id.
        arm: Links between the servos, e.g. ``{"shape": "planar", "length_1": 0.2}``.
    """

    def __init__(
        self,
        servos: Sequence[str] = ("XM430-W350:1",),
        *,
        baud: int = 4_000_000,
        latency_timer: int = 0,
        block: int | None = None,
        faults: Sequence[str] = (),
        seed: int = 0,
        truth: Mapping[str, float | str] | None = None,
        own: Mapping[int, Mapping[str, float | str]] | None = None,
        arm: Mapping[str, float | str] | None = None,
    ) -> None:
        for name, value in (("servos", servos), ("faults", faults)):
            if isinstance(value, str):
                raise BusError(f"{name}: found the text {value!r}, wanted a list: [{value!r}]")
        self.baud = baud
        self.ids = tuple(_id(servo) for servo in servos)
        """Ids of the servos, in the given order"""
        self.port = ""
        """Path for a client; unchanged after the adapter was unplugged and plugged in again"""
        self._plan: dict[str, Any] = {
            "servos": list(servos),
            "truth": dict(truth or {}),
            "own": {str(id_): dict(values) for id_, values in (own or {}).items()},
            "arm": dict(arm or {}),
            "baud": baud,
            "latency_timer": latency_timer,
            "faults": list(faults),
            "seed": seed,
            **({} if block is None else {"block": block}),
        }
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._record = Path()
        self._unheard = {"out": b"", "error": b""}
        self._rows: list[BusRow] | None = None
        """All of them, once the bus has ended"""

    def __enter__(self) -> Self:
        """Start the process and wait for its port.

        Raises:
            BusError: It does not start; the message ends with its output.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="dynamixel-bus-")
        self.port = str(Path(self._folder.name) / "port")
        self._record = Path(self._folder.name) / "record.csv"
        places: dict[str, Any] = {"link": self.port, "record": str(self._record)}
        places["owner"] = os.getpid()  # leaves no folder behind even if killed
        try:
            self._process = subprocess.Popen(
                # -P: the working folder may hold a package of the same name.
                [sys.executable, "-P", "-m", PROGRAM, json.dumps(self._plan | places)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env=_environment(),
                start_new_session=True,  # a Ctrl-C is for the tests, which then end it
            )
            self._answer("/")
        except BaseException:
            self._release()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, if it was not stopped before.

        Raises:
            BusError: As ``stop`` does.
        """
        self.stop()

    def inject(self, fault: str) -> None:
        """Inject a fault from now on.

        Args:
            fault: For instance ``drop:p=0.05``, ``corrupt:every=10,way=reply``,
                ``hardware-error:bits=overload,id=1`` or ``unplug:for=0.5``.

        Raises:
            BusError: It is no fault, or for an id that no servo has.
        """
        self._tell(fault, "on ")

    def lift(self, name: str) -> None:
        """End all faults of this name, ``drop`` for instance.

        Raises:
            BusError: No fault has this name.
        """
        self._tell(f"off {name}", "off ")

    def stop(self) -> None:
        """End the process; ``rows`` is then complete and returns at once. Safe to call twice.

        Raises:
            BusError: It had died before, or failed at the end; the message ends with its output.
        """
        process = self._process
        if process is None:
            return
        died = process.poll() is not None
        if not died:
            process.terminate()
        try:
            process.wait(_PATIENCE_S)
            complaint = self._complaint()
            self._rows = read_rows(self._record)
        finally:
            self._release()
        if died:
            raise BusError(f"The emulated bus died: status {process.returncode}.{complaint}")
        if process.returncode:
            raise BusError(f"The emulated bus ended with {process.returncode}.{complaint}")

    @property
    def rows(self) -> list[BusRow]:
        """Return all events so far, in order of time.

        While the bus runs, this waits until the record has been written so far: half a second.

        Raises:
            BusError: The bus has died, or was never started.
        """
        if self._rows is not None:
            return self._rows
        process = self._running()
        now_s = time.monotonic()
        while written_until(self._record) < now_s:
            if process.poll() is not None:
                raise BusError(f"The emulated bus has died.{self._complaint()}")
            if time.monotonic() > now_s + _PATIENCE_S:
                raise BusError(f"The emulated bus has recorded nothing for {_PATIENCE_S:.0f} s.")
            time.sleep(_POLL_S)
        return [row for row in read_rows(self._record) if row.time_s <= now_s]

    def events(self, event: str, id: int | None = None) -> list[BusRow]:  # noqa: A002
        """Return the rows of one kind, of one servo or of all.

        Args:
            event: ``rx``, ``tx``, ``state`` or ``fault``.
            id: The row's id; None: any.
        """
        return [row for row in self.rows if row.event == event and id in (None, row.id)]

    def state(self, id: int | None = None) -> BusRow:  # noqa: A002
        """Return a servo's true position, speed and acting torque.

        Args:
            id: Id of the servo; None: the first.

        Raises:
            BusError: No servo has this id.
        """
        wanted = self.ids[0] if id is None else id
        if wanted not in self.ids:
            raise BusError(f"No servo has the id {wanted}: the bus has {list(self.ids)}.")
        return self.events("state", wanted)[-1]

    def position(self, id: int | None = None) -> float:  # noqa: A002
        """Return a servo's true position [rad]; see ``state``."""
        return self.state(id).position_rad

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            raise BusError("The emulated bus does not run: use it inside its `with` block.")
        return self._process

    def _tell(self, line: str, sign: str) -> None:
        """Write a line to the process's standard input, and wait for its confirmation."""
        process = self._running()
        assert process.stdin is not None
        try:
            process.stdin.write(" ".join(line.split()).encode() + b"\n")
            process.stdin.flush()
        except BrokenPipeError:
            raise BusError(f"The emulated bus has died.{self._complaint()}") from None
        self._answer(sign)

    def _answer(self, sign: str) -> None:
        """Wait for a line of the process that begins with ``sign``.

        Raises:
            BusError: It complained, died, or wrote nothing.
        """
        process = self._running()
        assert process.stdout is not None
        assert process.stderr is not None
        names = {process.stdout.fileno(): "out", process.stderr.fileno(): "error"}
        end_s = time.monotonic() + _PATIENCE_S
        ready = select.poll()  # select refuses descriptors from 1024 on
        for each in names:
            ready.register(each, select.POLLIN)
        while heard := ready.poll(1e3 * max(0.0, end_s - time.monotonic())):
            for descriptor, _ in heard:
                name = names[descriptor]
                data = os.read(descriptor, _READ_SIZE)
                if not data:
                    process.wait(_PATIENCE_S)
                    raise BusError(f"The emulated bus does not run.{self._complaint()}")
                *lines, self._unheard[name] = (self._unheard[name] + data).split(b"\n")
                text = b"\n".join(lines).decode(errors="replace")
                if name == "error" and lines:
                    raise BusError(text)
                if any(line.startswith(sign) for line in text.splitlines()):
                    return
        raise BusError(f"The emulated bus has said nothing for {_PATIENCE_S:.0f} s.")

    def _complaint(self) -> str:
        """Return the unread text on standard error of a process that has ended."""
        process = self._running()
        assert process.stderr is not None
        text = (self._unheard["error"] + process.stderr.read()).decode(errors="replace").strip()
        return f" It said:\n{text}" if text else ""

    def _release(self) -> None:
        """End the process, and remove its pipes and files."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            for pipe in (process.stdin, process.stdout, process.stderr):
                assert pipe is not None
                with suppress(BrokenPipeError):
                    pipe.close()
            process.wait(_PATIENCE_S)
        if self._folder is not None:
            self._folder.cleanup()


def _id(servo: str) -> int:
    given = servo.split(":")[1:2]
    try:
        return int(given[0]) if given else 1
    except ValueError:
        raise BusError(f"servos: found {servo!r}, wanted MODEL[:ID[:FIRMWARE]]") from None


def _environment() -> dict[str, str]:
    """Return the tests' environment, with PYTHONPATH leading to this package only."""
    ours = str(Path(__file__).parents[3].resolve())
    places = [p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p]
    kept = [p for p in places if str(Path(p).resolve()) == ours]
    return os.environ | {"PYTHONPATH": os.pathsep.join(kept), "PYTHONUNBUFFERED": "1"}
