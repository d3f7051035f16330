"""Odd inputs at the command line (options, files, environments, signals): no traceback, no lost
data, no wrong verdict.

Most run in this process. The same seed gives the same inputs.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.session import Session

LONGEST_S = 60
"""Processor time of a command in this process, at most."""
HANG_S = 600
"""Time of a command, at most: what waits for nothing takes no processor time."""
VALUES = (
    "",
    " ",
    "nan",
    "inf",
    "-1",
    "0",
    "1e400",
    "9" * 40,
    "-0.0",
    "ü☃",
    "true",
    "null",
    "[]",
    "../..",
    "/dev/null",
    "a=b",
    "x" * 5000,
)
FLAGS = {
    "train RoboArmSim-v0 --agent random --episodes 1": (
        "--agent", "--preset", "--settings", "--set", "--device", "--num-envs", "--eval-every",
        "--eval-episodes", "--stop-at",
        "--episodes", "--seed", "--seeds", "--from", "--base", "--demonstrations",
        "--patience-s", "--hub", "--physics", "--option", "--take-over",
    ),
    "evaluate RUN --episodes 1": ("--env", "--episodes", "--seed", "--hub", "--physics"),
    "record RoboArmSim-v0 --episodes 1 --out NEW": ("--policy", "--episodes", "--seed", "--out",
        "--hub", "--option"),
    "data split DATA --out NEW --rest NEW2": ("--share", "--seed", "--out"),
    "data export DATA --out NEW": ("--out",),
    "data plot DATA --out NEW.png": ("--out",),
    "compare RUN": ("--out",),
    "hub program RunAway-v0": ("--out",),
    "tune RoboArmSim-v0 --agent random --folder NEW": ("--agent", "--trials", "--steps", "--seeds",
        "--episodes", "--seed"),
}  # fmt: skip
PLACES = (
    "train ODD", "evaluate ODD", "resume ODD", "compare ODD", "plot ODD --out NEW.png", "check ODD",
    "settings ODD", "trust ODD",
    "data info ODD", "data check ODD", "data repair ODD", "data merge ODD --out NEW",
    "hub program ODD", "hub run ODD",
    "plan check ODD", "plan parts ODD", "new task ODD", "ODD", "data ODD", "hub ODD",
    "export ODD --format torch-export --out NEW",
)  # fmt: skip
ENVIRONMENTS: tuple[dict[str, str], ...] = (
    {"LC_ALL": "C", "PYTHONUTF8": "0"}, {"PYTHONIOENCODING": "ascii"},
    {"PYTHONIOENCODING": "utf-16"}, {"COLUMNS": "0"},
    {"COLUMNS": "-5"}, {"COLUMNS": "x"}, {"COLUMNS": "3"}, {"TERM": "dumb"}, {"TERM": ""},
    {"HOME": "/nonexistent"}, {"HOME": ""},
    {"XDG_CONFIG_HOME": "/dev/null"}, {"XDG_CACHE_HOME": "/dev/null"}, {"MPLBACKEND": "nope"},
    {"MPLCONFIGDIR": "/dev/null"},
    {"MUJOCO_GL": "osmesa"}, {"MUJOCO_GL": "nope"}, {"MUJOCO_GL": ""}, {"PYTHONOPTIMIZE": "1"},
    {"PYTHONOPTIMIZE": "2"},
    {"PYTHONDONTWRITEBYTECODE": "1"}, {"PYTHONHASHSEED": "7"}, {"NO_COLOR": "1"},
    {"FORCE_COLOR": "1"}, {"LANG": "xx_XX"},
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """Outcome of one command: its exit code, its output, and its fault, if any."""

    code: int
    out: str
    err: str
    fault: str = ""


Trial = Callable[[Path], str]
"""A trial in a new folder, which returns a fault or an empty text."""
Cases = Iterator[tuple[str, Trial]]
"""Descriptions of inputs, and their trials."""


class TookTooLong(BaseException):
    """The time limit of a command was exceeded; the message is the fault."""


def run(arguments: list[str]) -> Outcome:
    """Run a command in this process."""
    from bricksrl.cli import main

    def ring(_signum: int, _frame: FrameType | None) -> None:
        raise TookTooLong(f"did not end within {HANG_S} s")

    def charge(_signum: int, _frame: FrameType | None) -> None:
        raise TookTooLong(f"took more than {LONGEST_S} s of processor time")

    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
    before = signal.signal(signal.SIGALRM, ring), signal.signal(signal.SIGPROF, charge)
    signal.alarm(HANG_S)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    fault, code = "", -1
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = main(arguments)
            except SystemExit as end:
                code = int(end.code or 0)
    except TookTooLong as limit:
        fault = str(limit)
    except BaseException as error:  # noqa: BLE001  any error is a fault
        fault = (
            f"traceback: {type(error).__name__}: {error} "
            f"{traceback.format_tb(error.__traceback__)[-1].strip()}"
        )[:400]
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGALRM, before[0])
        signal.signal(signal.SIGPROF, before[1])
    stdout, stderr = (stream.buffer.getvalue().decode(errors="replace") for stream in (out, err))
    return Outcome(code, stdout, stderr, fault or verdict(code, stderr))


def verdict(code: int, err: str) -> str:
    """Fault in how a command ended: a traceback, another exit code than it may have, or an error of
    several lines."""
    if "Traceback (most recent call last)" in err:
        return f"traceback: {err.strip().splitlines()[-1]}"[:400]
    if code not in (0, 1, 2):
        return f"exit code {code}"
    errors = [line for line in err.splitlines() if line.startswith("error:")]
    if code == 2 and len(errors) != 1:
        return f"{len(errors)} lines of error"
    return ""


def digest(root: Path) -> str:
    """SHA-256 of all files of a folder."""
    hash_ = hashlib.sha256()
    for path in sorted(root.rglob("*")):
        if path.is_file():
            hash_.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return hash_.hexdigest()


@dataclass(frozen=True)
class Workshop:
    """A folder with a run and a dataset, of which trials damage copies."""

    root: Path

    @property
    def run(self) -> Path:
        return self.root / "run"

    @property
    def data(self) -> Path:
        return self.root / "dataset"

    def prepare(self) -> None:
        """Make the run and the dataset."""
        for command in (
            f"train RoboArmSim-v0 --episodes 3 --run {self.run}",
            f"record RunAway-v0 --episodes 3 --out {self.data}",
        ):
            outcome = run(command.split())
            if outcome.code:
                raise RuntimeError(outcome.err or outcome.fault)

    def words(self, command: str, at: Path, odd: str = "") -> list[str]:
        """The words of a command with paths in place of RUN, DATA, NEW."""
        names = {
            "RUN": str(self.run),
            "DATA": str(self.data),
            "NEW": str(at / "new"),
            "NEW2": str(at / "new2"),
            "ODD": odd,
        }
        return [
            re.sub(r"^(RUN|DATA|NEW2|NEW|ODD)", lambda match: names[match[1]], word)
            for word in command.split()
        ]


def try_option(shop: Workshop, command: str, value: str, folder: Path) -> str:
    """A command with an odd value or path."""
    before = digest(shop.root)
    words = shop.words(command, folder, value)
    words = words if "ODD" in command else [*words, value]
    if words[0] == "train" and "--run" not in words:
        words += ["--run", str(folder / "made")]
    return run(words).fault or (
        "a run or a dataset was changed" if digest(shop.root) != before else ""
    )


def options(shop: Workshop, rng: random.Random, count: int) -> Cases:
    """Odd values of options, and odd paths."""
    pairs = [
        (f"{base} {flag}", value)
        for base, flags in FLAGS.items()
        for flag in flags
        for value in VALUES
    ]
    pairs += [(place, value) for place in PLACES for value in VALUES]
    for command, value in rng.sample(pairs, count):
        yield f"{command} {value[:40]!r}", partial(try_option, shop, command, value)


def damaged(data: bytes, how: str, rng: random.Random) -> bytes:
    """A file's content after an accident."""
    middle = rng.randrange(1, max(2, len(data) - 1))
    return {
        "cut": data[:middle],
        "empty": b"",
        "zeros": bytes(len(data)),
        "flip": data[:middle] + bytes([data[middle] ^ (1 << rng.randrange(8))]) + data[middle + 1 :]
        if len(data) > 1
        else b"",
        "brackets": b"[" * 100_000,
        "null": b"null",
        "twice": data + data,
        "noise": rng.randbytes(len(data)),
    }[how]


