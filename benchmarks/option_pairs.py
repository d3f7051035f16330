"""Pairs of options of `train`, `evaluate` and `record`: each pair is run for two episodes, in which
a link is lost.

The rows are a covering array: every two values of two options occur together in one of them. A row
may work, or be refused in one line; a traceback is a fault, and so is a run whose metrics and
dataset disagree. A row that is refused is cut down to the pair that is refused, and its other pairs
are tried in further rows.
"""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import os
import random
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.session import Session

Row = dict[str, str]
"""A value of each option."""
Pair = frozenset[tuple[str, str]]
"""Two options, each with a value; of what is refused also one, or more."""

_TASK = '''"""Runs away, in short; in each process one link is lost."""

from dataclasses import replace

from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.envs import get_task
from bricksrl.errors import HubError

if not hasattr(VirtualHub, "commands_sent"):
    write = VirtualHub.write

    def losing(hub, data):
        VirtualHub.commands_sent += data[1] != 0  # a frame with actions
        if VirtualHub.commands_sent == 5:
            VirtualHub.commands_sent += 1
            raise HubError("the connection was lost; bring the hub nearer")
        write(hub, data)

    VirtualHub.write = losing

VirtualHub.commands_sent = 0
TASK = replace(get_task("NAME"), id="Losing-v0", doc="In short.", max_steps=6)
'''
_TRANSFORM = """from torchrl.envs import RewardScaling


def transform(env):
    from torchrl.envs import TransformedEnv

    return TransformedEnv(env, RewardScaling(0.0, 0.5))
"""
_NONE = ""
_WORLDS = {"task": ["hub.py", "camera.py", "WalkerSim-v0"]}
_ENV = {
    "frame_skip": [_NONE, "--frame-skip 3"],
    "frame_stack": [_NONE, "--frame-stack 2"],
    "transform": [_NONE, "--transform mine.py"],
    "stream": [_NONE, "--streaming", "--app-data"],
    "physics": [_NONE, "--randomize", "--link bad-room"],
}
_SMALL = "--set hidden=8 --set batch_size=4 --set updates_per_step=0.5"
OPTIONS: dict[str, dict[str, list[str]]] = {
    "train": {
        **_WORLDS,
        **_ENV,
        "agent": [
            f"--agent sac {_SMALL}",
            f"--agent td3 {_SMALL}",
            f"--agent crossq {_SMALL}",
            "--agent ppo --set hidden=8",
            "--agent random",
        ],
        "learning": [_NONE, "--set n_step=3", "--set reset_every=2", "--set memory_mapped=true"],
        "taught": [_NONE, "--base scripted", "--demonstrations earlier", "--from earlier"],
        "robots": [_NONE, "--num-envs 2", "--robots 2"],
        "time": [_NONE, "--realtime", "--asynchronous"],
        "evaluations": [_NONE, "--eval-every 1 --eval-episodes 1", "--stop-at 1000"],
        "kept": [_NONE, "--no-record", "--normalize"],
        "patience": [_NONE, "--patience-s 0"],
    },
    "evaluate": {
        "run": ["earlier", "skipping", "normal"],
        "task": [_NONE, "--env hub.py"],
        "time": [_NONE, "--realtime"],
        "physics": [_NONE, "--randomize", "--link bad-room"],
        "seed": [_NONE, "--seed 5"],
        "said": [_NONE, "--json"],
    },
    "record": {
        **_WORLDS,
        **_ENV,
        "policy": [_NONE, "--policy earlier", "--policy earlier --explore", "--policy skipping"],
        "seed": [_NONE, "--seed 5"],
    },
}
"""Values of each command's options; the first one of each is its default."""


def pairs_of(row: Row) -> set[Pair]:
    """The pairs in a row."""
    return {frozenset(pair) for pair in itertools.combinations(row.items(), 2)}


def all_pairs(options: Mapping[str, Sequence[str]]) -> set[Pair]:
    """Every two values of two options."""
    values = [[(name, value) for value in given] for name, given in options.items()]
    return {
        frozenset(pair)
        for one, other in itertools.combinations(values, 2)
        for pair in itertools.product(one, other)
    }


