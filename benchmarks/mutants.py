"""Mutants: small faults in the source, and the tests that find them.

    python -m benchmarks mutants --tree old|new [--jobs 1] [--only 3 7] [--folder-only]
    python -m benchmarks mutants --table

60 faults are drawn by a seed from the source of the commit `OLD`, two thirds of them in the two lower houses: a file by its
number of statements, then an operator, then a place. A fault is known by its function, the text before and after it, and its
number among equal ones there, so that it is found again where files have moved; one that is not found is `gone`. `--tree old`
runs the tests of `OLD`, `--tree new` those of the last commit, in a copy of that tree, up to the first that fails: those of the
module's name and the file that found the fault in the other tree, then the folder. Those that nothing found are (not with
`--folder-only`) put into the tree all at once: of all tests but the slow ones, those that fail then are run with each of them. A
failure counts if the test, run alone, fails again with the fault and passes without it. What never ends has failed. Verdicts in
the result are not repeated, unless `--only` names them: an interrupted script resumes.
"""

from __future__ import annotations

import ast
import asyncio
import contextlib
import copy
import io
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import AsyncIterator, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.formatting import table
from benchmarks.machine import describe
from benchmarks.session import RESULTS, Session

ROOT = Path(__file__).parent.parent
RESULT = RESULTS / "mutants.json"
OLD = "81c92bc"
REVISIONS = {"old": OLD, "new": "HEAD"}
SEED = 36
COUNTS = {"brickhub": 24, "bricktwin": 16, "bricksrl": 20}
SHARED = ("entry.py", "errors.py", "fields.py", "files.py", "finding.py", "seed.py", "tables.py")
FOLDERS = {"brickhub": ("hub", "virtual_hub", "robots/spec.py", *SHARED), "bricktwin": ("plans", "twin", "robots")}
"""Files and folders of `OLD` that belong to the lower houses; the first that fits. All others belong to bricksrl."""
TEMPLATES = "cli/templates"
TEST_S, QUIET_S, RUN_S = 180.0, 400.0, 5400.0
"""Longest time of a test without a limit of its own, of a run of pytest that reports nothing, and of a run."""
SURVIVED = "survived folder"
QUICK = ("-m", "not slow and not realtime")
WORKERS = ("--numprocesses=3", "--dist=loadfile")
REALTIME = ("-m", "not slow and realtime")

_BOUNDARY = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_NEGATION = {ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
_NEGATION |= {ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In}
_ARITHMETIC = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult}
_EXTREMES = {"min": "max", "max": "min"}
_Node = TypeVar("_Node", bound=ast.AST)
Change = tuple[str, ast.AST]
"""An operator, and what takes the place of a node."""
Place = tuple[int, int]
"""Where a text begins and ends, in bytes."""


@dataclass(frozen=True)
class Fault:
    """A change of one expression or statement, known without its file and line."""

    function: str
    """Qualified name of the function, or of the constant of a module or class."""
    operator: str
    before: str
    after: str
    occurrence: int
    """Number among equal ones of this function."""


def _with(node: _Node, **changes: Any) -> _Node:
    changed = copy.copy(node)
    for name, value in changes.items():
        setattr(changed, name, value)
    return changed


def _comparisons(node: ast.Compare) -> Iterator[Change]:
    for operator, others in (("boundary", _BOUNDARY), ("negation", _NEGATION)):
        for i, one in enumerate(node.ops):
            if other := others.get(type(one)):
                yield operator, _with(node, ops=[*node.ops[:i], other(), *node.ops[i + 1 :]])


def _constants(node: ast.Constant) -> Iterator[Change]:
    value = node.value
    if isinstance(value, bool):
        yield "constant", ast.Constant(not value)
    elif isinstance(value, int):
        yield "constant", ast.Constant(value + 1)
    elif isinstance(value, float):
        yield "constant", ast.Constant(value * 2 or 1.0)