def try_file(shop: Workshop, command: str, place: Path, how: str, seed: int, folder: Path) -> str:
    """A command with a damaged file of a copy of the run or of the dataset."""
    copy = folder / "copy"
    shutil.copytree(shop.root, copy)
    path = copy / place
    before = path.read_bytes()
    path.write_bytes(damaged(before, how, random.Random(seed)))
    outcome = run(shop.words(command, folder, str(copy / place.parts[0])))
    after = path.read_bytes()
    is_same = after == before or _same_json(before, after) or _same_table(before, after)
    if not outcome.fault and command.startswith("data check") and outcome.code == 0 and not is_same:
        return f"check says all is well with a damaged {place.name}"
    return outcome.fault


def files(shop: Workshop, rng: random.Random, count: int) -> Cases:
    """Damaged files of runs and datasets."""
    in_run = [
        path.relative_to(shop.root)
        for path in shop.run.glob("*")
        if path.suffix in (".json", ".csv", ".bin")
    ]
    in_data = [
        path.relative_to(shop.root)
        for path in shop.data.rglob("*")
        if path.is_file() and not path.name.startswith(".")
    ]
    for _ in range(count):
        place = rng.choice(in_run) if rng.random() < 0.5 else rng.choice(in_data)
        how = rng.choice(["cut", "empty", "zeros", "flip", "brackets", "null", "twice", "noise"])
        seed, is_run = rng.randrange(2**31), place.parts[0] == "run"
        choices = (
            ("evaluate ODD --episodes 1", "resume ODD", "compare ODD")
            if is_run
            else ("data check ODD", "data info ODD")
        )
        command = rng.choice(choices)
        yield f"{command} with {place} {how}", partial(try_file, shop, command, place, how, seed)


