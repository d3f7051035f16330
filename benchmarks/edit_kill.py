"""Edits of datasets whose process is killed with SIGKILL at random moments.

    python -m benchmarks edit_kill --kills 200 [--lerobot PYTHON]

A process keeps or removes episodes, merges, splits, or exports to CSV, and is killed at a random
moment of it, until so many were killed before their end. Then the sources are compared byte by byte
with what they were, and each target has to be absent or complete: equal, byte by byte, to that of
an edit that nobody killed. After each fifth one the same edit is made to its end beside what the
kill has left. Half of the edits are of datasets with images. What the edits write is also read by
LeRobot, if it is installed in the environment of PYTHON.
"""

from __future__ import annotations

import hashlib
import itertools
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from benchmarks.record_kill import BLIND, SEEING, LeRobot, recorded, steps

if TYPE_CHECKING:
    from benchmarks.session import Session

EPISODES = 6
"""Episodes of a source."""
KILLS_PER_EDIT_TO_THE_END = 5
LATEST = 1.0
"""Latest moment of a kill, as a share of the time that the edit takes."""


def _keep(sources: Sequence[Path], targets: Sequence[Path]) -> None:
    from bricksrl.data.edit import select
    from bricksrl.data.selection import Selection

    select(sources[0], targets[0], Selection(episodes="0-2,5"))


def _remove(sources: Sequence[Path], targets: Sequence[Path]) -> None:
    from bricksrl.data.edit import select
    from bricksrl.data.selection import Selection

    select(sources[0], targets[0], Selection(return_min=60.0), keep=False)


def _merge(sources: Sequence[Path], targets: Sequence[Path]) -> None:
    from bricksrl.data.edit import merge

    merge(sources, targets[0])


def _split(sources: Sequence[Path], targets: Sequence[Path]) -> None:
    from bricksrl.data.edit import split

    split(sources[0], targets[0], targets[1], 0.5, 0)


def _export(sources: Sequence[Path], targets: Sequence[Path]) -> None:
    from bricksrl.data.csv_files import export_csv

    export_csv(sources[0], targets[0])


@dataclass(frozen=True)
class Edit:
    """An edit of two sources, and the names of what it writes."""

    make: Callable[[Sequence[Path], Sequence[Path]], None]
    targets: tuple[str, ...]


EDITS = {
    "keep": Edit(_keep, ("kept",)),
    "remove": Edit(_remove, ("rest",)),
    "merge": Edit(_merge, ("joined",)),
    "split": Edit(_split, ("first", "second")),
    "csv_file": Edit(_export, ("data.csv",)),
    "csv_folder": Edit(_export, ("tables",)),
}


def record(root: Path, kind: str, first: int) -> Path:
    """Record a source, whose episodes begin with this number."""
    from bricksrl.data import About
    from bricksrl.data.recorder import Recorder

    description = {"blind": BLIND, "seeing": SEEING}[kind]
    with Recorder(root, description) as recorder:
        for number in range(first, first + EPISODES):
            recorder.write(steps(number, description.image_px), About(policy="known"))
    return root


