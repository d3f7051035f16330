"""Mutants: small faults in the source, and the tests that find them.

    python -m benchmarks mutants [--count 60] [--seed 36] [--only 3 7]
    python -m benchmarks mutants --table

Faults of the last commit are drawn by a seed, two thirds of them in the two lower houses: a file by
its number of statements, then an operator, then a place. Each is put into a copy of the tree, where
tests of `make test` run up to the first that fails. It counts if the test, run alone, fails again
with the fault and passes without it. What never ends has failed. Verdicts in the result are not
repeated, unless `--only` names them: an interrupted script resumes.

The tests are those that enter the function (`benchmarks.entries` makes the map first, which takes
as long as all tests), or, for a constant of a module or class, a function that mentions it, or any
of its file where none does: those nearest to the file first, up to two minutes of them. Where no
test enters it, they are those of the module's name, and for a module that Python does not execute,
as programs on the hub, those of the house. What no test finds mypy may: `make test` begins with
it. A fault that only further tests find counts as alive.

Not drawn is what makes an equal program: no size of a cache, no ``strict`` of a ``zip``, no
``check=False`` of `subprocess.run`, which is its default, and no default of an ``overload``; and
nothing in annotations, decorators and texts.
"""

from __future__ import annotations

import ast
import copy
import random
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.entries import Entries, complete, that_mention
from benchmarks.forked_tests import ForkedTests
from benchmarks.formatting import table
from benchmarks.session import Session, read_result

ROOT = Path(__file__).parent.parent
SHARES = {"brickhub": 0.4, "bricktwin": 0.27, "bricksrl": 0.33}
TEMPLATES = "cli/templates"
TEST_S, QUIET_S = 180.0, 400.0
"""Longest time of a test without a limit of its own, and of a run of pytest that reports
nothing."""
LOG = "log.txt"
TESTS_S = 120.0
"""CPU time of the tests that a fault is tried with, without the start of pytest."""

_BOUNDARY = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_NEGATION = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
_NEGATION |= {ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In}
_ARITHMETIC = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
}
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
        if keyword.arg and keyword.arg != "strict" and not _is_default(keyword):
            yield "keyword", _with(node, keywords=node.keywords[:i] + node.keywords[i + 1 :])


def _is_cache(function: ast.expr) -> bool:
    return ast.unparse(function) in ("lru_cache", "functools.lru_cache")


def _is_default(keyword: ast.keyword) -> bool:
    """Whether it says what holds without it: ``check=False`` of `subprocess.run`."""
    return keyword.arg == "check" and ast.unparse(keyword.value) == "False"


def _expressions(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Compare():
            yield from _comparisons(node)
        case ast.BinOp(left=left, op=op, right=right):
            is_text = any(
                isinstance(side, ast.JoinedStr | ast.Constant) and not _is_number(side)
                for side in (left, right)
            )
            if not is_text and (other := _ARITHMETIC.get(type(op))):
                yield "arithmetic", _with(node, op=other())
        case ast.Constant():
            yield from _constants(node)
        case ast.BoolOp(op=op):
            yield "and, or", _with(node, op=ast.Or() if isinstance(op, ast.And) else ast.And())
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            yield "not", operand
        case ast.Call() if not _is_cache(node.func):
            yield from _calls(node)


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float)


def _statements(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Return(value=ast.expr() as value):
            if not isinstance(value, ast.Constant) or value.value is not None:
                yield "return", ast.Return(ast.Constant(None))
            if isinstance(value, ast.Compare | ast.BoolOp) or (
                isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not)
            ):
                yield "return", ast.Return(ast.UnaryOp(ast.Not(), value))
        case ast.Expr(value=ast.Call()):
            yield "statement", ast.Pass()
        case ast.Assign(targets=[ast.Attribute()]) | ast.AugAssign(target=ast.Attribute()):
            yield "statement", ast.Pass()


