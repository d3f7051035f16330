"""Documentation of an earlier commit, run with today's code: what users once learned to type and to
import must keep working.

    python -m benchmarks documented_commands             # about ten minutes
    python -m benchmarks documented_commands --quick     # parse and import only, in about a minute

Takes README, docs, notebooks and examples of the commit from Git, and runs each page in its order
in a new folder with the commit's examples and plans, one process a page. As in the tests of the
documentation, commands get fewer episodes, updates and copies, and no video. A command is only
parsed if it needs a hub, a browser, a camera, a cluster, hours or the reader's files. Commands
within a text may have placeholders; their words and flags are looked up in the help. Exit code 1 if
anything failed.
"""

from __future__ import annotations

import ast
import collections
import contextlib
import dataclasses
import functools
import importlib
import io
import json
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.machine import ONE_THREAD
from benchmarks.session import Session

COMMIT = "81c92bc"
"""Last commit before the packages were parted."""
CONTENT = (
    "README.md",
    "docs",
    "examples",
    "plugins/lerobot_robot_bricksrl/README.md",
    "plans",
    "src/bricksrl/robots/plans",
)
FOLLOWED = ("README", "start", "watch", "lesson", "own", "policies")
"""Pages that are followed from top to bottom; the others also have commands for the reader's robots
and files."""
OURS = ("brickhub", "bricktwin", "bricksrl")
CHANGED = {
    "bricksrl hub rename": "a sentence in docs/hardware.md",
    "python benchmarks/": "python -m benchmarks NAME",
    "bricksrl study": "python -m benchmarks NAME",
    "bricksrl data export DIR --format": "--out alone, for Minari",
    "bricksrl data export datasets/walker --format": "--out alone, for Minari",
    "bricksrl train Walker-v0 --data": "--demonstrations",
    "bricksrl train Walker-v0 --from runs/iql --data": "--demonstrations",
    "bricksrl train Walker-v0 --agent sac --from runs/bc --data": "--demonstrations",
}
"""Beginnings of what really had to change, and the new name of each, which stands in the
changelog."""
MOVED = {
    "bricksrl.plans": "bricktwin.plans",
    "bricksrl.twin.arena": "bricktwin.twin.arena",
    "bricksrl.virtual_hub": "brickhub.virtual",
    "bricksrl.envs.arenas.pettingzoo_env": "bricksrl.interfaces.pettingzoo",
    "bricksrl.envs.gymnasium": "bricksrl.interfaces.gymnasium",
    "bricksrl.envs.vision.encoders": "bricksrl.agents.frozen_encoders",
}
"""Modules that stand elsewhere now, and where: the code of the documentation is read with these."""
EXAMPLES: dict[str, dict[str, Any]] = {
    "02_train": {"episodes": 2},
    "07_batched_simulation": {"batch_size": 200, "steps": 20},
    "08_evaluate_elsewhere": {"episodes": 1},
}
"""Arguments of examples that shorten them."""
TASKS = ("03_own_task", "04_own_robot", "13_front_steered", "14_driving_robot")
"""Examples that hold a task."""
QUIET = {**ONE_THREAD, "MUJOCO_GL": "disable", "BRICKSRL_QUICK": "1", "COLUMNS": "120"}
_WRITES = ("--out", "--run", "--video")
_FILES = (".py", ".ldr", ".json", ".jsonl")
_PAGE_S = 1800.0


class ParsedOnlyError(Exception):
    """Nothing was run; the message is the reason."""


@dataclass(frozen=True)
class Item:
    """Command, import, snippet or example of a page, as its reader sees it, and the function that
    tries it."""

    kind: str
    text: str
    attempt: Callable[[], None]


@dataclass(frozen=True)
class Outcome:
    """What became of an item: ``ran``, ``parsed`` or ``failed``, and why."""

    page: str
    kind: str
    text: str
    state: str
    reason: str = ""
    seconds: float = 0.0