def _calls(node: ast.Call) -> Iterator[Change]:
    if isinstance(node.func, ast.Name) and (other := _EXTREMES.get(node.func.id)):
        yield "extreme", _with(node, func=ast.Name(other))
    for i, keyword in enumerate(node.keywords):
        if keyword.arg and keyword.arg != "strict":
            yield "keyword", _with(node, keywords=node.keywords[:i] + node.keywords[i + 1 :])


def _expressions(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Compare():
            yield from _comparisons(node)
        case ast.BinOp(left=left, op=op, right=right):
            is_text = any(isinstance(side, ast.JoinedStr | ast.Constant) and not _is_number(side) for side in (left, right))
            if not is_text and (other := _ARITHMETIC.get(type(op))):
                yield "arithmetic", _with(node, op=other())
        case ast.Constant():
            yield from _constants(node)
        case ast.BoolOp(op=op):
            yield "and, or", _with(node, op=ast.Or() if isinstance(op, ast.And) else ast.And())
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "not", operand
        case ast.Call():
            yield from _calls(node)


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


def _statements(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Return(value=ast.expr() as value):
            if not isinstance(value, ast.Constant) or value.value is not None:
                yield "return", ast.Return(ast.Constant(None))
            if isinstance(value, ast.Compare | ast.BoolOp) or (isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not)):
                yield "return", ast.Return(ast.UnaryOp(ast.Not(), value))
        case ast.Expr(value=ast.Call()):
            yield "statement", ast.Pass()
        case ast.Assign(targets=[ast.Attribute()]) | ast.AugAssign(target=ast.Attribute()):
            yield "statement", ast.Pass()


def _children(node: ast.AST) -> list[ast.AST]:
    """What is executed of a node: no annotations, decorators and texts, nothing for types or for a script alone."""
    match node:
        case ast.FunctionDef(args=arguments, body=body) | ast.AsyncFunctionDef(args=arguments, body=body):
            return [*arguments.defaults, *filter(None, arguments.kw_defaults), *body]
        case ast.ClassDef(body=body):
            return [*body]
        case ast.AnnAssign(value=value):
            return [value] if value else []
        case ast.If(test=test) if ast.unparse(test) in ("TYPE_CHECKING", "__name__ == '__main__'"):
            return []
        case ast.JoinedStr():
            return []
    return list(ast.iter_child_nodes(node))


def _name(node: ast.AST) -> str | None:
    """The name that a definition gives: of a function, a class or a constant."""
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            return name
        case ast.Assign(targets=[ast.Name(id=name), *_]) | ast.AnnAssign(target=ast.Name(id=name)):
            return name
    return None


@cache
def faults(text: str) -> dict[Fault, Place]:
    """All faults that a module can have, and their places."""
    starts = [0]
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found: dict[Fault, Place] = {}
    equal: Counter[tuple[str, ...]] = Counter()

    def visit(node: ast.AST, function: str, *, is_body: bool) -> None:
        name = _name(node)
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if name and (not is_body or is_function or isinstance(node, ast.ClassDef)):
            function = f"{function}.{name}" if function else name
        for operator, other in [*_expressions(node), *_statements(node)]:
            assert isinstance(node, ast.expr | ast.stmt) and node.end_lineno and node.end_col_offset is not None
            known = (function, operator, ast.unparse(node), ast.unparse(ast.fix_missing_locations(other)))
            begin, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
            found[Fault(*known, equal[known])] = begin, end
            equal[known] += 1
        for child in _children(node):
            visit(child, function, is_body=is_body or is_function)

    visit(ast.parse(text), "", is_body=False)
    return found


def mutated(text: str, fault: Fault, place: Place) -> str:
    """The text of a module with a fault."""
    data = text.encode()
    return (data[: place[0]] + fault.after.encode() + data[place[1] :]).decode()


def sources(revision: str) -> dict[str, str]:
    """Texts of all modules of the packages and of the benchmarks in a commit, by their paths."""
    archive = subprocess.run(["git", "archive", revision], cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout  # noqa: S603, S607
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        wanted = [one for one in files if re.search(r"(^|/)(src|benchmarks)/.*\.py$", one.name) and TEMPLATES not in one.name]
        return {one.name: data.read().decode() for one in wanted if (data := files.extractfile(one))}


def house(file: str) -> str:
    """The house of a file of `OLD`."""
    inner = Path(file).relative_to("src/bricksrl")
    return next((name for name, folders in FOLDERS.items() if any(inner.is_relative_to(one) for one in folders)), "bricksrl")


def draw() -> list[dict[str, Any]]:
    """The mutants, in random order."""
    rng, drawn = random.Random(SEED), list[dict[str, Any]]()
    texts = {file: text for file, text in sources(OLD).items() if file.startswith("src/")}
    for name, count in COUNTS.items():
        files = sorted(file for file in texts if house(file) == name and faults(texts[file]))
        weights = [sum(isinstance(node, ast.stmt) for node in ast.walk(ast.parse(texts[file]))) for file in files]
        chosen: dict[tuple[str, Fault], None] = {}
        while len(chosen) < count:
            file = rng.choices(files, weights)[0]
            by_operator = defaultdict(list)
            for fault in faults(texts[file]):
                by_operator[fault.operator].append(fault)
            chosen[file, rng.choice(by_operator[rng.choice(sorted(by_operator))])] = None
        drawn += [{"house": name, "file": file, **asdict(fault)} for file, fault in chosen]
    rng.shuffle(drawn)
    return drawn


def fault_of(mutant: dict[str, Any]) -> Fault:
    """The fault of a drawn mutant."""
    return Fault(*(mutant[name] for name in Fault.__dataclass_fields__))


def locate(mutant: dict[str, Any], texts: dict[str, str]) -> tuple[str, Place] | None:
    """The file and the place of a mutant in another tree: the same file, one of the same name, one with the same function."""
    was, fault = Path(mutant["file"]), fault_of(mutant)
    last = fault.function.split(".")[-1]
    fitting = [file for file in texts if Path(file).name == was.name or (last and last in texts[file])]
    fitting.sort(key=lambda file: (Path(file).name != was.name, -len(set(Path(file).parts) & set(was.parts)), file))
    return next(((file, faults(texts[file])[fault]) for file in fitting if fault in faults(texts[file])), None)


@dataclass(frozen=True)
class Tree:
    """A copy of a commit, in which one file at a time has a fault."""

    folder: Path
    scratch: Path
    broken: list[str]
    """Tests that fail here without a fault; they are left out."""

    @classmethod
    def make(cls, revision: str, scratch: Path, broken: list[str]) -> Tree:
        """Check the commit out. Byte code is found by the digest of its source, so that no fault is missed."""
        folder = scratch / "tree"
        subprocess.run(["git", "clone", "--quiet", "--shared", "--no-checkout", ROOT, folder], check=True)  # noqa: S603, S607
        subprocess.run(["git", "checkout", "--quiet", revision], cwd=folder, check=True)  # noqa: S603, S607
        tree = cls(folder, scratch, broken)
        arguments = ("-m", "compileall", "-q", "--invalidation-mode", "checked-hash")
        subprocess.run([sys.executable, *arguments, *tree.paths()], check=True)  # noqa: S603
        where = [sys.executable, "-c", "import bricksrl; print(bricksrl.__file__)"]
        said = subprocess.run(where, cwd=scratch, env=tree.environment(), capture_output=True, text=True, check=True)  # noqa: S603
        assert said.stdout.startswith(f"{folder}/"), f"the tests would import {said.stdout}"
        return tree

    def paths(self) -> list[Path]:
        """Folders to import from."""
        return [one for one in (self.folder / "src", *self.folder.glob("packages/*/src")) if one.is_dir()]

    def environment(self) -> dict[str, str]:
        """Environment variables of tests and of all that they start."""
        path = os.pathsep.join(map(str, self.paths()))
        return {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}

    def near(self, file: str, hint: str) -> list[list[str]]:
        """Arguments of pytest for the tests near a file; ``hint`` is a test that found the fault elsewhere."""
        above, _, inner = file.rpartition("src/")
        places = (self.folder / above, *sorted(self.folder.glob("packages/*")), self.folder)
        roots = list(dict.fromkeys(tests for one in places if (tests := one / "tests").is_dir()))
        earlier, own = (
            [path for root in roots for path in sorted(root.rglob("test_*.py")) if path.name == name]
            for name in (Path(hint.partition("::")[0]).name, f"test_{Path(inner).stem}.py")
        )
        folder = roots[0].joinpath(*Path(inner).parent.parts[1:])
        while not folder.is_dir():
            folder = folder.parent
        beside = [folder] if folder != roots[0] else sorted({*folder.glob("test_*.py")} - {*own})
        stages = [[str(path)] for path in dict.fromkeys([*earlier, *own])]
        stages += [[*map(str, beside), *(f"--ignore={path}" for path in own)]] if beside else []
        return [[*stage, *QUICK] for stage in stages]

    async def failures(self, *arguments: str) -> list[str]:
        """Run pytest; the names of the tests that failed."""
        limit = (f"--timeout={TEST_S}", "--timeout-method=thread")  # the other method lets Hypothesis begin the test again
        options = ("-v", "--color=no", "-p", "no:cacheprovider", f"--rootdir={self.folder}", *limit)
        words = [*options, f"--basetemp={self.scratch / 'tmp'}", *(f"--deselect={name}" for name in self.broken), *arguments]
        log = self.scratch / "log.txt"
        with log.open("w") as out:
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "pytest", *words),
                cwd=self.folder,
                env=self.environment(),
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(RUN_S):
                        while process.returncode is None and time.time() - log.stat().st_mtime < QUIET_S:
                            with contextlib.suppress(TimeoutError):
                                await asyncio.wait_for(process.wait(), 10)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)  # also what tests have left behind
        return [] if process.returncode in (0, 5) else failed_tests(log.read_text(errors="replace"))

    async def failure(self, *arguments: str) -> str | None:
        """Run pytest up to the first failure; the name of the test that failed."""
        return next(iter(await self.failures("-x", *arguments)), None)

    async def killer(self, file: str, wrong: str, stage: list[str]) -> str | None:
        """The test that finds a fault, of one run of pytest."""
        path, doubtful = self.folder / file, list[str]()
        right = path.read_text(encoding="utf-8")
        try:
            path.write_text(wrong, encoding="utf-8")
            while name := await self.failure(*stage, *(f"--deselect={one}" for one in doubtful)):
                if name in doubtful:
                    return f"{name} (not confirmed)"
                alone = [*stage, "--collect-only"] if name.startswith("pytest itself") else [name]
                again = await self.failure(*alone)
                path.write_text(right, encoding="utf-8")
                if again and not await self.failure(*alone):
                    return name
                self.broken.extend([name] if again and await self.failure(*alone) else [])
                doubtful.append(name)
                path.write_text(wrong, encoding="utf-8")
        finally:
            path.write_text(right, encoding="utf-8")
        return None


