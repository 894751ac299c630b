"""Runs a wall from Python, in separate processes, and changes it while it runs.

::

    with run("simulated", duration_s=60.0) as wall:
        wall.set({"wall.stiffness": 4.0})
        wall.set({"wall.law": "detents", "wall.count": 12}, wait_s=30.0)
        print(wall.report()["changes"])
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Final

from haptic_wall.controller.errors import HapticWallError, UserError
from haptic_wall.controller.live.ask import ask
from haptic_wall.controller.live.run_socket import AliveRun, connected, socket_of
from haptic_wall.controller.runtime.telemetry import LoopState, Telemetry, Word
from haptic_wall.controller.settings.load import load_config

START_S: Final = 60.0
"""Longest time until a started run takes changes [s]"""
END_S: Final = 30.0
"""Longest time from the request to end a run until its report [s]"""
_LOOK_S: Final = 0.02


class RunError(HapticWallError):
    """A run could not start, ended without a report, or has no new positions.

    Args:
        what: Why, as the run's own process says it.
        exit_status: Exit status of ``haptic-wall run``: 4 where servo or machine are unfit.
    """

    def __init__(self, what: str, exit_status: int = HapticWallError.exit_status) -> None:
        super().__init__(what)
        self.exit_status = exit_status


class RunningWall:
    """A running wall. It ends with the process that has started it.

    Args:
        log: Path of its log.
        arguments: Of its command, ``haptic-wall`` left out.
        axes: Names of its axes; one empty name: it has one servo.
        said: File that its messages go to; None: standard error.

    Attributes:
        log: See above.
        age_s: Age of the oldest of the last ``positions``, when they were returned [s].
    """

    def __init__(
        self,
        log: Path,
        arguments: Sequence[str],
        axes: Sequence[str] = ("",),
        said: IO[str] | None = None,
    ) -> None:
        self.log = log
        self._axes = axes
        self._telemetry: Telemetry | None = None
        self.age_s = math.inf
        self._answer: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed in close()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, *arguments],
            stdin=subprocess.PIPE,  # closed by the kernel when the starter ends
            stdout=self._answer,
            stderr=said,
            process_group=0,  # a Ctrl-C is for the starter, which ends the run as it leaves
        )

    def set(self, changes: Mapping[str, Any], wait_s: float = 10.0) -> dict[str, Any]:
        """Change the wall in one tick, at which the change gives the shaft no energy.

        Args:
            changes: New values by path, such as ``{"wall.stiffness": 4.0}``.
            wait_s: Longest wait for that tick [s].

        Returns:
            ``applied``, ``changed``, ``waited_s``, ``row``, and ``guard`` with what is commanded
            and the reasons.

        Raises:
            NotAppliedError: The change was refused, or no such tick came in time; the wall is
                unchanged.
            UserError: The run has ended.
        """
        run = AliveRun(socket_of(self.log), self._process.pid)
        return ask(run, _sets(changes), wait_s, lambda _text: None)

    def positions(self, most_age_s: float = 0.1) -> dict[str, float]:
        """Return the newest position of each axis by its name [rad]; one servo has an empty name.

        It reads shared memory, and waits only until each servo has answered for the first time.

        Args:
            most_age_s: Largest time since the sample was requested from the servo [s].

        Raises:
            RunError: The run has ended, the message says why; or an axis has no position as young,
                because the run hangs or loses its replies.
        """
        end_s = time.monotonic() + START_S
        while self.running() and time.monotonic() < end_s:
            with contextlib.suppress(OSError):  # it has not made its memory yet, or has ended
                if self._telemetry is None:
                    self._telemetry = Telemetry.of(self._process.pid, len(self._axes))
                words = self._telemetry.words
                if words[Word.STATE] > LoopState.RUNNING:
                    break
                rows, _ = self._telemetry.read(max(0, words[Word.HEAD] - 1), 1)
                sampled = rows["sampled_ns"]
                if sampled.size and sampled.all():
                    run_ns = time.monotonic_ns() - words[Word.OFFSET_NS]
                    self.age_s = 1e-9 * (run_ns - int(sampled.min()))
                    if self.age_s <= most_age_s:
                        return dict(zip(self._axes, rows[0]["position"].tolist(), strict=True))
                    raise RunError(
                        f"no position of the run of {self.log} is younger than {most_age_s:g} s: it"
                        " hangs, or loses its replies"
                    )
            time.sleep(_LOOK_S)
        report = self.report()
        why = f"; {report['explanation']}" if report["explanation"] else ""
        raise RunError(f"the run of {self.log} has ended: {report['stop_reason']}{why}")

    def running(self) -> bool:
        """Whether the run goes on."""
        return self._process.poll() is None

    def wait(self) -> dict[str, Any]:
        """Wait until the run ends by itself; return its report, as ``run --json`` prints it.

        Raises:
            RunError: The run could not start.
        """
        self._process.wait()
        self._answer.seek(0)
        try:
            said: dict[str, Any] = json.load(self._answer)
        except ValueError:
            raise RunError(
                f"the run of {self.log} ended without a report; its messages are on standard error"
            ) from None
        if "error" not in said:
            return said
        if said["exit_status"] == UserError.exit_status:
            raise UserError(said["error"])
        raise RunError(said["error"], said["exit_status"])

    def report(self) -> dict[str, Any]:
        """End the run, if it still goes on; return its report, as ``run --json`` prints it.

        Raises:
            RunError: The run could not start, or does not end.
        """
        self.end()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            raise RunError(
                f"the run of {self.log} does not end; switch the servo's power off, and kill its"
                " processes"
            ) from None
        return self.wait()

    def await_start(self) -> None:
        """Wait until the run takes changes, or has ended."""
        end_s = time.monotonic() + START_S
        while self.running() and time.monotonic() < end_s:
            with contextlib.suppress(OSError):
                connected(socket_of(self.log)).close()
                return
            time.sleep(_LOOK_S)

    def end(self) -> None:
        """Let the run end; it is over after ``close``."""
        self._process.terminate()

    def close(self) -> None:
        """End the run, and its processes."""
        self.end()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(END_S)
        self._process.kill()
        self._process.wait()
        self._answer.seek(0)
        with self._answer as answer:  # its text stays: how the run ended may be asked afterwards
            self._answer = io.BytesIO(answer.read())
        for stream in (self._process.stdin, self._telemetry):
            if stream is not None:
                stream.close()


def axes(
    config: str | os.PathLike[str], changes: Mapping[str, Any] | Sequence[str] = ()
) -> tuple[str, ...]:
    """Return the names of a configuration's axes, in order; ``("",)``: it has one, without a name.

    Args:
        config: As of ``run``.
        changes: As of ``run``.

    Raises:
        ConfigError: The configuration is wrong.
    """
    return tuple(load_config(os.fspath(config), _sets(changes)).config.each)


@contextlib.contextmanager
def run(
    config: str | os.PathLike[str],
    changes: Mapping[str, Any] | Sequence[str] = (),
    *,
    duration_s: float | None = None,
    log: str | os.PathLike[str] | None = None,
) -> Iterator[RunningWall]:
    """Run a wall in processes of its own; when the block ends, the run ends with torque off.

    The run's messages go to standard error. On the simulated clock it is over before it could be
    changed, and ``report`` has its result.

    Args:
        config: A preset's name, or the path of a YAML file.
        changes: Changes of it: values by path, such as ``{"wall.stiffness": 4.0}``, or texts
            ``PATH=VALUE``.
        duration_s: Time for which the wall is on [s]; None: until the block ends.
        log: Path of its log; None: in a temporary folder, which is removed.

    Raises:
        ConfigError: The configuration is wrong.
        UserError: The duration is missing on the simulated clock, or it or the log cannot be used.
        RunError: The run could not start.
    """
    sets = _sets(changes)
    effective = load_config(os.fspath(config), sets).config
    if duration_s is None and effective.loop.clock == "simulated":
        raise UserError(
            "found none",
            field="duration_s",
            wanted="the simulated time, because on the simulated clock no block lasts long",
            advice="give for example duration_s=5",
        )
    if duration_s is not None and not duration_s > 0.0:
        raise UserError(f"found {duration_s:g}", field="duration_s", wanted="a time above 0 s")
    with contextlib.ExitStack() as scope:
        if log is None:
            folder = scope.enter_context(tempfile.TemporaryDirectory(prefix="haptic-wall-"))
            log = Path(folder) / "run.hwlog"
        arguments = ["run", os.fspath(config), "--json", "--no-plot", "--log", os.fspath(log)]
        arguments += [f"--duration={math.inf if duration_s is None else float(duration_s)!r}"]
        arguments += [f"--set={change}" for change in sets]
        wall = RunningWall(Path(log), arguments, tuple(effective.each))
        scope.callback(wall.close)
        wall.await_start()
        if not wall.running():
            wall.wait()
        yield wall


def _sets(changes: Mapping[str, Any] | Sequence[str]) -> list[str]:
    if not isinstance(changes, Mapping):
        return list(changes)
    return [f"{path}={json.dumps(value, default=_plain)}" for path, value in changes.items()]


def _plain(value: Any) -> Any:  # noqa: ANN401 - JSON
    """Return what JSON has no word for as what it has: NumPy's numbers and arrays, and paths."""
    return value.tolist() if hasattr(value, "tolist") else os.fspath(value)


def _end_with(pipe: int, starter: int) -> None:
    # Children of the starter may hold the pipe; a starter that has gone already left only the pipe.
    select.select([pipe, starter], [], [])
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":  # a command that ends with its starter
    from haptic_wall.controller.cli.main import main

    pipe = os.dup(0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    threading.Thread(
        target=_end_with, args=(pipe, os.pidfd_open(os.getppid())), daemon=True
    ).start()
    sys.exit(main())
