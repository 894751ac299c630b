"""Makes docs/examples/first-hour.ipynb from the first five steps of docs/tutorial.md.

    .venv/bin/python -m scripts.notebook

Text becomes a cell of text, each run on the simulated servo a cell that runs it from Python. Cells
are executed only where one of them has changed.
"""

from __future__ import annotations

import json
import re
import shlex
import sys
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parent.parent
PAGE: Final = ROOT / "docs" / "tutorial.md"
NOTEBOOK: Final = ROOT / "docs" / "examples" / "first-hour.ipynb"
STEPS: Final = 5
_BLOCK: Final = re.compile(r"^```(\w+)\n(.*?)^```\n", re.M | re.S)
_TIMEOUT_S: Final = 120

_INTRODUCTION: Final = """\
# The first hour

The first five steps of [the tutorial](../tutorial.md) from Python, without any hardware: a wall,
one that is too stiff, the guard, damping and delay, detents. It needs `haptic-wall` and a notebook.
Every run is on the simulated clock: it is the same on any machine.
"""
_SHOW: Final = '''\
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import haptic_wall

%matplotlib inline


def show(changes):
    """Run a wall on the simulated servo, say what came of it, and draw it."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.hwlog"
        changes = {"loop.clock": "simulated", **changes}
        with haptic_wall.run("simulated", changes, duration_s=5.0, log=log) as wall:
            report = wall.wait()
        rows = haptic_wall.read_log(log).rows
    asked, given = (report["guard"][key]["stiffness"] for key in ("requested", "commanded"))
    print(f"ended by {report['stop_reason']}; oscillation {report['oscillation']['state']}")
    print(f"stiffness {given:.4g} N·m/rad of {asked:.4g} asked")
    for reason in report["guard"]["reasons"]:
        print("why:", reason)
    _, (above, below) = plt.subplots(2, sharex=True, figsize=(6, 2.6), dpi=60)
    above.plot(rows["time_s"], rows["position_rad"], lw=1)
    below.plot(rows["time_s"], rows["torque_nm"], lw=1, color="tab:orange")
    above.set_ylabel("position\\n[rad]")
    below.set_ylabel("torque\\n[N·m]")
    below.set_xlabel("time [s]")
    plt.show()
'''


def cells() -> list[tuple[str, str]]:
    """Return kind (``markdown``, ``code``) and text of each cell, as the tutorial has them now."""
    found = [("markdown", _INTRODUCTION), ("code", _SHOW)]
    parts = re.split(r"^(?=## \d)", PAGE.read_text(encoding="utf-8"), flags=re.M)[1 : STEPS + 1]
    for part in parts:
        text = re.sub(r"<!--.*?-->\n?", "", part, flags=re.S)
        end = 0
        for block in _BLOCK.finditer(text):
            found += _text(text[end : block.start()])
            end = block.end()
            if block[1] == "sh":
                for line in block[2].splitlines():
                    cell = _run(line)
                    found.append(("code", cell) if cell else ("markdown", block[0]))
        found += _text(text[end:])
    return found


def _text(text: str) -> Iterator[tuple[str, str]]:
    if text.strip():
        linked = re.sub(r"\]\((?![a-z]+:|#)", "](../", text.strip())
        yield "markdown", f"{linked}\n"


def _run(line: str) -> str | None:
    """Return the cell of a run on the simulated servo; None: it needs a terminal."""
    words = shlex.split(line)
    if words[:3] != ["haptic-wall", "run", "simulated"] or "--live" in words:
        return None
    sets = [b.partition("=")[::2] for a, b in pairwise(words) if a == "--set"]
    values = {path: _value(text) for path, text in sets if path != "loop.clock"}
    lines = [f"    {json.dumps(path)}: {value},\n" for path, value in values.items()]
    return f"show({{\n{''.join(lines)}}})\n" if lines else "show({})\n"


def _value(text: str) -> str:
    try:
        float(text)
    except ValueError:
        return json.dumps(text)
    return text


def held() -> list[dict[str, Any]]:
    """Return the cells of the notebook; none where there is no notebook."""
    if not NOTEBOOK.exists():
        return []
    found: list[dict[str, Any]] = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    return found


def source(cell: Mapping[str, Any]) -> str:
    """Return the text of a cell, which a file holds in lines."""
    return "".join(cell["source"])


def executed() -> list[list[dict[str, Any]]]:
    """Run the code cells in a fresh kernel; return what each printed and drew."""
    import nbformat.v4
    from nbclient import NotebookClient

    new: Any = nbformat.v4
    code = [text for kind, text in cells() if kind == "code"]
    node = new.new_notebook(cells=[new.new_code_cell(text) for text in code])
    NotebookClient(node, timeout=_TIMEOUT_S, kernel_name="python3").execute()
    found = json.loads(new.writes(node))["cells"]
    return [
        [_output(each) for each in cell["outputs"] if each.get("name") != "stderr"]
        for cell in found
    ]


def _output(output: dict[str, Any]) -> dict[str, Any]:
    if "data" in output:
        output["data"] = {"image/png": "".join(output["data"]["image/png"])}
    return output


def written() -> str:
    """Return the notebook as the tutorial has it; executed if any of its code is new."""
    made = cells()
    old = [cell for cell in held() if cell["cell_type"] == "code"]
    code = [text for kind, text in made if kind == "code"]
    same = [source(cell) for cell in old] == code
    outputs = iter([cell["outputs"] for cell in old] if same else executed())
    found = []
    for n, (kind, text) in enumerate(made):
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{n}", "metadata": {}}
        if kind == "code":
            cell |= {"execution_count": None, "outputs": next(outputs)}
        found.append(cell | {"source": text.splitlines(keepends=True)})
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook = {
        "cells": found,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"


def main() -> int:
    """Write the notebook; return the exit status."""
    try:
        text = written()
    except ImportError as error:
        print(f"found no {error.name}; wanted to run new cells: pip install -e '.[docs]'")
        return 2
    NOTEBOOK.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