def failed_tests(output: str) -> list[str]:
    """The names of the failed tests in what pytest has written; of the last that began if it could not say."""
    if names := re.findall(
        r"^(?:\[gw\d\] .*?)?(?:FAILED|ERROR) (\S+?\.py(?:::\w+)*(?:\[.*?\])?)(?: - | *$)", output, re.MULTILINE
    ):
        return list(dict.fromkeys(names))
    if begun := re.findall(r"^(?:\[gw\d\] .*? )?(\S+?\.py::\w+(?:::\w+)*(?:\[.*?\])?)(?: |$)", output, re.MULTILINE):
        return [str(begun[-1])]
    match = re.search(r"^(?:ImportError while loading conftest '(.*)'|\S*(?:Error|Exit)\b.*)", output, re.MULTILINE)
    return [f"pytest itself: {(match[0] if match else output.strip()[-200:])!r}"]


async def verdict(tree: Tree, mutant: dict[str, Any], texts: dict[str, str], hint: str) -> dict[str, Any]:
    """Whether a mutant dies by a test near it, and by which."""
    if (found := locate(mutant, texts)) is None:
        return {"state": "gone"}
    file, place = found
    wrong, start = mutated(texts[file], fault_of(mutant), place), time.monotonic()
    test = None
    for stage in tree.near(file, hint):
        if test := await tree.killer(file, wrong, stage):
            break
    return _judged(tree, file, test, SURVIVED, time.monotonic() - start)


