"""``bricksrl study``: run a predefined study of several trainings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.options import Flag, option, refuse_ignored
from brickhub.cli.terminal import Interrupted, print_line
from bricksrl.cli.terminal import load_learning


@dataclass(frozen=True)
class StudyCommand:
    """Train and evaluate a table of agents and environments with several seeds; write its numbers and a page.

    Without a name, list the studies and their durations. The same command resumes an interrupted study without repeating finished
    runs. A study made of benchmarks in the repository reuses their existing results.

    Examples:
      bricksrl study
      bricksrl study communication --quick
      bricksrl study agents --only "*-Spinning-v0"
      bricksrl study offline
      bricksrl study sim-to-robot --seeds 10 --on ray
    """

    name: Annotated[Positional[str | None], option(metavar="NAME")] = None
    """Name of the study."""
    quick: Flag = False
    """Run only a few episodes of some cells, as a smoke test."""
    seeds: Annotated[int | None, option(metavar="N")] = None
    """Seeds per cell; by default those of the study, or 2 with --quick."""
    jobs: Annotated[int | None, option(metavar="N")] = None
    """Concurrent processes; by default the number of cores."""
    on: Annotated[str | None, option(metavar="WHERE")] = None
    """Where to run: ray, or ray:ADDRESS for a cluster whose computers share the folder."""
    only: Annotated[tuple[str, ...], option(metavar="PATTERN")] = ()
    """Run only the cells whose names match, e.g. "*RunAway-v0" "td3-*"; the page shows all cells that were run."""
    folder: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder of the study; by default studies/<name>, or studies/<name>-quick."""
    benchmarks: Annotated[Path, option(metavar="DIR")] = Path("benchmarks")
    """Folder of the repository's benchmarks."""

    def execute(self) -> None:
        from bricksrl.errors import RunError, UnknownNameError, hint
        from bricksrl.evaluation.cluster import parse_on
        from bricksrl.evaluation.study_benchmarks import BENCHMARK_STUDIES, BenchmarkStudy, run_benchmark_study
        from bricksrl.evaluation.study_tables import STUDIES, Study

        if self.name is None:
            refuse_ignored(self, (), "without a study's name")
            studies: list[Study | BenchmarkStudy] = [*STUDIES.values(), *BENCHMARK_STUDIES.values()]
            for study in studies:
                note = "" if study.name in STUDIES else ", less if results exist"
                line = f"{study.name:15} {study.title}; {study.hours:g} h on two cores{note}, --quick {study.quick_minutes:g} min"
                print_line(line)
            return
        if self.name not in (*STUDIES, *BENCHMARK_STUDIES):
            known = (*STUDIES, *BENCHMARK_STUDIES)
            raise UnknownNameError(f"there is no study '{self.name}'{hint(self.name, known)}; choose {', '.join(known)}")
        for name in ("seeds", "jobs"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise RunError(f"{name} is {value}; give 1 or more")
        folder = self.folder or Path("studies") / (f"{self.name}-quick" if self.quick else self.name)
        if self.name in BENCHMARK_STUDIES:
            mode = f"on '{self.name}', whose runs are those of benchmarks"
            refuse_ignored(self, ("--name", "--quick", "--folder", "--benchmarks"), mode)
            with _kept(folder):
                page = run_benchmark_study(BENCHMARK_STUDIES[self.name], folder, self.benchmarks, quick=self.quick)
            _print(page)
            return
        kept = ("--name", "--quick", "--seeds", "--jobs", "--on", "--only", "--folder")
        refuse_ignored(self, kept, f"on '{self.name}', whose runs need no benchmark")
        study = STUDIES[self.name]
        if self.on is not None:
            parse_on(self.on)
        load_learning()
        from bricksrl.evaluation.study import run_study

        duration = f"{study.quick_minutes:g} minutes" if self.quick else f"{study.hours:g} hours"
        print_line(f"{study.title}: {'cells of ' if self.only else ''}some {duration} on two cores, into {folder}")

        def report(cell: str, seed: int, error: str | None) -> None:
            print_line(f"{cell}  seed {seed}  {'done' if error is None else f'failed: {error}'}")

        run = partial(run_study, study, folder, quick=self.quick, seeds=self.seeds, jobs=self.jobs)
        with _kept(folder):
            page = run(on=self.on, only=self.only, on_seed=report)
        _print(page)


@contextmanager
def _kept(folder: Path) -> Iterator[None]:
    """After Ctrl-C in this context, raise Interrupted, which says what is saved."""
    try:
        yield
    except KeyboardInterrupt:
        kept = f"finished runs are in {folder}; the same command resumes the study"
        raise Interrupted(kept if folder.exists() else "nothing was saved") from None


def _print(page: Path) -> None:
    print_line(f"tables   {page}")
    print_line(f"numbers  {page.with_suffix('.json')}")
