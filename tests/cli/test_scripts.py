"""scripts/run and scripts/test make what is missing, once, and then get out of the way.

They run here in a copy of the project with a Python that only writes down what it is asked.
"""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ["sh", "basename", "dirname", "readlink", "cat", "cksum", "flock", "grep", "head", "mkdir"]
TOOLS += ["chmod", "ln", "mktemp", "rm", "sleep"]

# Makes a virtual environment that holds itself and the commands; notes every installation.
PYTHON = """#!/bin/sh
case "$*" in
*ensurepip*) [ -z "$NO_ENSUREPIP" ] ;;
*version_info\\[*|*version_info*%*) echo 3.11 ;;
"--version") echo Python 3.11.0 ;;
*"-m venv"*)
    echo venv >>"$NOTES"
    for last; do :; done
    mkdir -p "$last/bin"
    echo "VIRTUAL_ENV=$last" >"$last/bin/activate"
    cat "$0" >"$last/bin/python"
    for command in haptic-wall ruff mypy pytest; do
        printf '#!/bin/sh\\necho %s "$@"\\n[ %s != "$FAILING" ]\\n' $command $command \
            >"$last/bin/$command"
    done
    chmod +x "$last/bin/"* ;;
*"-m pip install"*)
    sleep 0.1
    for last; do :; done
    echo "pip ${last##*/}" >>"$NOTES"
    echo noise
    [ -z "$NO_NETWORK" ] ;;
esac
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of the scripts in a folder whose name has a space, and a PATH with little on it."""
    folder = tmp_path / "my project"
    shutil.copytree(ROOT / "scripts", folder / "scripts")
    shutil.copy(ROOT / "pyproject.toml", folder)
    tools = tmp_path / "tools"
    tools.mkdir()
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found is not None
        (tools / tool).symlink_to(found)
    return folder


def install_python(project: Path) -> None:
    python = project.parent / "tools" / "python3.11"
    python.write_text(PYTHON)
    python.chmod(0o755)


def environment(project: Path, **more: str) -> dict[str, str]:
    notes = project.parent / "notes"
    return {"PATH": str(project.parent / "tools"), "NOTES": str(notes), "FAILING": ""} | more


def call(
    project: Path, script: str, *arguments: str, **more: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [project / "scripts" / script, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd="/",
        env=environment(project, **more),
    )


def notes(project: Path) -> list[str]:
    path = project.parent / "notes"
    return path.read_text().splitlines() if path.exists() else []


def test_a_fresh_machine_needs_one_command_and_the_second_time_nothing(project: Path) -> None:
    install_python(project)
    first = call(project, "run", "--duration", "1 s")
    assert (first.returncode, first.stdout) == (0, "haptic-wall run --duration 1 s\n")
    assert "noise" in first.stderr
    assert notes(project) == ["venv", "pip my project"]
    second = call(project, "run")
    assert (second.stdout, second.stderr) == ("haptic-wall run\n", "")
    assert notes(project) == ["venv", "pip my project"]


def test_the_test_script_runs_every_check_and_fails_if_one_does(project: Path) -> None:
    install_python(project)
    done = call(project, "test", "--whole", FAILING="mypy")
    assert done.stdout.splitlines() == [
        "ruff check",
        "ruff format --check",
        "pytest -n auto --dist worksteal --whole",
        "mypy -p haptic_wall -p scripts -p tests",
    ]
    assert done.returncode == 1
    named = call(project, "test", "tests/hw", "-k", "wall")
    assert named.stdout == "pytest -n auto --dist worksteal tests/hw -k wall\n"
    assert call(project, "test").returncode == 0
    assert call(project, "test", FAILING="pytest").returncode == 1


def test_without_python_it_says_what_to_install(project: Path) -> None:
    done = call(project, "run")
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("run: found no Python 3.11 or newer on PATH: install one")


# .ci/run, with a suite that only looks where it is