def _judged(tree: Tree, file: str, test: str | None, otherwise: str, seconds: float) -> dict[str, Any]:
    test = test and test.replace(f"{tree.folder}/", "")
    return {"state": "died" if test else otherwise, "test": test, "file": file, "seconds": round(seconds)}


async def far_verdicts(
    tree: Tree, mutants: dict[str, dict[str, Any]], texts: dict[str, str]
) -> AsyncIterator[tuple[str, dict[str, Any]]]:
    """Whether mutants that nothing near them finds die by another test: a number and a verdict at a time."""
    places = {i: found for i, mutant in mutants.items() if (found := locate(mutant, texts))}
    for file in {file for file, _ in places.values()}:
        wrong = texts[file]
        for i, (_, place) in sorted(places.items(), key=lambda item: item[1][1], reverse=True):
            wrong = mutated(wrong, fault_of(mutants[i]), place) if places[i][0] == file else wrong
        (tree.folder / file).write_text(wrong, encoding="utf-8")
    tests = [str(path) for path in sorted(tree.folder.rglob("tests")) if "plugins" not in path.parts]
    failed = [name for stage in (QUICK, REALTIME) for name in await tree.failures(*tests, *WORKERS, *stage)]
    for file in {file for file, _ in places.values()}:
        (tree.folder / file).write_text(texts[file], encoding="utf-8")
    print(f"{len(failed)} tests fail with {len(places)} mutants at once:", *failed, sep="\n  ", flush=True)
    for i in mutants.keys() - places.keys():
        yield i, {"state": "gone"}
    for i, (file, place) in places.items():
        start = time.monotonic()
        wrong = mutated(texts[file], fault_of(mutants[i]), place)
        test = await tree.killer(file, wrong, failed) if failed else None
        yield i, _judged(tree, file, test, "lives", time.monotonic() - start)


