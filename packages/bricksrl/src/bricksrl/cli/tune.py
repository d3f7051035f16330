"""``bricksrl tune``: many trainings, to find settings."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from brickhub.cli.terminal import Interrupted, print_line
from brickhub.fields import Count
from brickhub.files import quoted
from brickhub.options import Seed, option
from bricksrl.cli.terminal import load_learning
from bricksrl.envs.registry import get_task
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
        tuning = Tuning(
            self.env,
            self.agent,
            self.steps,
            self.seeds,
            self.episodes,
        )
        folder = self.folder or Path("tuning") / f"{file_name(self.env)}-{file_name(self.agent)}"

        def report(
            trial: int,
            value: float | None,
            best: float | None,
        ) -> None:
            outcome = "ended early" if value is None else f"return {value:.4g}"
            print_line(f"trial {trial}  {outcome}" + ("" if best is None else f"  best {best:.4g}"))

        get_task(self.env)  # raises if there is none
        try:
            load_learning()
            best = tune(
                tuning,
                folder,
                self.trials,
                seed=self.seed,
                on=self.on,
                on_trial=report,
            )
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