def _children(node: ast.AST) -> list[ast.AST]:
    """What is executed of a node: no annotations, decorators and texts, nothing for types or for a
    script alone."""
    match node:
        case ast.FunctionDef(decorator_list=[ast.Name(id="overload")]):
            return []
        case (
            ast.FunctionDef(args=arguments, body=body)
            | ast.AsyncFunctionDef(args=arguments, body=body)
        ):
            return [*arguments.defaults, *filter(None, arguments.kw_defaults), *body]
        case ast.ClassDef(body=body):
            return [*body]
        case ast.AnnAssign(value=value):
            return [value] if value else []
        case ast.If(test=test) if ast.unparse(test) in ("TYPE_CHECKING", "__name__ == '__main__'"):
            return []
        case ast.JoinedStr():
            return []
        case ast.Call(func=function) if _is_cache(function):
            return []
        case ast.keyword(arg="strict"):
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
            assert (
                isinstance(node, ast.expr | ast.stmt)
                and node.end_lineno
                and node.end_col_offset is not None
            )
            known = (
                function,
                operator,
                ast.unparse(node),
                ast.unparse(ast.fix_missing_locations(other)),
            )
            begin, end = (
                starts[node.lineno - 1] + node.col_offset,
                starts[node.end_lineno - 1] + node.end_col_offset,
            )
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


def draw(tree: Path, seed: int, count: int) -> list[dict[str, Any]]:
    """Mutants of a tree, in random order."""
    rng, drawn = random.Random(seed), list[dict[str, Any]]()
    for house, share in SHARES.items():
        found = sorted(
            path
            for path in (tree / "packages" / house / "src").rglob("*.py")
            if TEMPLATES not in str(path)
        )
        texts = {
            str(path.relative_to(tree)): text
            for path in found
            if faults(text := path.read_text(encoding="utf-8"))
        }
        weights = [
            sum(isinstance(node, ast.stmt) for node in ast.walk(ast.parse(text)))
            for text in texts.values()
        ]
        chosen: dict[tuple[str, Fault], None] = {}
        while len(chosen) < max(1, round(share * count)):
            file = rng.choices(list(texts), weights)[0]
            by_operator = defaultdict(list)
            for fault in faults(texts[file]):
                by_operator[fault.operator].append(fault)
            chosen[file, rng.choice(by_operator[rng.choice(sorted(by_operator))])] = None
        drawn += [{"house": house, "file": file, **asdict(fault)} for file, fault in chosen]
    rng.shuffle(drawn)
    return drawn


