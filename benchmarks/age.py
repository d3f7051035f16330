"""Age of the results: which are older than the code that they depend on.

    python -m benchmarks age

A result depends on its benchmark and on what this can reach of our modules, as `code.py` reads
them: words, comments and formatting do not count, nor does what it never calls. Results say the
digest of their code; those from before say it by the commit that they came with. What `unchanged`
has found to give the same numbers with the code of today is not older. What is older is printed in
the order in which people read it, with the time that it takes to make it again.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

from benchmarks.code import Code
from benchmarks.formatting import table
from benchmarks.provenance import ROOT, working_tree
from benchmarks.registry import BENCHMARKS
from benchmarks.session import RESULTS, Session, duration, read_result
from bricksrl.errors import RunError

READ_FIRST = ("robots", "paper", "gait", "race", "learning", "copies", "realtime_factor")
"""Benchmarks whose results the README and the first pages show."""


class History:
    """The code of earlier commits. Raises RunError without git."""

    def __init__(self) -> None:
        self._codes: dict[str, Code] = {}

    def of_file(self, path: Path) -> tuple[str, str, Code]:
        """Commit that a file was last written by, its day, and the code there."""
        said = _git("log", "-1", "--format=%H %cs", "--", str(path.relative_to(ROOT)))
        commit, _, day = said.strip().partition(" ")
        return commit, day, self.at(commit)

    def at(self, commit: str) -> Code:
        """The code at a commit."""
        if commit not in self._codes:
            self._codes[commit] = _code_at(commit)
        return self._codes[commit]

    def measured_at(self, path: Path, module: str) -> str:
        """Commit with the code that the result in a file was measured with. Raises RunError if
        none is known: it was measured before its code was committed."""
        came_with, _, _ = self.of_file(path)
        code = read_result(path).get("code")
        if code is None:
            return came_with
        commits: list[str] = [code["commit"], came_with]
        for commit in filter(None, commits):
            if self.at(commit).digest(module) == code["digest"]:
                return commit
        raise RunError(f"no commit has the code that {path.name} was measured with; make it again")


def _code_at(commit: str) -> Code:
    """The code at a commit."""
    blobs: dict[str, str] = {}
    for line in _git("ls-tree", "-r", commit).splitlines():
        about, _, path = line.partition("\t")
        blobs[path] = about.split()[2]

    def source(path: str) -> str | None:
        return _git("cat-file", "blob", blobs[path]) if path in blobs else None

    return Code(source, blobs)


def checkout(commit: str, folder: Path) -> None:
    """Write the files of a commit to a new folder. Raises RunError if git fails."""
    _git("clone", "--quiet", "--shared", "--no-checkout", str(ROOT), str(folder))
    _git("-C", str(folder), "checkout", "--quiet", "--detach", commit)


def _git(*words: str) -> str:
    """What a command of git says. Raises RunError if it fails."""
    done = subprocess.run(  # noqa: S603  the user's own git
        ["git", *words],  # noqa: S607
        cwd=ROOT,
        capture_output=True,
        text=True,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    if done.returncode:
        raise RunError(
            f"git does not say how old the results are ({done.stderr.strip()[:80]}); run this in "
            "a clone of the repository"
        )
    return done.stdout


def benchmark_of(result: str) -> str | None:
    """Name of the benchmark that a result, or a variant of one, comes from."""
    name = result.removeprefix("study_")
    # The longest name that it begins with: `link_faults` has variants of its own.
    fitting = [known for known in BENCHMARKS if name == known or name.startswith(f"{known}_")]
    return max(fitting, key=len, default=None)


def ages() -> dict[str, dict[str, Any]]:
    """For each published result ``commit``, ``day``, ``minutes``, ``is_older``, and whether its
    code has changed and its numbers have not (``is_unchanged``)."""
    now = working_tree()
    history = History()
    path = RESULTS / "unchanged.json"
    unchanged = read_result(path)["results"] if path.exists() else {}
    found: dict[str, dict[str, Any]] = {}
    for path in sorted(RESULTS.glob("*.json")):
        name = benchmark_of(path.stem)
        # These are results of all others, and of no code.
        if name is None or name in ("age", "unchanged"):
            continue
        benchmark = BENCHMARKS[name]
        module = f"benchmarks.{benchmark.module}"
        code = read_result(path).get("code")
        if code is None:
            commit, day, then = history.of_file(path)
            digest = then.digest(module)
        else:
            commit, day, digest = code["commit"], code["day"], code["digest"]
        today = now.digest(module)
        same = unchanged.get(path.stem, {})
        is_unchanged = digest != today and same.get("digest") == today
        found[path.stem] = {
            "commit": commit[:12],
            "day": day,
            "minutes": benchmark.minutes,
            "is_older": digest != today and not is_unchanged,
            "is_unchanged": is_unchanged,
        }
    return found


def _order(result: str) -> tuple[int, str]:
    """Place of a result among what is to be made again."""
    name = benchmark_of(result) or ""
    place = READ_FIRST.index(name) if name in READ_FIRST else len(READ_FIRST)
    return place, name


def main(session: Session) -> None:
    """Compare, and write what was found."""
    session.parse()
    found = ages()
    older = sorted((name for name in found if found[name]["is_older"]), key=_order)
    rows = [
        [name, found[name]["day"], found[name]["commit"], duration(found[name]["minutes"])]
        for name in older
    ]
    print(table(["older than its code", "day", "commit", "time to make it again"], rows))
    # A benchmark that has several results makes them in one run.
    again = {benchmark_of(name): found[name]["minutes"] for name in older}
    print(
        f"{len(older)} of {len(found)} results, {duration(round(sum(again.values())))} of two "
        "cores in all"
    )
    session.write({"results": found})