def load() -> dict[str, Any]:
    """The result so far."""
    known: dict[str, Any] = json.loads(RESULT.read_text()) if RESULT.exists() else {"mutants": draw(), "trees": {}}
    return known


def save(which: str, kept: dict[str, Any]) -> None:
    """Write the result of a tree, completely or not at all; another process may be at the other tree."""
    known = load()
    result = {"setup": {"seed": SEED, "old": OLD}, "mutants": known["mutants"], "trees": known["trees"] | {which: kept}}
    RESULTS.mkdir(exist_ok=True)
    part = RESULT.with_suffix(f".{which}.part")
    part.write_text(json.dumps({**result, **describe()}, indent=2) + "\n")
    part.replace(RESULT)


async def run(which: str, only: list[int], jobs: int, *, is_short: bool) -> None:
    """Judge the mutants of a tree that have no verdict yet."""
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, asyncio.current_task().cancel)  # type: ignore[union-attr]
    asked = ["git", "rev-parse", REVISIONS[which]]
    commit = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603
    texts, result = sources(commit), load()
    kept: dict[str, Any] = result["trees"].setdefault(which, {"broken": [], "verdicts": {}})
    verdicts, others = (
        (result["trees"].get(name) or {"verdicts": {}})["verdicts"] for name in sorted(REVISIONS, key=which.__ne__)
    )
    numbers = map(str, only or range(len(result["mutants"])))
    left = iter([i for i in numbers if only or i not in verdicts])

    def keep(i: str, judged: dict[str, Any]) -> None:
        verdicts[i] = judged | {"commit": commit}
        save(which, kept)
        print(which, i, *(judged.get(key) for key in ("state", "test", "seconds")), flush=True)

    @contextlib.contextmanager
    def copy_of_tree() -> Iterator[Tree]:
        scratch = Path(tempfile.mkdtemp(prefix="mutants-"))
        try:
            yield Tree.make(commit, scratch, kept["broken"])
        finally:
            shutil.rmtree(scratch, ignore_errors=True)

    async def work() -> None:
        with copy_of_tree() as tree:
            for i in left:
                keep(i, await verdict(tree, result["mutants"][int(i)], texts, others.get(i, {}).get("test") or ""))

    async with asyncio.TaskGroup() as group:
        for _ in range(jobs):
            group.create_task(work())
    lasting = {i: result["mutants"][int(i)] for i, one in verdicts.items() if one["state"] == SURVIVED}
    if lasting and not is_short:
        with copy_of_tree() as tree:
            async for i, judged in far_verdicts(tree, lasting, texts):
                keep(i, judged)