@dataclass(frozen=True)
class Tree:
    """A copy of the last commit, in which one file at a time has a fault."""

    folder: Path
    scratch: Path
    entries: Entries
    runs: ForkedTests
    broken: list[str]
    """Tests that fail here without a fault; they are left out."""

    @classmethod
    def make(cls, scratch: Path, known: Path, broken: list[str]) -> Tree:
        """Check the commit out, and let the map in a file be that of its tests. Byte code is found
        by the digest of its source, so that no fault is missed."""
        folder = scratch / "tree"
        for copied in (folder, scratch / "noted"):
            command = ["git", "clone", "--quiet", "--shared", str(ROOT), str(copied)]
            subprocess.run(command, check=True)  # noqa: S603
        entries = complete(known, scratch / "noted")
        # a site copies whatever is in its folders
        arguments = (
            "-m",
            "compileall",
            "-q",
            "--invalidation-mode",
            "checked-hash",
            "-x",
            "/site/(static|programs)/",
        )
        subprocess.run([sys.executable, *arguments, *folder.glob("packages/*/src")], check=True)  # noqa: S603
        return cls(folder, scratch, entries, ForkedTests(folder, scratch / LOG), broken)

    def chosen(self, file: str, function: str) -> list[str]:
        """Names of the tests that a fault is tried with, in the order of their files."""
        seconds = self._candidates(file, function)
        by_file = defaultdict(list)
        for test in seconds:
            by_file[test.partition("::")[0]].append(test)

        def distance(tests: str) -> tuple[int, float]:
            times = [seconds[test] for test in by_file[tests]]
            return -_near(file, tests), sum(times) / len(times)

        chosen, spent_s = list[str](), 0.0
        for tests in sorted(by_file, key=distance):
            for test in by_file[tests]:
                if spent_s + seconds[test] <= TESTS_S or not chosen:
                    chosen.append(test)
                    spent_s += seconds[test]
        return chosen

    def _candidates(self, file: str, function: str) -> dict[str, float]:
        """Seconds of the tests that may find a fault, by their names."""
        by_function = self.entries.by_function
        found = dict(by_function.get(f"{file}:{function}", {}))
        if f"{file}:{function}" not in self.entries.functions:
            for name in that_mention(self.folder, function.rpartition(".")[2]):
                found |= by_function.get(name, {})
            if not found:
                # Tests alone mention it, and what it is used for is beside it.
                for name in by_function:
                    found |= by_function[name] if name.startswith(f"{file}:") else {}
        if found:
            return found
        own, house = f"/test_{Path(file).name}", file.partition("src/")[0]
        is_entered = any(name.startswith(f"{file}:") for name in by_function)
        for tests, one in self.entries.tests.items():
            if tests.endswith(own) or (not is_entered and tests.startswith(house)):
                found |= {test: seconds for test, (seconds, _) in one["tests"].items()}
        return found

    def failure(self, *arguments: str) -> str | None:
        """Run pytest up to the first failure; the name of the test that failed."""
        # the other method lets Hypothesis begin the test again
        limit = (f"--timeout={TEST_S}", "--timeout-method=thread")
        options = (
            "-x",
            "-v",
            "--color=no",
            "-p",
            "no:cacheprovider",
            "-p",
            "byte_code",
            f"--rootdir={self.folder}",
            *limit,
            "-m",
            "not slow",
        )
        words = [
            *options,
            f"--basetemp={self.scratch / 'tmp'}",
            *(f"--deselect={name}" for name in self.broken),
            *arguments,
        ]
        code = self.runs.run(words, QUIET_S)
        return (
            None
            if code in (0, 5)
            else failed_tests((self.scratch / LOG).read_text(errors="replace"))[0]
        )

    def types_find(self, file: str, wrong: str) -> bool:
        """Whether mypy refuses a file with a fault, as a function that returns nothing of what it
        promises."""
        path = self.folder / file
        right = path.read_text(encoding="utf-8")
        command = [sys.executable, "-m", "mypy", "--no-color-output"]
        try:
            path.write_text(wrong, encoding="utf-8")
            done = subprocess.run(  # noqa: S603
                command, cwd=self.folder, capture_output=True, text=True, check=False
            )
        finally:
            path.write_text(right, encoding="utf-8")
        return f"{file}:" in done.stdout

    def killer(self, file: str, function: str, wrong: str) -> str | None:
        """The test that finds a fault in a function of a file."""
        path, doubtful = self.folder / file, list[str]()
        right = path.read_text(encoding="utf-8")
        chosen = self.chosen(file, function)
        if not chosen:
            return None
        names = self.scratch / "chosen.txt"
        names.write_text("\n".join(chosen), encoding="utf-8")
        files = dict.fromkeys(test.partition("::")[0] for test in chosen)
        tests = [f"--only={names}", *files]
        try:
            path.write_text(wrong, encoding="utf-8")
            while name := self.failure(*tests, *(f"--deselect={one}" for one in doubtful)):
                alone = [*tests, "--collect-only"] if name.startswith("pytest itself") else [name]
                again = self.failure(*alone)
                path.write_text(right, encoding="utf-8")
                fails_anyway = self.failure(*alone) is not None
                if (again and not fails_anyway) or name in doubtful:
                    return name.replace(f"{self.folder}/", "")
                self.broken.extend([name] if fails_anyway else [])
                doubtful.append(name)
                path.write_text(wrong, encoding="utf-8")
        finally:
            path.write_text(right, encoding="utf-8")
        return None


def _near(file: str, tests: str) -> int:
    """How many folders a file of tests has in common with the one of the module's name, and one
    more if it is that."""
    mirrored = Path(file.replace("/src/", "/tests/", 1))
    own = mirrored.with_name(f"test_{mirrored.name}").parts
    own = (*own[:3], *own[4:])  # without the folder of the package
    return _common(own, Path(tests).parts)


