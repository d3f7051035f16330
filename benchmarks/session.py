"""A session with a benchmark: its command line, its folder of finished parts, its result."""

from __future__ import annotations

import itertools
import json
import shlex
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from benchmarks.machine import describe
from brickhub.errors import BricksError, DescriptionError
from brickhub.files import write_durably

RESULTS = Path(__file__).parent / "results"
"""The published results, of which the tables of the documentation are written."""


@dataclass(frozen=True)
class Benchmark:
    """A row of the registry; the function is ``main(session)`` of the module.

    Attributes:
        title: what it measures.
        minutes, quick_minutes: approximate duration on two cores.
        quick: arguments of the quick form, which shows that everything works and says nothing else.
        needs: arguments without which it cannot run.
        also: further results that its page shows.
    """

    name: str
    title: str
    minutes: float
    quick_minutes: float
    quick: str = ""
    needs: str = ""
    also: tuple[str, ...] = ()

    @property
    def module(self) -> str:
        """Name of the module below ``benchmarks``."""
        return self.name

    @property
    def result(self) -> str:
        """Name of the published result."""
        return self.name


class Arguments(ArgumentParser):
    """A parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        raise DescriptionError(f"{message}; `{self.prog} --help` lists the options")


class Session:
    """One run of a benchmark. Without ``--quick`` and ``--folder`` its result is a published one.

    Attributes:
        parser: where the benchmark adds its options.
        folder: of the finished parts.
        jobs: number of concurrent processes, if it was given.
        is_apart: whether the folder has the result too, as ``study.json`` with the page
            ``study.md``.
    """

    def __init__(self, benchmark: Benchmark, description: str, words: Sequence[str]) -> None:
        prog = f"python -m benchmarks {benchmark.name}"
        common = Arguments(prog=prog, add_help=False, allow_abbrev=False)
        common.add_argument(
            "--quick", action="store_true", help="a small form, to see that everything works"
        )
        common.add_argument(
            "--folder",
            type=Path,
            metavar="DIR",
            help="folder of the finished parts, and of the result, which is otherwise in "
            "benchmarks/results, as the parts in "
            f"studies/{benchmark.name}; a published result is shown there, and measured only with "
            "other options or --again",
        )
        common.add_argument("--again", action="store_true", help="make what is there again")
        common.add_argument(
            "--jobs",
            type=int,
            metavar="N",
            help="concurrent processes, where nothing is timed (default: the number of cores)",
        )
        given, self.words = common.parse_known_args(words)
        self.benchmark, self.is_quick, self.is_again = benchmark, given.quick, given.again
        if given.jobs is not None and given.jobs < 1:
            raise DescriptionError(f"jobs is {given.jobs}; give 1 or more")
        self.jobs: int | None = given.jobs
        self.is_apart = given.quick or given.folder is not None
        self.folder: Path = (
            given.folder or Path("studies") / f"{benchmark.name}{'-quick' if given.quick else ''}"
        )
        self.parser = Arguments(
            prog=prog,
            description=description,
            parents=[common],
            formatter_class=RawDescriptionHelpFormatter,
        )

    def parse(self, **defaults: Any) -> Namespace:
        """The options, those of the quick form unless they are given. ``defaults`` are further
        options: numbers, texts, and lists of which some may be chosen."""
        for name, default in defaults.items():
            kind: dict[str, Any] = (
                {"nargs": "+", "choices": default}
                if isinstance(default, list)
                else {"type": type(default)}
            )
            self.parser.add_argument(f"--{name.replace('_', '-')}", default=default, **kind)
        return self.parser.parse_args(
            [*(shlex.split(self.benchmark.quick) if self.is_quick else ()), *self.words]
        )

    def place_of(self, folder: Path) -> Path:
        """A folder of pictures or of datasets; if this session is apart, one of that name in its
        own folder."""
        place = self.folder / folder.name if self.is_apart else folder
        place.mkdir(parents=True, exist_ok=True)
        return place

    def outcomes(
        self,
        function: Callable[..., Any],
        parts: Mapping[str, tuple[Any, ...]],
        processes: int | None = None,
        *,
        fresh: bool = False,
    ) -> Iterator[Any]:
        """Outcomes of the parts by name, as `outcomes` makes them; those of an earlier run of the
        same command are kept. Raises RunError at the first that fails."""
        from benchmarks.parts import Failure, outcomes
        from bricksrl.errors import RunError

        paths = {self.folder / f"{name}.json": arguments for name, arguments in parts.items()}
        if self.is_again:
            for path in paths:
                path.unlink(missing_ok=True)
        there = sum(path.exists() for path in paths)
        if there:
            print(
                f"{there} of {len(paths)} parts are in {self.folder}; --again makes them again",
                flush=True,
            )
        for path, outcome in zip(
            paths, outcomes(function, paths, processes or self.jobs, fresh=fresh), strict=True
        ):
            if isinstance(outcome, Failure):
                raise RunError(f"{path.stem}: {outcome}")
            print(f"{path.stem} done", flush=True)
            yield outcome

    def by_seed(
        self, function: Callable[..., Any], cells: Mapping[str, tuple[Any, ...]], seeds: int
    ) -> dict[str, list[Any]]:
        """Outcomes of the seeds 0, 1, ... of each cell, by its name: of the function of the cell's
        arguments and a seed."""
        parts = {
            f"{name}-{seed}": (*arguments, seed)
            for name, arguments in cells.items()
            for seed in range(seeds)
        }
        found = self.outcomes(function, parts)
        return {name: list(itertools.islice(found, seeds)) for name in cells}

    def path(self, variant: str = "") -> Path:
        """File of the result, or of a variant, such as ``_default``."""
        return (
            self.folder / f"study{variant}.json"
            if self.is_apart
            else self.published(f"{self.benchmark.result}{variant}")
        )

    def published(self, name: str = "") -> Path:
        """File of the published result of this benchmark, or of another one."""
        return RESULTS / f"{name or self.benchmark.result}.json"

    def shows_published(self) -> bool:
        """Whether the published result is shown in a folder, rather than measured. A study has runs
        of its own in each folder."""
        is_plain = not self.is_quick and not self.is_again and not self.words
        return (
            self.is_apart
            and is_plain
            and self.benchmark.result == self.benchmark.name
            and self.published().exists()
        )

    def known(self, variant: str = "") -> dict[str, Any]:
        """The result so far; empty if there is none."""
        path = self.path(variant)
        return read_result(path) if path.exists() else {}

    def write(self, result: Mapping[str, Any], variant: str = "") -> None:
        """Write the result, with machine, versions and code."""
        from benchmarks.provenance import code_of

        code = code_of(f"benchmarks.{self.benchmark.module}")
        write_result(self.path(variant), {**result, **describe(), "code": code})
        print(f"numbers  {self.path(variant)}", flush=True)


def duration(minutes: float) -> str:
    """Minutes, or hours."""
    return f"{minutes:g} min" if minutes < 120 else f"{minutes / 60:.3g} h"


def read_result(path: Path) -> dict[str, Any]:
    """The result in a file. Raises BricksError if it is none."""
    try:
        result = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        result = None
    if not isinstance(result, dict) or not result.keys() >= {"machine", "versions"}:
        raise BricksError(
            f"{path} is not the result of a benchmark; delete it, and the same command measures "
            "it again"
        )
    return result


def write_result(path: Path, result: Mapping[str, Any]) -> None:
    """Write a result to a file."""
    write_durably(path, (json.dumps(result, indent=2) + "\n").encode())
