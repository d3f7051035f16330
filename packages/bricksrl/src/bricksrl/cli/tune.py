"""Many trainings: ``bricksrl tune``, and ``bricksrl study``, the door to the benchmarks of the
repository."""

import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.terminal import Interrupted, print_line
from brickhub.fields import Count
from brickhub.files import quoted
from brickhub.options import Flag, Seed, option, refuse_ignored
from bricksrl.cli.terminal import load_learning
from bricksrl.envs.registry import get_task
from bricksrl.errors import RunError
from bricksrl.evaluation.tuning import BEST, STUDY, Tuning, tune
from bricksrl.training.run_folder import file_name


@dataclass(frozen=True)
class Tune(Tuning):
    """Tune the hyperparameters of an agent for a fixed number of robot steps.

    Optuna proposes settings; each is trained with some seeds and evaluated in simulation. The
    folder gets the study and best.json for `bricksrl train --settings`. The same command continues
    the study, also from several terminals at once.

    Examples:
      bricksrl tune WalkerSim-v0 --agent sac --trials 50
      bricksrl train WalkerSim-v0 --settings tuning/WalkerSim-v0-sac/best.json
    """

    trials: Annotated[Count, option(metavar="N")] = 20
    """Trials to run with this command."""
    seed: Seed = 0
    """Seed of the proposals."""
    folder: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder of the study; by default tuning/<env>-<agent>."""
    on: Annotated[str | None, option(metavar="WHERE")] = None
    """Train the seeds of a trial in parallel: ray, or ray:ADDRESS for a cluster (pip install
    "bricksrl[distributed]")."""

    def execute(self) -> None:
        tuning = Tuning(self.env, self.agent, self.steps, self.seeds, self.episodes)
        folder = self.folder or Path("tuning") / f"{file_name(self.env)}-{file_name(self.agent)}"

        def report(trial: int, value: float | None, best: float | None) -> None:
            outcome = "ended early" if value is None else f"return {value:.4g}"
            print_line(f"trial {trial}  {outcome}" + ("" if best is None else f"  best {best:.4g}"))

        get_task(self.env)  # raises if there is none
        try:
            load_learning()
            best = tune(tuning, folder, self.trials, seed=self.seed, on=self.on, on_trial=report)
        except KeyboardInterrupt:
            kept = f"the study is in {folder}; the same command goes on with it"
            raise Interrupted(kept if (folder / STUDY).exists() else "nothing was saved") from None
        print_line(f"best of {best.trials} finished trials: return {best.value:.4g}")
        command = [
            "bricksrl",
            "train",
            self.env,
            "--agent",
            self.agent,
            "--settings",
            str(folder / BEST),
        ]
        print_line(f"train with it   {' '.join(map(quoted, command))}")


@dataclass(frozen=True)
class StudyCommand:
    """Train and evaluate a table of agents and environments with several seeds; write its numbers
    and a page.

    Studies are in the repository: run this in a clone. Without a name, list them with all other
    benchmarks and their durations. The same command resumes an interrupted study without repeating
    finished runs. Where the repository has the result of another benchmark, that is shown.

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
    """Run only the cells whose names match, e.g. "*RunAway-v0" "td3-*"; the page shows all cells
    that were run."""
    folder: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder of the study; by default studies/<name>, or studies/<name>-quick."""
    benchmarks: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder of the repository's benchmarks; by default found above this package or the working
    folder."""

    def execute(self) -> int:
        words = []
        if self.name is None:
            refuse_ignored(self, ("--benchmarks",), "without a study's name")
        else:
            folder = self.folder or Path("studies") / (
                f"{self.name}-quick" if self.quick else self.name
            )
            words = [self.name, *(["--quick"] if self.quick else []), "--folder", str(folder)]
            for name, value in (("--seeds", self.seeds), ("--jobs", self.jobs), ("--on", self.on)):
                words += [] if value is None else [name, str(value)]
            words += ["--only", *self.only] if self.only else []
        sys.path.insert(0, str(_found(self.benchmarks).parent))  # processes inherit it
        code: int = import_module("benchmarks.__main__").run(words)
        return code


def _found(named: Path | None) -> Path:
    """The folder of the benchmarks. Raises RunError if there is none."""
    above = [*Path(__file__).resolve().parents, Path.cwd(), *Path.cwd().parents]
    for folder in [named.resolve()] if named else (path / "benchmarks" for path in above):
        if folder.name == "benchmarks" and (folder / "registry.py").exists():
            return folder
    where = f"not in {named}" if named else "not in this package"
    remedy = "run this in the folder of the repository"
    raise RunError(f"the studies are in the folder benchmarks of the repository, {where}; {remedy}")