# ---------------------------------------------------------------- what a page says


def blocks(text: str, language: str) -> list[str]:
    """Code blocks of a page."""
    found = re.findall(rf"^ *```{language}\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL)
    return [re.sub(r"^ {3}", "", block, flags=re.MULTILINE) for block in found]


def commands(text: str) -> list[str]:
    """All ``bricksrl`` commands in the blocks of a page."""
    lines = [line for block in blocks(text, "bash") for line in block.splitlines()]
    lines += re.findall(r"^ {4}(bricksrl .*)$", text, re.MULTILINE)
    return [
        shlex.join(shlex.split(line, comments=True))
        for line in lines
        if line.startswith("bricksrl ")
    ]


def mentions(text: str, program: str) -> list[str]:
    """Commands within the text of a page, each once."""
    prose = re.sub(r"^ *```.*?^ *```", "", text, flags=re.MULTILINE | re.DOTALL)
    return list(
        dict.fromkeys(
            " ".join(found.split()) for found in re.findall(rf"`({program} [^`]+)`", prose)
        )
    )


def imports(source: str) -> list[str]:
    """All imports of a piece of Python, also those in functions. Raises SyntaxError."""
    nodes = ast.walk(ast.parse(source))
    return [ast.unparse(node) for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]


def indented_imports(text: str) -> list[str]:
    """Imports in the indented blocks of a page."""
    found = []
    for line in re.findall(r"^ {4}((?:from|import) .*)$", text, re.MULTILINE):
        with contextlib.suppress(SyntaxError):  # not code
            found += imports(line)
    return found


def names(text: str) -> list[str]:
    """Dotted names of our modules and of what is in them, each once."""
    package = rf"(?<![\w/.])(?:{'|'.join(OURS)})"
    found = re.findall(rf"{package}(?:\.[A-Za-z_]\w*)+\b(?!\.json)", text)
    return sorted(set(found) - {"bricksrl.json"})


def cheap(words: list[str]) -> list[str]:
    """The command with fewer episodes, updates and copies, and no video."""
    found = list(words)
    for flag, most in (("--episodes", None), ("--updates", 20), ("--num-envs", 4)):
        if flag in found:
            at = found.index(flag) + 1
            found[at] = str(min(int(found[at]), most) if most else 1 if int(found[at]) <= 20 else 2)
    if "--video" in found:
        del found[found.index("--video") : found.index("--video") + 2]
    if "--episodes" not in found and found[0] in ("train", "team"):
        found += ["--episodes", "1"]
    if found[0] == "team":
        found += ["--frames", "400"]
    if found[0] == "train-offline":
        found += ["--episodes", "2"]
    return found


def obstacle(words: list[str]) -> str | None:
    """What a command needs that is not here, besides files."""
    needs = {
        "a hub": any(word.startswith(("ble", "usb")) for word in words),
        "a browser": words[0] in ("drive", "play")
        or words[:2] == ["plan", "show"]
        or "--page" in words,
        "a camera": words[0] == "camera",
        "a cluster": "--on" in words,
        "hours": words[0] == "study" and len(words) > 1,
        "the state of the computer": words[0] == "doctor",
    }
    return next((reason for reason, is_needed in needs.items() if is_needed), None)


def missing_file(words: list[str]) -> str | None:
    """A file or folder that a command reads and that is not in the present folder."""
    if words[0] == "new":
        return None
    read = [word for word, before in zip(words[1:], words, strict=False) if before not in _WRITES]
    files = (word for word in read if "/" in word or word.endswith(_FILES))
    return next((file for file in files if not Path(file).exists()), None)


# ---------------------------------------------------------------- attempts


def run_command(line: str, *, quick: bool, is_followed: bool) -> None:
    """Parse a command, and run it where that is possible."""
    from bricksrl.cli.app import parse

    words = shlex.split(line)[1:]
    parse(words)
    if quick:
        raise ParsedOnlyError("--quick")
    if reason := obstacle(words):
        raise ParsedOnlyError(f"needs {reason}")
    if not is_followed and (file := missing_file(words)):
        raise ParsedOnlyError("needs the reader's file" if "<" not in file else "has a placeholder")
    run_words(*cheap(words))


def run_words(*words: str) -> None:
    """Run a command in this process. Raises AssertionError if it fails."""
    from bricksrl.cli import main

    if code := main(words):
        raise AssertionError(f"`bricksrl {shlex.join(words)}` ends with exit code {code}")


def look_up(line: str) -> None:
    """Look a command with placeholders up in the help."""
    from bricksrl.cli.app import parse

    words = line.replace("[", " ").replace("]", " ").split()[1:]
    named = []
    for word in words:
        if not re.fullmatch("[a-z][a-z-]*", word):
            break
        named.append(word)
    shown = io.StringIO()
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(shown):
        parse([*named, "--help"])
    usage, rest = shown.getvalue().partition("\n")[::2]
    # after "usage" and "bricksrl"
    known = re.findall(r"[a-z][a-z-]*", usage.partition("[-h]")[0])[2:]
    if "{" in usage and len(named) > len(known):
        raise AssertionError(f"`bricksrl {' '.join(known)}` has no command {named[len(known)]}")
    if unknown := [word for word in words if word.startswith("--") and word not in usage + rest]:
        raise AssertionError(f"`bricksrl {' '.join(known)}` has no option {', '.join(unknown)}")
    raise ParsedOnlyError("mentioned in a text")


def run_import(source: str) -> None:
    """Execute one import."""
    try:
        exec(source, {})  # noqa: S102
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package in OURS or not package:
            raise
        raise ParsedOnlyError(
            "runs on a hub" if package == "pybricks" else f"needs {package}"
        ) from None


def run_source(source: str, title: str, names: dict[str, Any], *, quick: bool) -> None:
    """Execute a snippet or the cell of a notebook."""
    code = compile(source, title, "exec")
    if quick:
        raise ParsedOnlyError("--quick")
    exec(code, names)  # noqa: S102


def find_name(name: str) -> None:
    """Import the module in a dotted name and look up the rest."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        module = ".".join(parts[:count])
        try:
            found: Any = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{module}.".startswith(f"{error.name}."):
                raise
            continue
        for part in parts[count:]:
            found = getattr(found, part)
        return


def run_example(path: Path, *, quick: bool) -> None:
    """Run one of the examples, as a file of the reader's."""
    compile(path.read_text(encoding="utf-8"), str(path), "exec")
    if quick:
        raise ParsedOnlyError("--quick")
    if path.stem in TASKS:
        run_words("check", str(path))
        run_words("train", str(path), "--episodes", "1")
    elif path.stem == "10_hub_program":
        run_words("hub", "run", str(path), "--robot", "RunAway-v0")
    elif path.stem == "11_test_a_program":
        runpy.run_path(str(path))["test_it_stops_before_the_wall"](Path.cwd())
    elif path.stem == "12_own_agent":
        run_words("check", str(path))
        run_words("train", "WalkerSim-v0", "--agent", str(path), "--episodes", "2")
    else:
        runpy.run_path(str(path), run_name="example")["main"](**EXAMPLES.get(path.stem, {}))


# ---------------------------------------------------------------- one page


def items(source: Path, page: str, quick: bool) -> Iterator[Item]:
    """All that a page holds: commands, then imports and code."""
    path = source / page
    if path.is_dir():
        for example in sorted(path.glob("*.py")):
            yield from _imports(imports(example.read_text(encoding="utf-8")))
            here = Path(path.name) / example.name
            yield Item("example", str(here), functools.partial(run_example, here, quick=quick))
    elif path.suffix == ".ipynb":
        yield from _cells(path, quick)
    else:
        yield from _page(path, quick)


def _page(path: Path, quick: bool) -> Iterator[Item]:
    text, is_followed = (
        path.read_text(encoding="utf-8"),
        path.stem in FOLLOWED and path.parent.parent.name != "plugins",
    )
    for line in commands(text):
        yield Item(
            "command",
            line,
            functools.partial(run_command, line, quick=quick, is_followed=is_followed),
        )
    for line in mentions(text, "bricksrl"):
        yield Item("mention", line, functools.partial(look_up, line))
    for line in dict.fromkeys(re.findall(r"python benchmarks/\w+\.py", text)):
        yield Item("script", line, lambda: None)  # all have a new name
    for block in blocks(text, "python"):
        yield from _imports(imports(block))
        if is_followed:
            short = block.replace("episodes=15", "episodes=1")
            yield Item(
                "snippet", block, functools.partial(run_source, short, path.name, {}, quick=quick)
            )
    yield from _imports(indented_imports(text))
    for name in names(text):
        yield Item("name", name, functools.partial(find_name, name))


def _cells(path: Path, quick: bool) -> Iterator[Item]:
    # as after the cell that installs it
    shared = {"__name__": "notebook", "bricksrl": importlib.import_module("bricksrl")}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code" and "install" not in cell["metadata"].get("tags", []):
            source = "".join(cell["source"])
            yield from _imports(imports(source))
            attempt = functools.partial(
                run_source, source, f"{path.name}:{cell.get('id')}", shared, quick=quick
            )
            yield Item("cell", source, attempt)


def _imports(sources: list[str]) -> Iterator[Item]:
    for source in sources:
        yield Item("import", source, functools.partial(run_import, source))


def attempt(item: Item, page: str) -> Outcome:
    """Try one item; anything that it raises is its failure."""
    start_s, state, reason = time.perf_counter(), "ran", ""
    new_name = next(
        (CHANGED[beginning] for beginning in CHANGED if item.text.startswith(beginning)), None
    )
    try:
        if new_name is not None:
            raise ParsedOnlyError(f"now {new_name}")
        item.attempt()
    except ParsedOnlyError as error:
        state, reason = "parsed", str(error)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever users would see
        state, reason = "failed", f"{type(error).__name__}: {error}"
    return Outcome(
        page, item.kind, item.text, state, reason, round(time.perf_counter() - start_s, 2)
    )


def work(source: Path, page: str, quick: bool, out: Path) -> None:
    """Try all items of a page, in this process and in the present folder, and write a line for each
    to ``out``."""
    with contextlib.suppress(ImportError):
        from bricksrl.cli import train

        train._EVALUATED_EPISODES = 1  # after a training; saves time
    with out.open("a", encoding="utf-8") as lines:
        for item in items(source, page, quick):
            outcome = attempt(item, page)
            if outcome.state == "failed":  # what it said last
                sys.stdout.flush()
                told = (
                    out.with_name("log.txt")
                    .read_text(encoding="utf-8", errors="replace")
                    .rstrip()
                    .rpartition("\n")[-1]
                )
                outcome = dataclasses.replace(outcome, reason=f"{outcome.reason} ({told})")
            lines.write(json.dumps(dataclasses.asdict(outcome)) + "\n")
            lines.flush()


# ---------------------------------------------------------------- all pages


def checked_out(folder: Path) -> Path:
    """The documentation of the commit, in a new folder."""
    git = ["git", "archive", "--format=tar", COMMIT, "--", *CONTENT]
    # - the commit is a constant
    made = subprocess.run(git, capture_output=True, check=False)  # noqa: S603
    if made.returncode:
        raise SystemExit(
            f"error: the history here has no commit {COMMIT}; start it in a whole clone (git "
            "fetch --unshallow)"
        )
    with tarfile.open(fileobj=io.BytesIO(made.stdout)) as archive:
        archive.extractall(folder, filter="data")
    for path in folder.rglob("*"):
        if path.suffix in (".md", ".py", ".ipynb"):
            path.write_text(_with_new_names(path.read_text(encoding="utf-8")), encoding="utf-8")
    return folder


def _with_new_names(text: str) -> str:
    for former, today in MOVED.items():
        text = re.sub(rf"\b{re.escape(former)}\b", today, text)
    return text


def pages(source: Path) -> list[str]:
    """README, pages, notebooks, the plugin's README and the folder of examples, relative to
    ``source``."""
    found = [
        source / "README.md",
        *sorted(source.glob("docs/*.md")),
        *sorted(source.glob("docs/reference/*.md")),
    ]
    found += [
        *sorted(source.glob("docs/tutorials/*.ipynb")),
        *sorted(source.glob("plugins/*/README.md")),
        source / "examples",
    ]
    return [str(path.relative_to(source)) for path in found]


def try_page(source: Path, page: str, quick: bool) -> list[Outcome]:
    """Outcomes of a page, from a process of its own in a folder like a fresh clone."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("examples", "plans"):
            shutil.copytree(source / name, Path(folder) / name)
        out, log = Path(folder) / "outcomes.jsonl", Path(folder) / "log.txt"
        out.touch()
        line = [
            sys.executable,
            "-m",
            "benchmarks.documented_commands",
            page,
            str(source),
            str(out),
            *(["--quick"] * quick),
        ]
        settings = {
            "XDG_CONFIG_HOME": str(source / ".config"),
            "XDG_CACHE_HOME": str(source / ".cache"),
        }
        env = {**os.environ, **QUIET, **settings}
        root = str(Path(__file__).resolve().parents[1])
        env["PYTHONPATH"] = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
        reason = ""
        with log.open("wb") as told:
            try:
                subprocess.run(  # noqa: S603 - this file
                    line,
                    cwd=folder,
                    env=env,
                    stdin=subprocess.DEVNULL,
                    stdout=told,
                    stderr=told,
                    timeout=_PAGE_S,
                    check=True,
                )
            except subprocess.CalledProcessError as error:
                reason = f"the process ended with exit code {error.returncode}"
            except subprocess.TimeoutExpired:
                reason = f"still running after {_PAGE_S:g} s"
        outcomes = [
            Outcome(**json.loads(text)) for text in out.read_text(encoding="utf-8").splitlines()
        ]
    if reason:
        last = outcomes[-1].text if outcomes else "the start"
        outcomes.append(Outcome(page, "page", f"after {last}", "failed", reason))
    return outcomes


def main(session: Session) -> int:
    """Try all pages and print the table; returns 1 if anything failed."""
    parser = session.parser
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="pages whose names contain this text"
    )
    args = session.parse()
    start_s, outcomes = time.perf_counter(), list[Outcome]()
    with tempfile.TemporaryDirectory() as folder:
        source = checked_out(Path(folder).resolve())
        for page in pages(source):
            if args.only in page:
                found = try_page(source, page, session.is_quick)
                outcomes += found
                print(
                    page, dict(collections.Counter(outcome.state for outcome in found)), flush=True
                )
    kinds = collections.Counter(f"{outcome.kind} {outcome.state}" for outcome in outcomes)
    parsed_only = collections.Counter(
        outcome.reason for outcome in outcomes if outcome.state == "parsed"
    )
    failed = [dataclasses.asdict(outcome) for outcome in outcomes if outcome.state == "failed"]
    for line in (*sorted(kinds.items()), *parsed_only.most_common(), *failed):
        print(line)
    if not args.only:
        result = {"kinds": kinds, "parsed_only": dict(parsed_only.most_common()), "failed": failed}
        session.write({"commit": COMMIT, "wall_s": round(time.perf_counter() - start_s), **result})
    return 1 if failed else 0


if __name__ == "__main__":  # of one page
    work(Path(sys.argv[2]), sys.argv[1], "--quick" in sys.argv, Path(sys.argv[3]))
