"""The set-up of a testbed says what it will do, and does just that."""

import getpass
import grp
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from scripts import setup_testbed
from scripts.setup_testbed import GROUP, LIMITS, RULES

ME = getpass.getuser()


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> SimpleNamespace:
    """A system of its own: folders, groups, and programs that only change those groups."""
    groups = {"dialout": ["somebody"]}
    done = []

    def command(*words: str) -> None:
        done.append(" ".join(words))
        match words:
            case ("groupadd", "-r", name):
                groups[name] = []
            case ("usermod", "-aG", name, user):
                groups[name].append(user)

    monkeypatch.setattr(setup_testbed, "command", command)
    monkeypatch.setattr(
        grp,
        "getgrall",
        lambda: [SimpleNamespace(gr_name=n, gr_mem=m) for n, m in groups.items()],
    )
    monkeypatch.setattr("os.geteuid", lambda: 0)

    def call(*options: str) -> None:
        monkeypatch.setattr(sys, "argv", ["setup-testbed", f"--root={tmp_path}", *options])
        setup_testbed.main()

    return SimpleNamespace(call=call, groups=groups, done=done, root=tmp_path)


def test_it_says_what_it_will_do_and_does_it_once(
    system: SimpleNamespace, capsys: pytest.CaptureFixture[str]
) -> None:
    system.call("--dry-run", f"--user={ME}")
    said = capsys.readouterr().out
    assert not system.done and not list(system.root.iterdir())
    for word in (GROUP, "dialout", ME, str(RULES), str(LIMITS), "rtprio 95", "udev"):
        assert word in said
    system.call("--yes", f"--user={ME}")
    assert 'ATTR{latency_timer}="1"' in (system.root / RULES).read_text()
    limits = (system.root / LIMITS).read_text()
    assert f"@{GROUP} - rtprio 95\n" in limits and f"@{GROUP} - memlock unlimited\n" in limits
    assert system.groups == {"dialout": ["somebody", ME], GROUP: [ME]}
    capsys.readouterr()
    system.call("--yes", f"--user={ME}")
    assert "nothing to do" in capsys.readouterr().out


def test_as_root_it_runs_nothing_of_the_users(tmp_path: Path) -> None:
    """Neither modules beside it, nor what PYTHONPATH or the checkout's environment bring."""
    (tmp_path / "argparse.py").write_text("raise SystemExit('not this one')\n")
    (tmp_path / "sitecustomize.py").write_text("raise SystemExit('nor this')\n")
    done = subprocess.run(
        [Path(setup_testbed.__file__).with_name("setup-testbed"), "--help"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "--dry-run" in done.stdout


def test_files_of_others_are_not_touched(system: SimpleNamespace) -> None:
    (system.root / RULES).parent.mkdir(parents=True)
    (system.root / RULES).write_text("# mine\n")
    with pytest.raises(SystemExit, match="this script did not write"):
        system.call("--yes", f"--user={ME}")
    assert (system.root / RULES).read_text() == "# mine\n" and not system.done


def test_without_a_terminal_nothing_is_changed(
    system: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: False))
    with pytest.raises(SystemExit, match="no terminal for a question"):
        system.call(f"--user={ME}")
    assert not system.done


def test_only_root_changes_anything(
    system: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    with pytest.raises(SystemExit, match="sudo"):
        system.call("--yes", f"--user={ME}")
    assert not system.done