def content(path: Path) -> str:
    """Digest of a file, or of all files in a folder with their names; empty if there is none."""
    if not path.exists():
        return ""
    files = [path]
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
    digest = hashlib.sha256()
    for file in files:
        digest.update(f"{file.relative_to(path)}\n".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


class Editor:
    """A process that forks another for each edit, so that none has to import anything first."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", "benchmarks.edit_kill"]
        self._process = subprocess.Popen(  # noqa: S603  our own file
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[1],
        )
        self._answer()

    def __enter__(self) -> Editor:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.communicate(timeout=30)

    def edit(
        self,
        name: str,
        sources: Sequence[Path],
        targets: Sequence[Path],
        kill_s: float | None = None,
    ) -> bool:
        """Make an edit, killed after some seconds; returns whether it was. Raises RuntimeError if
        it fails."""
        assert self._process.stdin is not None
        words = [name, str(len(sources)), *map(str, sources), *map(str, targets)]
        self._process.stdin.write("\t".join(words) + "\n")
        self._process.stdin.flush()
        pid = int(self._answer())
        if kill_s is not None:
            time.sleep(kill_s)
            # It is not waited for until it is asked, so that its number is still its own.
            os.kill(pid, signal.SIGKILL)
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        code = int(self._answer())
        if code not in (0, -signal.SIGKILL):
            raise RuntimeError(f"the edit {name} failed; its output is above")
        return code != 0

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError("the editing process ended; its output is above")
        return line.strip()


def serve() -> None:
    """The process of an `Editor`."""
    import bricksrl.data.csv_files
    import bricksrl.data.edit  # noqa: F401

    print("ready", flush=True)
    while line := sys.stdin.readline().rstrip("\n"):
        name, count, *words = line.split("\t")
        paths = [Path(word) for word in words]
        pid = os.fork()
        if not pid:
            code = 1
            try:
                EDITS[name].make(paths[: int(count)], paths[int(count) :])
                code = 0
            except Exception:  # noqa: BLE001  shown, and told by the code
                traceback.print_exc()
            finally:
                os._exit(code)
        print(pid, flush=True)
        sys.stdin.readline()
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def expected(
    editor: Editor, sources: Sequence[Path], folder: Path
) -> dict[str, tuple[float, list[str]]]:
    """Of each edit that nobody kills: the time that it takes (s), and the targets' content."""
    folder.mkdir()
    made = {}
    for name, edit in EDITS.items():
        targets = [folder / target for target in edit.targets]
        started_s = time.perf_counter()
        editor.edit(name, sources, targets)
        made[name] = (time.perf_counter() - started_s, [content(target) for target in targets])
    return made


READ_BY_LEROBOT = {
    "kept": [0, 1, 2, 5],
    "rest": [0, 1, 2],
    "joined": list(range(2 * EPISODES)),
}
"""Numbers of the episodes in what the edits write; those of a split are drawn."""


def read_by_lerobot(lerobot: LeRobot, whole: Path, side: int) -> bool:
    """Whether LeRobot reads all that the edits wrote into a folder, each episode as it was
    recorded, with images of so many pixels."""
    found = []
    for name, numbers in READ_BY_LEROBOT.items():
        wanted = [recorded(number, side) for number in numbers]
        found.append(lerobot.read(whole / name) == wanted)
    parts: list[dict[str, str]] = []
    for name in EDITS["split"].targets:
        parts += lerobot.read(whole / name) or []
    rewards = sorted(episode["next.reward"] for episode in parts)
    wanted = [recorded(number, side) for number in range(EPISODES)]
    found.append(rewards == sorted(episode["next.reward"] for episode in wanted))
    found.append(all(episode in wanted for episode in parts))
    return all(found)


def measure(kills: int, seed: int, lerobot: LeRobot | None) -> dict[str, Any]:
    """Results of so many edits that were killed before their end, at moments drawn from
    ``seed``."""
    rng = random.Random(seed)
    counts: Counter[str] = Counter()
    read: dict[str, bool] = {}
    kills_of: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as root, Editor() as editor:
        kinds = {}
        for kind in ("blind", "seeing"):
            sources = [
                record(Path(root) / f"{kind}-{number}", kind, number * EPISODES)
                for number in range(2)
            ]
            whole = expected(editor, sources, Path(root) / f"{kind}-whole")
            if lerobot is not None:
                side = {"blind": BLIND, "seeing": SEEING}[kind].image_px
                read[kind] = read_by_lerobot(lerobot, Path(root) / f"{kind}-whole", side)
            kinds[kind] = (sources, [content(source) for source in sources], whole)
        names = list(EDITS)
        for kill in itertools.count():
            if counts["killed_before_the_end"] == kills:
                break
            name = names[kill % len(names)]
            sources, before, whole = kinds[("blind", "seeing")[kill // len(names) % 2]]
            duration_s, wanted = whole[name]
            folder = Path(root) / f"kill-{kill}"
            folder.mkdir()
            targets = [folder / target for target in EDITS[name].targets]
            is_killed = editor.edit(
                name, sources, targets, kill_s=rng.uniform(0.0, LATEST * duration_s)
            )
            kills_of[name] += is_killed
            counts["edits"] += 1
            _look(counts, targets, wanted, folder, is_killed=is_killed)
            counts["sources_changed"] += [content(source) for source in sources] != before
            if kill % KILLS_PER_EDIT_TO_THE_END:
                continue
            again = [folder / f"again-{target.name}" for target in targets]
            editor.edit(name, sources, again)
            counts["edits_to_the_end_afterwards"] += 1
            counts["of_them_as_wanted"] += [content(path) for path in again] == wanted
    keys = (
        "edits",
        "killed_before_the_end",
        "with_a_remnant",
        "targets_absent",
        "targets_complete",
        "targets_damaged",
        "only_one_of_two_parts",
        "sources_changed",
        "edits_to_the_end_afterwards",
        "of_them_as_wanted",
    )
    result: dict[str, Any] = {key: counts[key] for key in keys}
    if lerobot is not None:
        said = {"read_whole": read, "errors": lerobot.errors, "versions": lerobot.versions}
        result = {**result, "lerobot": said}
    return {"seed": seed, **result, "killed_edits": dict(kills_of)}


def _look(
    counts: Counter[str],
    targets: Sequence[Path],
    wanted: Sequence[str],
    folder: Path,
    *,
    is_killed: bool,
) -> None:
    """Count what a kill has left."""
    found = [content(target) for target in targets]
    for have, want in zip(found, wanted, strict=True):
        counts["targets_absent"] += have == ""
        counts["targets_complete"] += have == want
        counts["targets_damaged"] += have not in ("", want)
    counts["killed_before_the_end"] += is_killed
    counts["with_a_remnant"] += any(path not in targets for path in folder.iterdir())
    counts["only_one_of_two_parts"] += any(found) and not all(found)


def main(session: Session) -> None:
    """Run from the command line."""
    session.parser.add_argument(
        "--lerobot", metavar="PYTHON", help="the Python of an environment that has LeRobot"
    )
    args = session.parse(kills=200, seed=0)
    with LeRobot(args.lerobot) if args.lerobot else nullcontext() as lerobot:
        result = measure(args.kills, args.seed, lerobot)
    print(result)
    session.write(result)


if __name__ == "__main__":
    serve()
