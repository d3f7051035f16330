"""``bricksrl study``: run a predefined study of several trainings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from bricksrl.cli.options import Flag, option
from bricksrl.cli.terminal import INTERRUPTED, load_learning, print_interrupted, print_line


@dataclass(frozen=True)
class StudyCommand:
    """Train and evaluate a whole table of agents and environments, with several seeds, and write its numbers and its page.

    Without a name, list the studies and their durations. The same command resumes an interrupted study and repeats no finished
    run.

    Examples:
      bricksrl study
      bricksrl study communication --quick
      bricksrl study agents
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
    folder: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder of the study; by default studies/<name>, or studies/<name>-quick."""

    def execute(self) -> int:
        """Run the study, or list the studies."""
        from bricksrl.errors import RunError
        from bricksrl.evaluation.study_tables import STUDIES, get_study

        if self.name is None:
            for one in STUDIES.values():
                print_line(f"{one.name:15} {one.title}; {one.hours:g} h on two cores, --quick {one.quick_minutes:g} min")
            return 0
        study = get_study(self.name)
        for name in ("seeds", "jobs"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise RunError(f"{name} is {value}; give 1 or more")
        folder = self.folder or Path("studies") / (f"{study.name}-quick" if self.quick else study.name)
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
        print_line(f"tables   {page}")
        print_line(f"numbers  {folder / 'study.json'}")
        return 0
