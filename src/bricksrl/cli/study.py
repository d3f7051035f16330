"""``bricksrl study``: the tables behind the claims, each by one command."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from bricksrl.cli.terminal import INTERRUPTED, load_learning, print_interrupted, print_line


@dataclass(frozen=True)
class StudyCommand:
    """Train and evaluate a whole table, with several seeds, and write its numbers and its page.

    Without a name it says which studies there are and how long they take. What was made is not made again: the same command goes
    on where it was interrupted. Studies of the repository's benchmarks take the results that lie there.

    Examples:
      bricksrl study
      bricksrl study communication --quick
      bricksrl study agents
      bricksrl study offline
      bricksrl study sim-to-robot --seeds 10 --on ray
    """

    name: Annotated[Positional[str | None], arg(metavar="NAME")] = None
    """Study."""
    quick: bool = False
    """A few episodes of some of its cells: to see that everything works."""
    seeds: Annotated[int | None, arg(metavar="N")] = None
    """Of each cell; without it those of the study, and 2 with --quick."""
    jobs: Annotated[int | None, arg(metavar="N")] = None
    """Processes at a time; without it as many as there are cores."""
    on: Annotated[str | None, arg(metavar="WHERE")] = None
    """Run it there: ray, or ray:ADDRESS for a cluster whose computers all see the folder."""
    folder: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder of the study; without it studies/<name>, or studies/<name>-quick."""
    benchmarks: Annotated[Path, arg(metavar="DIR")] = Path("benchmarks")
    """Folder of the repository's benchmarks."""

    def execute(self) -> int:
        """Make it, or tell what there is."""
        from bricksrl.errors import RunError, UnknownNameError
        from bricksrl.evaluation.study_benchmarks import BENCHMARK_STUDIES, BenchmarkStudy, take_study
        from bricksrl.evaluation.study_tables import STUDIES, Study

        if self.name is None:
            every: list[Study | BenchmarkStudy] = [*STUDIES.values(), *BENCHMARK_STUDIES.values()]
            for one in every:
                taken = "" if one.name in STUDIES else ", at once where it was measured"
                print_line(f"{one.name:15} {one.title}; {one.hours:g} h on two cores{taken}, --quick {one.quick_minutes:g} min")
            return 0
        if self.name not in (*STUDIES, *BENCHMARK_STUDIES):
            raise UnknownNameError(f"there is no study '{self.name}'; choose {', '.join((*STUDIES, *BENCHMARK_STUDIES))}")
        for name in ("seeds", "jobs"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise RunError(f"{name} is {value}; give 1 or more")
        folder = self.folder or Path("studies") / (f"{self.name}-quick" if self.quick else self.name)
        if self.name in BENCHMARK_STUDIES:
            self._print(take_study(BENCHMARK_STUDIES[self.name], folder, self.benchmarks, quick=self.quick))
            return 0
        study = STUDIES[self.name]
        load_learning()
        from bricksrl.evaluation.study import run_study

        took = f"{study.quick_minutes:g} minutes" if self.quick else f"{study.hours:g} hours"
        print_line(f"{study.title}: some {took} on two cores, into {folder}")

        def tell(cell: str, seed: int, error: str | None) -> None:
            print_line(f"{cell}  seed {seed}  {'done' if error is None else f'failed: {error}'}")

        try:
            page = run_study(study, folder, quick=self.quick, seeds=self.seeds, jobs=self.jobs, on=self.on, on_seed=tell)
        except KeyboardInterrupt:
            print_interrupted(f"what was made is in {folder}; the same command goes on with it")
            return INTERRUPTED
        self._print(page)
        return 0

    def _print(self, page: Path) -> None:
        print_line(f"tables   {page}")
        print_line(f"numbers  {page.with_suffix('.json')}")
