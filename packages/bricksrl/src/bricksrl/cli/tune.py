"""``bricksrl tune``: hyperparameter tuning of an agent."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from brickhub.cli.options import option
from brickhub.cli.terminal import Interrupted, print_line
from brickhub.files import quoted
from bricksrl.cli.terminal import load_learning


@dataclass(frozen=True)
class Tune:
    """Tune the hyperparameters of an agent for a fixed number of robot steps.

    Optuna proposes settings; each is trained with some seeds and evaluated in simulation. The folder gets the study and best.json
    for `bricksrl train --settings`. The same command continues the study, also from several terminals at once.

    Examples:
      bricksrl tune WalkerSim-v0 --agent sac --trials 50
      bricksrl train WalkerSim-v0 --settings tuning/WalkerSim-v0-sac/best.json
    """

    env: Annotated[Positional[str], option(metavar="ENV")]
    """Environment; `bricksrl list` shows them. Kinematic simulations are the fastest."""
    agent: Annotated[str, option(metavar="NAME")] = "sac"
    """Agent; `bricksrl list` shows them."""
    trials: Annotated[int, option(metavar="N")] = 20
    """Trials to run with this command."""
    steps: Annotated[int, option(metavar="N")] = 2000
    """Robot steps of each training."""
    seeds: Annotated[int, option(metavar="N")] = 2
    """Trainings per trial; bad trials are pruned early."""
    episodes: Annotated[int, option(metavar="N")] = 10
    """Episodes of each evaluation."""
    seed: Annotated[int, option(metavar="N")] = 0
    """Seed of the proposals."""
    folder: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder of the study; by default tuning/<env>-<agent>."""
    on: Annotated[str | None, option(metavar="WHERE")] = None
    """Train the seeds of a trial in parallel: ray, or ray:ADDRESS for a cluster (pip install 'bricksrl[distributed]')."""

    def execute(self) -> None:
        from bricksrl.errors import RunError
        from bricksrl.evaluation.tuning import BEST, STUDY, Tuning, tune
        from bricksrl.training.run_folder import file_name

        if self.trials < 1:
            raise RunError(f"trials is {self.trials}; give 1 or more")
        tuning = Tuning(self.env, self.agent, self.steps, self.seeds, self.episodes)
        folder = self.folder or Path("tuning") / f"{file_name(self.env)}-{file_name(self.agent)}"

        def report(trial: int, value: float | None, best: float | None) -> None:
            outcome = "ended early" if value is None else f"return {value:.4g}"
            print_line(f"trial {trial}  {outcome}" + ("" if best is None else f"  best {best:.4g}"))

        try:
            load_learning()
            best = tune(tuning, folder, self.trials, seed=self.seed, on=self.on, on_trial=report)
        except KeyboardInterrupt:
            kept = f"the study is in {folder}; the same command goes on with it"
            raise Interrupted(kept if (folder / STUDY).exists() else "nothing was saved") from None
        print_line(f"best of {best.trials} finished trials: return {best.value:.4g}")
        command = ["bricksrl", "train", self.env, "--agent", self.agent, "--settings", str(folder / BEST)]
        print_line(f"train with it   {' '.join(map(quoted, command))}")
