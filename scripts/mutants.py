"""Puts small defects into guard, detector, tick, codec, exchange and safety, and runs their tests.

    scripts/study mutants [--sample N] [--seed S] [--role ROLE ...] [--out FILE] [--like FILE]
    scripts/study mutants --compare BEFORE.json AFTER.json

A defect that no test notices survives: a test is missing, or the defect changes nothing. Nothing is
done in place: each defect is put into a copy of the project in a temporary folder. A defect is
tried on the tests that run its statement, quickest first. These are found by a first run of the
test files that import a module of a role asked for, directly or through a helper, in a copy
that notes which statements run; what waits for real processes is left out.

The result of each defect is written at once, so a run that was cut off goes on where it stopped.
The first N of a larger sample of the same seed are the same as those of a smaller one. To check a
restructuring, run the sample before it, run ``--like BEFORE.json`` after it, and compare.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar

from scripts.imported import imported
from scripts.mutant_kinds import ROLES, Mutant, all_mutants, modules_of, mutated, watched

ROOT = Path(__file__).resolve().parent.parent
WORKER = Path(__file__).with_name("mutant_worker.py")
OUT = ROOT / "runs" / "mutants.json"
OUTCOMES = ("killed", "timeout", "survived", "untested")
NOTICED = ("killed", "timeout")
LEAST_S = 10.0
"""Processor time that any mutant may take, beyond three times what its tests take [s]"""
IDLE_S = 60.0
"""Longest time that the tests of a mutant may sleep [s]"""
FILE_S = 100.0
"""Processor time that a test file may take [s]; longer ones are left out"""
_LEFT_OUT = (".git", ".venv", "runs", "__pycache__", ".*_cache", "*.egg-info", "*.png")
Result = dict[str, Any]
"""A mutant's fields, ``outcome``, ``becomes`` (its line), ``killer`` (a test), ``tests`` (their
number), ``seconds`` and ``cpu_s`` (what it took)"""
Reached = dict[str, dict[str, float]]
"""Processor time of each test that runs a statement, by statement (path#number, or path alone)"""


def sample(found: Iterable[Mutant], count: int, seed: int) -> list[Mutant]:
    """Draw mutants, as many from each role as far as there are so many.

    The rank of a mutant depends on the seed and its own id alone.
    """
    queues: dict[str, list[Mutant]] = {role: [] for role in ROLES}
    for one in found:
        queues[one.role].append(one)
    for waiting in queues.values():
        waiting.sort(key=lambda one: hashlib.sha256(f"{seed} {one.id}".encode()).digest())
    drawn: list[Mutant] = []
    while len(drawn) < count and any(queues.values()):
        for waiting in queues.values():
            if waiting and len(drawn) < count:
                drawn.append(waiting.pop(0))
    return drawn


def _files_imported(path: Path, root: Path) -> set[str]:
    """Files of the project that a file imports, as paths from its folder."""
    found: set[str] = set()
    for name in imported(path):
        at = name.replace(".", "/")
        found.update(end for end in (f"{at}.py", f"{at}/__init__.py") if (root / end).is_file())
    return found


def imports_of_tests(root: Path) -> dict[str, set[str]]:
    """Files of the project that each file of the tests imports."""
    files = sorted(root.glob("tests/**/*.py"))
    return {str(path.relative_to(root)): _files_imported(path, root) for path in files}


def files_for(role: str, root: Path, imports: Mapping[str, set[str]]) -> list[str]:
    """Test files that import a module of a role, directly or through a helper of the tests.

    Args:
        role: The role.
        root: The folder of the project.
        imports: As from ``imports_of_tests``.
    """
    wanted = {str(path.relative_to(root)) for path in modules_of(root, role)}
    reach = {name for name, own in imports.items() if own & wanted}
    while more := {name for name, own in imports.items() if own & reach} - reach:
        reach |= more
    return [name for name in imports if name in reach and Path(name).name.startswith("test_")]


class Workers:
    """Processes that run tests, each on a copy of the project of its own."""

    def __init__(self, count: int, root: Path, folder: Path) -> None:
        self._trees = []
        for number in range(count):
            tree = folder / f"tree-{number}"
            shutil.copytree(root, tree, symlinks=True, ignore=shutil.ignore_patterns(*_LEFT_OUT))
            (tree / ".git").mkdir()  # pictures and logs are looked for no higher
            self._trees.append(tree)
        self._processes = [self._begun() for _ in range(count)]

    def _begun(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, WORKER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )

    def do(self, jobs: Iterable[Callable[[Path, Callable[..., Result]], None]]) -> None:
        """Do all jobs; each is given a tree, and what runs tests in it."""
        waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
        for job in jobs:
            waiting.put(job)

        def work(tree: Path, process: subprocess.Popen[str]) -> None:
            def run(tests: Sequence[str], cpu_s: float, *, stop: bool = True) -> Result:
                assert process.stdin is not None and process.stdout is not None
                job = {"tree": str(tree), "paths": import_paths(tree), "tests": tests}
                limits = {"cpu_s": cpu_s, "idle_s": IDLE_S, "all": not stop}
                process.stdin.write(json.dumps(job | limits) + "\n")
                process.stdin.flush()
                answer: Result = json.loads(process.stdout.readline())
                return answer

            while True:
                try:
                    job = waiting.get_nowait()
                except queue.Empty:
                    return
                job(tree, run)

        threads = [
            threading.Thread(target=work, args=pair, daemon=True)
            for pair in zip(self._trees, self._processes, strict=True)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()

    def restore(self, root: Path, paths: Iterable[str]) -> None:
        """Make files of all copies those of the project again."""
        for tree in self._trees:
            for path in paths:
                shutil.copy2(root / path, tree / path)

    def close(self) -> None:
        """End the processes."""
        for process in self._processes:
            process.kill()
            process.communicate()


def import_paths(tree: Path) -> list[str]:
    """Entries that an editable install would add to sys.path."""
    project = tomllib.loads((tree / "pyproject.toml").read_text("utf-8"))
    folders = project["tool"]["hatch"]["build"].get("dev-mode-dirs", [])
    return [str(tree), *(str(tree / folder) for folder in folders if folder != ".")]


class _Changed:
    """A file that has another text for a while.

    Python takes compiled code for current that was made from a file of the same size and second,
    so each text gets a time of its own.
    """

    _lock = threading.Lock()
    _times: ClassVar[Counter[str]] = Counter()

    def __init__(self, path: Path, text: str) -> None:
        self._path = path
        self._text = text

    def __enter__(self) -> None:
        self._before = self._path.read_bytes()
        self._time = self._path.stat().st_mtime
        with self._lock:
            self._times[str(self._path)] += 2
            later = self._times[str(self._path)]
        self._path.write_text(self._text, "utf-8")
        os.utime(self._path, (self._time + later, self._time + later))

    def __exit__(self, *_: object) -> None:
        self._path.write_bytes(self._before)
        os.utime(self._path, (self._time, self._time))


def sources_of(root: Path) -> dict[str, str]:
    """Texts of the modules of all roles, by their paths from the folder of the project."""
    paths = [path for role in ROLES for path in modules_of(root, role)]
    return {str(path.relative_to(root)): path.read_text("utf-8") for path in paths}


def reached(
    workers: Workers, root: Path, roles: Sequence[str], known: Path, say: Callable[[str], None]
) -> Reached:
    """Run the test files of some roles, and note which test runs which statement.

    Tests that fail without any mutant are left out, and told.

    Args:
        workers: The processes that run the tests.
        root: The folder of the project.
        roles: The roles.
        known: A file with what was noted before; files of tests that are there, and have not
            changed with what they import of the tests, nor any module of a role, are not run again.
        say: Called with what is done.
    """
    sources, imports = sources_of(root), imports_of_tests(root)
    files = sorted({name for role in roles for name in files_for(role, root, imports)})
    stamps = {name: _stamp(name, root, imports, sources) for name in files}
    noted = json.loads(known.read_text("utf-8")) if known.exists() else {}
    missing = [name for name in files if noted.get(name, {}).get("stamp") != stamps[name]]
    lock, left = threading.Lock(), len(missing)

    def job_for(name: str) -> Callable[[Path, Callable[..., Result]], None]:
        def job(tree: Path, run: Callable[..., Result]) -> None:
            nonlocal left
            for path, source in sources.items():
                target = tree / path
                if "_mutant_hit" not in target.read_text("utf-8"):
                    later = target.stat().st_mtime + 1
                    target.write_text(watched(path, source), "utf-8")
                    os.utime(target, (later, later))
            answer = run([name], FILE_S, stop=False)
            tests = {
                test: facts
                for test, facts in answer["tests"].items()
                if test not in answer["failed"] and facts["hits"]
            }
            with lock:
                left -= 1
                say(f"{name}: {answer['outcome']}, {len(answer['tests'])} tests, {left} files left")
                for test in answer["failed"]:
                    say(f"  fails without a mutant: {test}")
                noted[name] = {"stamp": stamps[name], "tests": tests}
                known.parent.mkdir(parents=True, exist_ok=True)
                known.write_text(json.dumps(noted), "utf-8")

        return job

    if missing:
        workers.do(map(job_for, missing))
        workers.restore(root, sources)
    found: Reached = defaultdict(dict)
    for name in files:
        for test, facts in noted[name]["tests"].items():
            for place in {*facts["hits"], *(hit.split("#")[0] for hit in facts["hits"])}:
                found[place][test] = facts["seconds"]
    return dict(found)


def _stamp(
    name: str, root: Path, imports: Mapping[str, set[str]], sources: Mapping[str, str]
) -> str:
    """Changes where a file of tests changes, a helper of it, or a module of any role."""
    own = {name}
    while more := {part for one in own for part in imports[one] if part in imports} - own:
        own |= more
    texts = [*sources.values(), *((root / part).read_text("utf-8") for part in sorted(own))]
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:16]


def chosen(
    mutant: Mutant, found: Mapping[str, Mapping[str, float]], budget_s: float
) -> dict[str, float]:
    """Tests that run a mutant's statement, quickest first, as far as the budget goes.

    Args:
        mutant: The mutant; outside of functions, any test that runs its module counts.
        found: By statement.
        budget_s: Processor time of the tests in all, without a mutant [s].
    """
    place = mutant.path if mutant.statement < 0 else f"{mutant.path}#{mutant.statement}"
    picked: dict[str, float] = {}
    total = 0.0
    for test, seconds in sorted(found.get(place, {}).items(), key=lambda pair: (pair[1], pair[0])):
        total += seconds
        if picked and total > budget_s:
            break
        picked[test] = seconds
    return picked


def tried(
    mutant: Mutant, root: Path, tree: Path, tests: Mapping[str, float], run: Callable[..., Result]
) -> Result:
    """Try one mutant in a tree."""
    text, becomes = mutated((root / mutant.path).read_text("utf-8"), mutant.number)
    result: Result = {**asdict(mutant), "becomes": becomes, "tests": len(tests), "killer": ""}
    if not tests:
        return result | {"outcome": "untested", "seconds": 0.0, "cpu_s": 0.0}
    with _Changed(tree / mutant.path, text):
        answer = run(list(tests), LEAST_S + 3.0 * sum(tests.values()))
    outcome = {"passed": "survived", "failed": "killed"}.get(answer["outcome"], "timeout")
    killer = answer["failed"][0] if answer["failed"] else ""
    took = {name: answer[name] for name in ("seconds", "cpu_s")}
    return result | {"outcome": outcome, "killer": killer, **took}


def table(results: Iterable[Result]) -> Iterator[str]:
    """How many mutants of each role were noticed, line by line."""
    counts: dict[str, Counter[str]] = {role: Counter() for role in ROLES}
    for one in results:
        counts[one["role"]][one["outcome"]] += 1
    counts["all"] = sum(counts.values(), Counter())
    yield f"| {' | '.join(('role', 'mutants', *OUTCOMES, 'noticed'))} |"
    yield "|---" * (len(OUTCOMES) + 3) + "|"
    for role, own in counts.items():
        total = own.total()
        noticed = sum(own[outcome] for outcome in NOTICED)
        share = f"{noticed / total:.0%}" if total else ""
        cells = (role, total, *(own[outcome] for outcome in OUTCOMES), share)
        yield f"| {' | '.join(map(str, cells))} |"


def matches(
    before: Iterable[Result], after: Iterable[Result]
) -> Iterator[tuple[Result, Result | None]]:
    """Each mutant of before with the same one of after, or None.

    By id, where the mutated part is the same too; else by what it changes into what, where only one
    mutant of the role does so; else where only one mutant of any role does.
    """
    later = list(after)
    by_id = {one["id"]: one for one in later}
    by_text: dict[tuple[str, ...], list[Result]] = defaultdict(list)
    for one in later:
        text = (one["kind"], one["before"], one["within"])
        by_text[one["role"], *text].append(one)
        by_text["", *text].append(one)
    for one in before:
        text = (one["kind"], one["before"], one["within"])
        found = by_id.get(one["id"])
        if found is not None and found["before"] != one["before"]:
            found = None
        for key in ((one["role"], *text), ("", *text)):
            if found is None and len(by_text.get(key, ())) == 1:
                (found,) = by_text[key]
        yield one, found


def compared(before: Iterable[Result], after: Iterable[Result]) -> Iterator[str]:
    """Mutants that were noticed before and are not after, in words."""
    noticed = [one for one in before if one["outcome"] in NOTICED]
    for one, now in matches(noticed, after):
        change = f"{one['id']} ({one['within']!r} -> {one['becomes']!r})"
        if now is None:
            yield f"not tried after: {change}"
        elif now["outcome"] not in NOTICED:
            yield f"{now['outcome']} after: {change}, in {now['path']}:{now['line']}"


def load(path: Path) -> dict[str, Result]:
    """Results by id; none where there is no file."""
    if not path.exists():
        return {}
    results: list[Result] = json.loads(path.read_text("utf-8"))["results"]
    return {one["id"]: one for one in results}


def save(path: Path, results: Mapping[str, Result], facts: Mapping[str, object]) -> None:
    """Write results; the file is whole at every instant."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    lines = ",\n".join(json.dumps(one) for one in results.values())
    part.write_text(f'{{"about": {json.dumps(facts)}, "results": [\n{lines}\n]}}\n', "utf-8")
    part.replace(path)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/study mutants",
        description=(__doc__ or "").splitlines()[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = parser.add_argument
    add("--sample", type=int, default=500, metavar="N", help="number of defects to try")
    add("--seed", type=int, default=1, metavar="S", help="seed of their choice")
    add("--role", nargs="+", choices=ROLES, default=list(ROLES), help="parts of the program")
    add("--like", type=Path, metavar="FILE", help="try the defects that this result noticed")
    add("--out", type=Path, default=OUT, metavar="FILE", help="file to which results are added")
    add(
        "--budget",
        type=float,
        default=6.0,
        metavar="S",
        help="processor time of the tests of one mutant, without it [s]",
    )
    add("--workers", type=int, default=len(os.sched_getaffinity(0)), metavar="N")
    add(
        "--compare",
        nargs=2,
        type=Path,
        metavar=("BEFORE", "AFTER"),
        help="list mutants that were noticed before and not after; exit status 1 if there are any",
    )
    return parser.parse_args()


def _wanted(options: argparse.Namespace) -> list[Mutant]:
    found = [one for one in all_mutants(ROOT) if one.role in options.role]
    if options.like is None:
        return sample(found, options.sample, options.seed)
    before = [one for one in load(options.like).values() if one["outcome"] in NOTICED]
    by_id = {one.id: one for one in found}
    pairs = list(matches(before, map(asdict, found)))
    for one, now in pairs:
        if now is None:
            print(f"not found any more: {one['id']} ({one['within']!r})", file=sys.stderr)
    return [by_id[now["id"]] for _, now in pairs if now is not None]


def _say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def main() -> None:
    """Try mutants, or compare two results."""
    options = _options()
    if options.compare:
        lost = list(compared(*(load(path).values() for path in options.compare)))
        print("\n".join([*lost, f"{len(lost)} noticed before are not noticed after"]))
        sys.exit(1 if lost else 0)
    os.nice(15)
    wanted = _wanted(options)
    results = load(options.out)
    left = [
        one for one in wanted if one.id not in results or results[one.id]["before"] != one.before
    ]
    _say(f"{len(wanted)} mutants, {len(left)} of them not tried yet")
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        workers = Workers(options.workers, ROOT, Path(folder))
        try:
            if left:
                _try(left, results, workers, options)
        finally:
            workers.close()
    own = [results[one.id] for one in wanted if one.id in results]
    for one in own:
        if one["outcome"] not in NOTICED:
            print(
                f"{one['outcome']}: {one['path']}:{one['line']} {one['id']}: {one['within']}"
                f"  ->  {one['becomes']}"
            )
    print("\n".join(table(own)))
    print(f"processor time of the tests: {sum(one.get('cpu_s', 0.0) for one in own):.0f} s")


def _try(
    left: Sequence[Mutant],
    results: dict[str, Result],
    workers: Workers,
    options: argparse.Namespace,
) -> None:
    """Try mutants; each result is written as soon as it is there."""
    roles = sorted({one.role for one in left})
    known = options.out.with_suffix(".tests.json")
    found = reached(workers, ROOT, roles, known, _say)
    lock, count = threading.Lock(), 0

    def job_for(mutant: Mutant) -> Callable[[Path, Callable[..., Result]], None]:
        def job(tree: Path, run: Callable[..., Result]) -> None:
            nonlocal count
            one = tried(mutant, ROOT, tree, chosen(mutant, found, options.budget), run)
            with lock:
                count += 1
                results[mutant.id] = one
                save(options.out, results, {"seed": options.seed, "budget": options.budget})
                _say(f"{count}/{len(left)} {one['outcome']} {one['seconds']} s {mutant.id}")

        return job

    workers.do(map(job_for, left))


if __name__ == "__main__":
    main()