def is_refused(row: Row, refused: set[Pair]) -> bool:
    """Whether a row contains options that are refused together."""
    return any(options <= row.items() for options in refused)


def next_row(
    options: Mapping[str, Sequence[str]], left: set[Pair], refused: set[Pair], rng: random.Random
) -> Row | None:
    """A row with as many as possible of the pairs that are left, and nothing that is refused;
    ``None`` if there is none."""
    best, most = None, 0
    order = sorted(left, key=sorted)
    for first in rng.sample(order, min(len(order), 40)):
        row = dict(sorted(first))
        for name in rng.sample(list(options), len(options)):
            if name in row:
                continue
            chances = []
            for place, value in enumerate(options[name]):
                longer = {**row, name: value}
                if not is_refused(longer, refused):
                    chances.append((len(pairs_of(longer) & left), -place, value))
            if not chances:
                break
            row[name] = max(chances)[2]
        if len(row) == len(options) and len(pairs_of(row) & left) > most:
            best, most = {name: row[name] for name in options}, len(pairs_of(row) & left)
    return best


@dataclass(frozen=True)
class Outcome:
    """What a row did: ``fault`` is empty unless it is one; ``said`` is the reason if it was
    refused."""

    code: int
    said: str = ""
    fault: str = ""


def run(words: list[str], made: Path) -> Outcome:
    """Run a command of ``bricksrl`` in this process and look at what it made."""
    from bricksrl.cli import main

    out, err = io.StringIO(), io.StringIO()
    code: Any = 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main(words)
    except SystemExit as end:
        code = end.code or 0
    except BaseException:  # noqa: BLE001  whatever it is, it is the fault that is looked for
        return Outcome(1, fault=traceback.format_exc().strip().splitlines()[-1][:300])
    said = err.getvalue().strip()
    if code not in (0, 2) or "Traceback" in said:
        return Outcome(1, fault=f"code {code}: {said[-300:]}")
    return Outcome(
        int(code),
        said.splitlines()[-1] if code and said else "",
        "" if code else _disagreement(made),
    )


def _disagreement(made: Path) -> str:
    """How a run's metrics and its dataset disagree, if they do."""
    metrics, data = made / "metrics.csv", made / "data"
    if not metrics.exists() or not data.exists():
        return ""
    from bricksrl.data import load

    rows = list(csv.DictReader(metrics.read_text(encoding="utf-8").splitlines()))
    steps = load(data)
    if len(rows) != 2:
        return f"{len(rows)} episodes in place of 2"
    if int(rows[-1]["steps"]) != len(steps):
        return f"{rows[-1]['steps']} steps in the metrics, {len(steps)} in the dataset"
    apart = abs(sum(float(row["return"]) for row in rows) - float(steps.reward.sum()))
    return (
        f"the returns differ by {apart:g} from the dataset's rewards"
        if apart > 1e-2 * (1 + len(steps))
        else ""
    )


def words_of(command: str, row: Row, made: Path) -> list[str]:
    """The command line of a row."""
    first, *others = row.items()
    words = [command, first[1], *(word for _, value in others for word in value.split())]
    ends = {
        "train": f"--episodes 2 --no-film --run {made}",
        "evaluate": "--episodes 2",
        "record": f"--episodes 2 --out {made}",
    }
    return [*words, *ends[command].split()]


def prepare(folder: Path) -> None:
    """Write the tasks, a transform, and runs to go on from, into the present folder."""
    Path("hub.py").write_text(_TASK.replace("NAME", "RunAway-v0"))
    Path("camera.py").write_text(_TASK.replace("NAME", "RoboArm_mixed-v0"))
    Path("mine.py").write_text(_TRANSFORM)
    small = f"--agent sac {_SMALL} --episodes 2 --no-film".split()
    for name, more in (
        ("earlier", []),
        ("skipping", ["--frame-skip", "3"]),
        ("normal", ["--normalize"]),
    ):
        outcome = run(["train", "hub.py", *small, *more, "--run", name], folder / name)
        if outcome.code or outcome.fault:
            raise RuntimeError(f"{name}: {outcome}")