def shown(mutant: dict[str, Any]) -> str:
    """A fault with a few letters around it."""
    before, after = (" ".join(mutant[key].split()) for key in ("before", "after"))
    start = max(0, _common(before, after) - 20)
    end = max(0, _common(before[:start:-1], after[:start:-1]) - 20)
    short = [("… " if start else "") + text[start : len(text) - end] + (" …" if end else "") for text in (before, after)]
    return " → ".join(f"`{text if len(text) <= 70 else text[:67] + ' …'}`" for text in short).replace("|", "\\|")


def _common(one: str, other: str) -> int:
    return next((i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))


def report(result: dict[str, Any]) -> str:
    """A table of all mutants, the sums of both trees, and those that died before and do not now."""
    mutants, nothing = result["mutants"], {"broken": list[str](), "verdicts": dict[str, Any]()}
    trees = [result["trees"].get(which, nothing) for which in REVISIONS]
    verdicts = [[tree["verdicts"].get(str(i), {"state": "not run"}) for tree in trees] for i in range(len(mutants))]
    where = [f"`{mutant['file'].removeprefix('src/bricksrl/')}` {mutant['function']}" for mutant in mutants]
    rows = [
        (str(i), mutants[i]["house"], where[i], shown(mutants[i]), *(one.get("test") or one["state"] for one in verdicts[i]))
        for i in range(len(mutants))
    ]
    lines = [table(("no.", "house", "where", "fault", f"found at {OLD} by", "found now by"), rows)]
    for which, tree, judged in zip(REVISIONS, trees, zip(*verdicts, strict=True), strict=True):
        sums = ", ".join(f"{n} {state}" for state, n in Counter(one["state"] for one in judged).items())
        lines.append(f"{which}: {sums}; tests left out: {', '.join(tree['broken']) or 'none'}")
    lost = [i for i, (old, new) in enumerate(verdicts) if old["state"] == "died" and new["state"] not in ("died", "not run")]
    return "\n".join([*lines, f"died before and not now: {lost or 'none'}"])


def main(session: Session) -> None:
    """Judge the mutants of a tree, or print the table."""
    parser = session.parser
    parser.add_argument("--tree", choices=REVISIONS)
    parser.add_argument("--only", type=int, nargs="+", default=[])
    parser.add_argument("--folder-only", action="store_true")
    parser.add_argument("--table", action="store_true")
    args = session.parse()
    if args.tree:
        with contextlib.suppress(asyncio.CancelledError):  # ended by SIGTERM
            asyncio.run(run(args.tree, args.only, session.jobs or 1, is_short=args.folder_only))
    if args.table:
        print(report(load()))
