"""Lets a user run the wall on hardware: adapter, real-time limits, group.

    scripts/setup-testbed [--user NAME] [--dry-run] [--yes]

Says what it will change, asks, and then does it; nothing else on the system is touched. Needs root
for the changes (sudo), and nothing but Python's own library.
"""

import argparse
import getpass
import grp
import os
import pwd
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

GROUP = "haptic-wall"
SERIAL_GROUPS = ("dialout", "uucp")
"""Group that may open serial ports: on Debian, Ubuntu and Fedora; on Arch"""
RULES = Path("etc/udev/rules.d/99-haptic-wall.rules")
LIMITS = Path("etc/security/limits.d/haptic-wall.conf")
MARK = "# Written by haptic-wall's scripts/setup-testbed"
RULES_TEXT = f"""\
{MARK}
# FTDI adapters (U2D2 and most others): replies are handed on after 1 ms, not after 16.
ACTION=="add|change", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{{latency_timer}}="1"
# A modem manager must not talk to them: to a servo its questions are noise.
ACTION=="add|change", SUBSYSTEM=="usb", ATTR{{idVendor}}=="0403", ENV{{ID_MM_DEVICE_IGNORE}}="1"
# The processor may be kept from deep sleep, whose end costs tens of microseconds and more.
KERNEL=="cpu_dma_latency", GROUP="{GROUP}", MODE="0660"
"""
LIMITS_TEXT = f"""\
{MARK}
# Real-time scheduling, and memory that is never paged out, for members of the group.
@{GROUP} - rtprio 95
@{GROUP} - memlock unlimited
"""


class Refused(Exception):  # noqa: N818 - a refusal is what it is
    """The set-up cannot be made; the message says why, and what to do."""


@dataclass(frozen=True, slots=True)
class Change:
    """One change, in words and in deed."""

    text: str
    make: Callable[[], None]


def command(*words: str) -> None:
    """Run a program of the system.

    Raises:
        Refused: It is not there, or failed.
    """
    if shutil.which(words[0]) is None:
        raise Refused(f"{words[0]} is not installed: '{' '.join(words)}' needs it")
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise Refused(f"'{' '.join(words)}' failed: {(done.stderr or done.stdout).strip()}")


def changes(user: str, root: Path) -> list[Change]:
    """Find the missing changes."""
    groups = _groups()
    serial = next((name for name in SERIAL_GROUPS if name in groups), None)
    found: list[Change] = []
    if _ours(root / LIMITS) != LIMITS_TEXT.splitlines():
        why = f"rtprio 95, memlock unlimited for {GROUP}"
        found.append(_writing(root / LIMITS, LIMITS_TEXT, why))
    if GROUP not in groups:
        found.append(Change(f"make the group {GROUP}", lambda: command("groupadd", "-r", GROUP)))
    if _ours(root / RULES) != RULES_TEXT.splitlines():
        why = "FTDI adapters at 1 ms, without a modem manager; no deep sleep of cores on request"
        found += [_writing(root / RULES, RULES_TEXT, why), _REREAD]
    joins = [name for name in (GROUP, serial) if name and user not in groups.get(name, ())]
    return found + [_joining(user, name) for name in joins]


def _groups() -> dict[str, list[str]]:
    return {entry.gr_name: list(entry.gr_mem) for entry in grp.getgrall()}


def _joining(user: str, group: str) -> Change:
    return Change(
        f"put {user} into the group {group}", lambda: command("usermod", "-aG", group, user)
    )


def _writing(path: Path, text: str, why: str) -> Change:
    def write() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    return Change(f"write {path}: {why}", write)


def reread_rules() -> None:
    """Apply the rules to plugged-in devices; without udev they count from its next start."""
    if shutil.which("udevadm") is None or not Path("/run/udev/control").exists():
        print("  udev does not run here: its rules take effect at its next start")
        return
    command("udevadm", "control", "--reload")
    command("udevadm", "trigger", "--subsystem-match=usb-serial", "--subsystem-match=misc")


_REREAD = Change("have udev read its rules again", reread_rules)


def _ours(path: Path) -> list[str]:
    """The lines of a file that this script has written; none where there is none.

    Raises:
        Refused: Another program wrote it.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise Refused(f"{path} cannot be read ({error}): make it readable first") from None
    if not any(line.startswith(MARK) for line in lines):
        raise Refused(f"found a {path} that this script did not write: move it away first")
    return lines


def _user(name: str | None) -> str:
    """Return the user: the named one, the caller of sudo, or the present one."""
    name = name or os.environ.get("SUDO_USER") or getpass.getuser()
    try:
        pwd.getpwnam(name)
    except KeyError:
        print(f"setup-testbed: --user: found {name}, wanted a user of this system", file=sys.stderr)
        sys.exit(2)
    return name


def _agreed() -> bool:
    if not sys.stdin.isatty():
        raise Refused(
            "standard input is no terminal for a question: use --dry-run first, then --yes"
        )
    return input("make these changes? [y/N] ").strip().lower() in ("y", "yes")


def run(wanted: argparse.Namespace) -> None:
    """Say, ask, do.

    Raises:
        Refused: Something is in the way.
    """
    planned = changes(_user(wanted.user), wanted.root)
    if not planned:
        print("nothing to do: the set-up is complete")
        return
    print("changes:")
    for change in planned:
        print(f"  {change.text}")
    if wanted.dry_run:
        return
    if os.geteuid() != 0:
        raise Refused("only root may change this: use sudo, with the same options")
    if not wanted.yes and not _agreed():
        print("nothing was changed")
        return
    for change in planned:
        try:
            change.make()
        except OSError as error:
            raise Refused(f"could not {change.text}: {error.strerror}; call it again") from None
        print(f"done: {change.text}")
    print(
        "log out and in again, and plug the adapter in again; then\n"
        "  haptic-wall run simulated --set realtime.profile=strict   shows the granted settings\n"
        "  haptic-wall doctor CONFIG                                  examines the adapter"
    )


def main() -> None:
    """Read the options; one sentence where it cannot be done."""
    parser = argparse.ArgumentParser(
        prog="setup-testbed",
        description="Let a user run the wall on hardware: a udev rule for the adapter's latency"
        " timer, limits for real-time scheduling and locked memory, and the groups for both. It"
        " lists its changes first, and asks.",
    )
    parser.add_argument("--user", help="name of the user (default: you, also under sudo)")
    parser.add_argument("--dry-run", action="store_true", help="only list the changes")
    parser.add_argument("--yes", action="store_true", help="do not ask")
    parser.add_argument("--root", type=Path, default=Path("/"), help=argparse.SUPPRESS)
    wanted = parser.parse_args()
    if not wanted.root.is_dir():
        parser.error(f"--root: found {wanted.root}, wanted a folder")
    try:
        run(wanted)
    except Refused as refusal:
        sys.exit(f"setup-testbed: {refusal}")
    except (KeyboardInterrupt, EOFError):
        print("\ninterrupted: nothing more was changed", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