def reduced(command: str, row: Row, code: int, count: Iterator[int], folder: Path) -> Row:
    """The options of a row, without those that may have their default while it still ends with this
    code."""
    options, needed = OPTIONS[command], dict(row)
    for name in row:
        default = options[name][0]
        if needed[name] == default:
            continue
        made = folder / f"made-{next(count)}"
        if run(words_of(command, {**needed, name: default}, made), made).code == code:
            needed[name] = default
    return {name: value for name, value in needed.items() if value != options[name][0]}


def settle(
    options: Mapping[str, Sequence[str]],
    done: Mapping[str, Any],
    left: set[Pair],
    refused: set[Pair],
) -> None:
    """Take what a row showed out of the pairs that are left: all of its pairs if it ran, those that
    contain what was refused if it was refused."""
    row = {name: done["row"].get(name, values[0]) for name, values in options.items()}
    if done["code"] != 2:
        left -= pairs_of(row)
        return
    needed = frozenset(done["needed"].items())
    # Three options or more that exclude one another leave each of their pairs to be tried.
    refused.add(needed or frozenset(row.items()))
    if needed:
        left -= {pair for pair in left if needed <= pair}


def cover(
    command: str,
    rows: int,
    minutes: float,
    rng: random.Random,
    folder: Path,
    before: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Run up to ``rows`` rows of a command's covering array, with those of an earlier run,
    ``before``, and begin none after ``minutes``."""
    limit_s = time.monotonic() + 60.0 * minutes
    options, count = OPTIONS[command], itertools.count()
    left, refused = all_pairs(options), set[Pair]()
    total = len(left)
    done = list(before)
    for earlier in done:
        settle(options, earlier, left, refused)
    while left and len(done) < rows and time.monotonic() < limit_s:
        row = next_row(options, left, refused, rng)
        if row is None:
            break
        made = folder / f"made-{next(count)}"
        words = words_of(command, row, made)
        outcome = run(words, made)
        needed: Row = {}
        if outcome.code == 2 or (outcome.fault and outcome.code == 1):
            needed = reduced(command, row, outcome.code, count, folder)
        if outcome.fault:
            print(f"{command}: {' '.join(words)}: {outcome.fault}\n  needed: {needed}", flush=True)
        # Defaults are left out, and so is the folder of this run.
        given = {name: value for name, value in row.items() if value != options[name][0]}
        said = outcome.said.replace(f"{folder.parent}/", "")
        done.append({"row": given, "needed": needed, **asdict(outcome), "said": said})
        settle(options, done[-1], left, refused)
    pairs_refused = {pair for pair in all_pairs(options) if any(one <= pair for one in refused)}
    return {
        "pairs": total,
        "tried": total - len(left) - len(pairs_refused),
        "refused": len(pairs_refused),
        "left": len(left),
        "rows": len(done),
        "reasons": {" ".join(one["needed"].values()): one["said"] for one in done if one["said"]},
        "faults": [one for one in done if one["fault"]],
        "done": done,
    }


def main(session: Session) -> int:
    """Run the covering arrays, print faults, write the result after each command. Rows of an
    earlier run are not run again, so that an interrupted one goes on."""
    args = session.parse(rows=200, minutes=60.0, seed=0, commands=list(OPTIONS))
    os.environ["MUJOCO_GL"] = "disable"
    known = session.known()
    result = {command: known[command] for command in OPTIONS if command in known}
    with tempfile.TemporaryDirectory() as root:
        os.environ["XDG_CONFIG_HOME"] = str(Path(root) / "settings")
        with contextlib.chdir(root):
            prepare(Path(root))
        for command in args.commands:
            # Each command draws by itself, so that it can be run alone.
            rng = random.Random(f"{command}-{args.seed}")
            # What one command makes is not in the way of another one.
            made = Path(root) / f"of-{command}"
            made.mkdir()
            with contextlib.chdir(root):
                before = () if session.is_again else known.get(command, {}).get("done", ())
                result[command] = cover(command, args.rows, args.minutes, rng, made, before)
            shown = {name: value for name, value in result[command].items() if name != "done"}
            print(f"{command}: {shown}", flush=True)
            if session.is_apart or args.rows == 200:
                session.write({"seed": args.seed, **result})
    return 1 if any(result[command]["faults"] for command in args.commands) else 0