def failed_tests(output: str) -> list[str]:
    """The names of the failed tests in what pytest has written; of the last that began if it could
    not say."""
    if names := re.findall(
        r"^(?:\[gw\d\] .*?)?(?:FAILED|ERROR) (\S+?\.py(?:::\w+)*(?:\[.*?\])?)(?: - | *$)",
        output,
        re.MULTILINE,
    ):
        return list(dict.fromkeys(names))
    if begun := re.findall(
        r"^(?:\[gw\d\] .*? )?(\S+?\.py::\w+(?:::\w+)*(?:\[.*?\])?)(?: |$)", output, re.MULTILINE
    ):
        return [str(begun[-1])]
    match = re.search(
        r"^(?:ImportError while loading conftest '(.*)'|\S*(?:Error|Exit)\b.*)",
        output,
        re.MULTILINE,
    )
    return [f"pytest itself: {(match[0] if match else output.strip()[-200:])!r}"]


def verdict(tree: Tree, mutant: dict[str, Any]) -> dict[str, Any]:
    """Whether a mutant dies, and by which test; it is ``gone`` if the tree has no such place."""
    path, fault = (
        tree.folder / mutant["file"],
        Fault(*(mutant[name] for name in Fault.__dataclass_fields__)),
    )
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    if fault not in faults(text):
        return {"state": "gone"}
    start_s = time.monotonic()
    wrong = mutated(text, fault, faults(text)[fault])
    test = tree.killer(mutant["file"], fault.function, wrong)
    if test is None and tree.types_find(mutant["file"], wrong):
        test = "mypy"
    return {
        "state": "died" if test else "survived",
        "test": test,
        "seconds": round(time.monotonic() - start_s),
    }


def shown(mutant: dict[str, Any]) -> str:
    """A fault with a few letters around it."""
    before, after = (" ".join(mutant[key].split()) for key in ("before", "after"))
    start = max(0, _common(before, after) - 20)
    end = max(0, _common(before[:start:-1], after[:start:-1]) - 20)
    short = [
        ("… " if start else "") + text[start : len(text) - end] + (" …" if end else "")
        for text in (before, after)
    ]
    return " → ".join(
        f"`{text if len(text) <= 70 else text[:67] + ' …'}`" for text in short
    ).replace("|", "\\|")


def _common(one: Sequence[str], other: Sequence[str]) -> int:
    return next(
        (i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b),
        min(len(one), len(other)),
    )


def report(result: dict[str, Any]) -> str:
    """A table of all mutants, and their sums."""
    verdicts = [
        result["verdicts"].get(str(i), {"state": "not run"}) for i in range(len(result["mutants"]))
    ]
    rows = []
    for i, (one, found) in enumerate(zip(result["mutants"], verdicts, strict=True)):
        where = f"`{one['file'].partition('/src/')[2]}` {one['function']}"
        rows.append((str(i), one["house"], where, shown(one), found.get("test") or found["state"]))
    sums = ", ".join(
        f"{n} {state}" for state, n in Counter(one["state"] for one in verdicts).items()
    )
    left_out = ", ".join(result["broken"]) or "none"
    return (
        f"{table(('no.', 'house', 'where', 'fault', 'found by'), rows)}\n{sums}; tests left "
        f"out: {left_out}"
    )


def main(session: Session) -> None:
    """Judge the mutants that have no verdict yet, or print the table."""
    parser = session.parser
    parser.add_argument("--only", type=int, nargs="+", default=[])
    parser.add_argument("--table", action="store_true")
    args = session.parse(count=60, seed=36)
    setup, result = {"seed": args.seed, "count": args.count}, session.known()
    if args.table:
        print(report(session.known() or read_result(session.published())))
        return
    with tempfile.TemporaryDirectory(prefix="mutants-") as scratch:
        known = session.folder / "entries.json"
        if session.is_again:
            known.unlink(missing_ok=True)
        tree = Tree.make(Path(scratch), known, result.get("broken", []))
        if result.get("setup") != setup:
            mutants = draw(tree.folder, args.seed, args.count)
            result = {"setup": setup, "mutants": mutants, "verdicts": {}, "broken": tree.broken}
        for i, mutant in enumerate(result["mutants"]):
            if i in args.only if args.only else str(i) not in result["verdicts"]:
                result["verdicts"][str(i)] = judged = verdict(tree, mutant)
                session.write(result)
                print(i, *(judged.get(key) for key in ("state", "test", "seconds")), flush=True)
        tree.runs.close()
    print(report(result))