def _same_json(before: bytes, after: bytes) -> bool:
    """True if two JSON files differ at most in white space or the last digits of a number."""
    try:
        first, second = (
            re.sub(r"(\d\.\d{5})\d+", r"\1", json.dumps(json.loads(data)))
            for data in (before, after)
        )
    except (ValueError, RecursionError):
        return False
    return first == second


def _same_table(before: bytes, after: bytes) -> bool:
    """True if two Parquet files hold the same table; an unused bit may differ."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        first, second = (pq.read_table(io.BytesIO(data)) for data in (before, after))
    except (pa.ArrowException, OSError, ValueError):
        return False
    return bool(first.equals(second))


def try_mutant(kind: str, seed: int, folder: Path) -> str:
    """The check of a template with a line removed or a value replaced."""
    from bricksrl.cli import templates

    generator = random.Random(seed)
    lines = (
        (Path(templates.__file__).parent / f"{kind}.py").read_text(encoding="utf-8").splitlines()
    )
    index = generator.choice(
        [index for index, line in enumerate(lines) if line.strip() and index > 8]
    )
    line, number = lines[index], generator.choice(["-1", "0", "1e9", "nan", "None"])
    lines[index : index + 1] = generator.choice(
        (
            [],
            [re.sub(r"\d+(\.\d+)?", number, line)],
            [re.sub(r'"\w+"', '"nonsense"', line)],
            [line.replace("(", "((", 1)],
        )
    )
    (folder / "own.py").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return run(["check", "own.py"]).fault


def mutants(_shop: Workshop, rng: random.Random, count: int) -> Cases:
    """Mutants of the templates of user files."""
    for _ in range(count):
        kind, seed = rng.choice(["task", "robot", "agent"]), rng.randrange(2**31)
        yield (
            f"check of a mutant of the {kind} template, seed {seed}",
            partial(try_mutant, kind, seed),
        )


def process(arguments: list[str], variables: dict[str, str], folder: Path) -> subprocess.Popen[str]:
    """Start a command in its own process."""
    command = [sys.executable, "-m", "bricksrl", *arguments]
    env = {**os.environ, "MUJOCO_GL": "disable", **variables}
    return subprocess.Popen(  # noqa: S603  our own interpreter
        command,
        cwd=folder,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    )


def output_of(child: subprocess.Popen[str]) -> tuple[str, str]:
    """Output of a process that ends; one that hangs is killed, which its exit code tells."""
    try:
        return child.communicate(timeout=HANG_S)
    except subprocess.TimeoutExpired:
        child.kill()
        return child.communicate()


def try_environment(shop: Workshop, command: str, variables: dict[str, str], folder: Path) -> str:
    """A command with odd environment variables."""
    child = process(shop.words(command, folder), variables, folder)
    out, err = output_of(child)
    return verdict(child.returncode, err) or ("" if out or err else "it said nothing")


def environments(shop: Workshop, rng: random.Random, count: int) -> Cases:
    """Odd environments."""
    commands = (
        "list",
        "settings sac",
        "hub program RunAway-v0",
        "evaluate RUN --episodes 1",
        "data info DATA",
        "train --help",
    )
    pairs = [(variables, command) for variables in ENVIRONMENTS for command in commands]
    for variables, command in rng.sample(pairs, count):
        yield f"{command} with {variables}", partial(try_environment, shop, command, variables)


def try_signal(command: str, which: int, delay_s: float, folder: Path) -> str:
    """A command that gets a signal; the run or dataset is then absent or intact."""
    child = process(command.split(), {}, folder)
    time.sleep(delay_s)
    child.send_signal(which)
    _, err = output_of(child)
    if child.returncode == -signal.SIGKILL != -which:
        return f"did not end within {HANG_S} s"
    if "Traceback" in err and "bricksrl/" in err.rpartition("Traceback")[2]:
        return f"traceback: {err.strip().splitlines()[-1]}"[:400]
    if not (folder / "made").exists():
        return ""
    data = folder / "made/data" if command.startswith("train") else folder / "made"
    if which == signal.SIGKILL and data.exists():
        outcome = run(["data", "repair", str(data)])
        if outcome.fault or (outcome.code and "there is no dataset" not in outcome.err):
            return outcome.fault or f"repair: {outcome.err or outcome.out}"
    if command.startswith("train"):
        outcome = run(["evaluate", "made", "--episodes", "1"])
        return outcome.fault or ("" if outcome.code == 0 else f"the run is lost: {outcome.err}")
    outcome = run(["data", "check", "made"])
    is_sound = outcome.code == 0 or "there is no dataset" in outcome.err
    return outcome.fault or (
        "" if is_sound else f"the dataset is damaged: {outcome.out}{outcome.err}"[:300]
    )


def signals(_shop: Workshop, rng: random.Random, count: int) -> Cases:
    """Signals at random moments."""
    for _ in range(count):
        which, delay_s = (
            rng.choice([signal.SIGINT, signal.SIGTERM, signal.SIGKILL]),
            rng.uniform(0.3, 12.0),
        )
        command = rng.choice(
            [
                "train RoboArmSim-v0 --episodes 500 --run made",
                "record RunAway-v0 --episodes 500 --out made",
            ]
        )
        about = f"{signal.Signals(which).name} after {delay_s:.1f} s in {command}"
        yield about, partial(try_signal, command, which, delay_s)


KINDS = {options: 500, files: 280, mutants: 120, environments: 60, signals: 40}
"""Numbers of inputs."""


def main(session: Session) -> int:
    """Try all inputs, print faults, write the result."""
    parser = session.parser
    parser.add_argument("--scale", type=float, default=1.0, help="share of the 1,000 inputs")
    kinds = {kind.__name__: kind for kind in KINDS}
    args = session.parse(seed=0, kinds=list(kinds))
    os.environ["MUJOCO_GL"] = "disable"
    # A shell in the background makes us, and so the commands, ignore it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    setup = {"seed": args.seed, "scale": args.scale}
    known = session.known() if set(args.kinds) < set(kinds) else {}
    # Kinds that are not tried again keep what they gave with the same seed.
    if {name: known.get(name) for name in setup} != setup:
        known = {}
    tried: Counter[str] = Counter(known.get("inputs", {}))
    faults: list[dict[str, str]] = list(known.get("faults", ()))
    start_s = time.monotonic()
    with tempfile.TemporaryDirectory() as root:
        os.environ["XDG_CONFIG_HOME"] = str(Path(root) / "settings")
        shop = Workshop(Path(root) / "shop")
        shop.prepare()
        for name in args.kinds:
            tried[name] = 0
            faults = [fault for fault in faults if fault["kind"] != name]
            # Each kind draws by itself, so that it can be tried alone.
            rng = random.Random(f"{name}-{args.seed}")
            count = round(KINDS[kinds[name]] * args.scale)
            for about, trial in kinds[name](shop, rng, count):
                tried[name] += 1
                with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
                    fault = trial(Path(folder))
                if fault:
                    faults.append({"kind": name, "input": about, "fault": fault})
                    print(f"{name}: {about}: {fault}", flush=True)
    seconds = known.get("seconds", 0) + round(time.monotonic() - start_s)
    result: dict[str, Any] = {
        **setup,
        "inputs": dict(tried),
        "total": sum(tried.values()),
        "faults": faults,
        "seconds": seconds,
    }
    print(f"{result['total']} inputs, {len(faults)} faults, {seconds} s")
    if args.scale == 1.0 or session.is_apart:
        session.write(result)
    return 1 if faults else 0
