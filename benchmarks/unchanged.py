"""Results that a change of the code has not moved.

    python -m benchmarks unchanged gait balance

The quick form of a benchmark runs twice as the code is now, and once as it was at the commit of the
result. Numbers in which runs of the same code differ are times, or rest on them, and are left out;
all others, at least ten, must be those of then to the last digit. Where some are not, both run once
more, and a third time, as a rounded time may be the same twice. A result of which that holds is not
older than its code (`age`), until the code changes again; so a mended word or a refusal that no run
meets does not cost hours. What differs is printed. Exit code 1 if anything did.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.age import History, benchmark_of, checkout
from benchmarks.provenance import ROOT, working_tree
from benchmarks.registry import BENCHMARKS
from benchmarks.session import RESULTS, Session, read_result
from brickhub.errors import BricksError, DescriptionError
from bricksrl.errors import RunError

LEAST = 10
"""Numbers that have to be there: fewer say nothing."""
RUNS = 4
"""Runs of the code of now, at most."""
_NOT_MEASURED = ("machine", "versions", "code")


@dataclass(frozen=True)
class Comparison:
    """What two versions of the code measure.

    Attributes:
        same: how many numbers are equal.
        moved: names of those that are not, with both values.
    """

    same: int
    moved: tuple[str, ...]

    @property
    def is_unchanged(self) -> bool:
        """Whether all numbers are equal, and enough of them."""
        return not self.moved and self.same >= LEAST


def numbers(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """All numbers in a result, by their places in it."""
    match value:
        case dict():
            for key, inner in value.items():
                yield from numbers(inner, f"{name}.{key}" if name else str(key))
        case list():
            for place, inner in enumerate(value):
                yield from numbers(inner, f"{name}[{place}]")
        case int() | float():
            yield name, value


def compared(
    thens: Sequence[Mapping[str, Any]],
    nows: Sequence[Mapping[str, Any]],
) -> Comparison:
    """Comparison of results of then with those of now."""
    before, after = _fixed(thens), _fixed(nows)
    # What one version alone has is no time that varies.
    lost = _names(thens) ^ _names(nows)
    same = [name for name in before if name in after and before[name] == after[name]]
    moved = [
        f"{name}: {before[name]} then, {after[name]} now"
        for name in before
        if name in after and before[name] != after[name]
    ]
    return Comparison(len(same), (*moved, *(f"{name}: in one alone" for name in sorted(lost))))


def _measured(result: Mapping[str, Any]) -> dict[str, Any]:
    return {key: result[key] for key in result if key not in _NOT_MEASURED}


def _fixed(results: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Numbers that are the same in all results."""
    first, *others = [dict(numbers(_measured(one))) for one in results]
    return {
        name: value
        for name, value in first.items()
        if all(other.get(name) == value for other in others)
    }


def _names(results: Sequence[Mapping[str, Any]]) -> set[str]:
    return {name for one in results for name, _ in numbers(_measured(one))}


def quick_result(tree: Path, name: str, folder: Path) -> dict[str, Any]:
    """Result of the quick form of a benchmark with the code of a tree. Raises RunError if it
    fails."""
    paths = [tree, *tree.glob("packages/*/src")]
    done = subprocess.run(  # noqa: S603  our own command
        [sys.executable, "-m", "benchmarks", name, "--quick", "--folder", str(folder)],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    path = folder / "study.json"
    if done.returncode or not path.exists():
        said = (done.stderr or done.stdout).strip().splitlines()
        raise RunError(f"{name} does not run in {tree} ({said[-1] if said else 'no word'})")
    return read_result(path)


def compare(result: str, commit: str) -> Comparison:
    """Comparison of a published result's benchmark at a commit with that of now."""
    name = benchmark_of(result)
    assert name is not None
    with tempfile.TemporaryDirectory(prefix="unchanged-") as folder:
        tree = Path(folder) / "then"
        checkout(commit, tree)
        thens = [quick_result(tree, name, Path(folder) / "then_0")]
        nows = [quick_result(ROOT, name, Path(folder) / f"now_{run}") for run in range(2)]
        found = compared(thens, nows)
        for run in range(2, RUNS):
            if not found.moved:
                break
            thens.append(quick_result(tree, name, Path(folder) / f"then_{run}"))
            nows.append(quick_result(ROOT, name, Path(folder) / f"now_{run}"))
            found = compared(thens, nows)
    return found


def main(session: Session) -> int:
    """Compare, and keep what is unchanged."""
    session.parser.add_argument("results", nargs="+", metavar="RESULT")
    args = session.parse()
    history, tree = History(), working_tree()
    known: dict[str, Any] = session.known().get("results", {})
    code = 0
    for result in args.results:
        path = RESULTS / f"{result}.json"
        name = benchmark_of(result)
        if name is None or not path.exists():
            raise DescriptionError(f"there is no result '{result}' in {RESULTS}")
        module = f"benchmarks.{BENCHMARKS[name].module}"
        known.pop(result, None)
        try:
            commit = history.measured_at(path, module)
            found = compare(result, commit)
        except BricksError as error:
            print(f"{result}: {error}", flush=True)
            code = 1
            continue
        for one in found.moved[:5]:
            print(f"  {one}")
        print(f"{result}: {found.same} the same, {len(found.moved)} moved", flush=True)
        if not found.is_unchanged:
            code = 1
            continue
        known[result] = {
            "commit": commit[:12],
            "digest": tree.digest(module),
            "numbers": found.same,
        }
        session.write({"results": known})
    session.write({"results": known})
    return code
