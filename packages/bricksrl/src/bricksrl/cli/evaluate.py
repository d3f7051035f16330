"""``bricksrl evaluate``."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional

from brickhub.cli.options import Flag, JsonFlag, option
from brickhub.cli.terminal import Interrupted, print_line, print_note
from bricksrl.cli.terminal import load_learning
from bricksrl.cli.video import check_film
from bricksrl.errors import StoppedError, TwinError, counted, percent

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.evaluation import EvaluationResult

_FILMED_EPISODES = 3


@dataclass(frozen=True)
class Evaluate:
    """Evaluate a trained agent, without exploration or learning.

    Examples:
      bricksrl evaluate runs/spin
      bricksrl evaluate runs/spin --episodes 20 --seed 7 --json
      bricksrl evaluate runs/spin --video spin.mp4
      bricksrl evaluate runs/spin --hub ble
    """

    run: Annotated[Positional[Path], option(metavar="RUN")]
    """Folder that `bricksrl train` wrote."""
    env: Annotated[str | None, option(metavar="ENV")] = None
    """Environment; by default that of the training. It gets the options of the training that it has."""
    episodes: Annotated[int, option(metavar="N")] = 5
    """Episodes to evaluate."""
    seed: Annotated[int, option(metavar="N")] = 1000
    """Seed of the episodes; another seed gives other initial states."""
    hub: Annotated[str | None, option(metavar="HUB")] = None
    """How to reach the robot: virtual, ble, ble:NAME, ble:ADDRESS, usb or usb:PORT; by default as in training."""
    realtime: Flag = False
    """Run the virtual robot in real time."""
    randomize: Flag = False
    """Draw new physics of the virtual robot for each episode; by default off, even if the training randomized."""
    physics: Annotated[Path | None, option(metavar="FILE")] = None
    """Physics of the virtual robot: a JSON file such as `bricksrl twin fit` writes; by default as in training."""
    best: Flag = False
    """Use the checkpoint of the best evaluation during training instead of the last one."""
    video: Annotated[Path | None, option(metavar="FILE")] = None
    """Film up to three of the episodes into this mp4 file."""
    json: JsonFlag = False

    def execute(self) -> None:
        from bricksrl.cli.emergency_stop import EmergencyStop
        from bricksrl.evaluation import evaluate
        from bricksrl.evaluation.film import FilmOptions, check_filmable, film_run
        from bricksrl.training import RunFolder
        from bricksrl.training.restore import one_robot
        from bricktwin.twin.physics import read_physics

        if self.video is not None:
            check_film(self.video)
            hub = self.hub if self.hub is not None else one_robot(RunFolder(self.run).read_config()).hub
            if self.env is not None or hub != "virtual":
                raise TwinError(
                    "only the virtual robot of the run itself can be filmed; give --hub virtual, without --env, or no --video"
                )
        film_options = FilmOptions(episodes=min(self.episodes, _FILMED_EPISODES), seed=self.seed)
        load_learning()
        physics: dict[str, Any] = {"randomize": self.randomize}
        physics |= {} if self.physics is None else {"physics": read_physics(self.physics)}
        options = {"realtime": self.realtime, **physics} | ({} if self.hub is None else {"hub": self.hub})

        def report(episode: int, return_: float) -> None:
            if not self.json:
                print_line(f"episode {episode}/{self.episodes}  return {return_:.4g}")

        def begin(env: EnvBase) -> None:
            if self.video is not None:
                check_filmable(env)
            emergency_stop.attach(env)

        try:
            with EmergencyStop(threading.Event(), print_note) as emergency_stop:
                result = evaluate(
                    self.run,
                    self.env,
                    episodes=self.episodes,
                    seed=self.seed,
                    which="best" if self.best else "last",
                    save=False,
                    on_episode=report,
                    on_env=begin,
                    place=emergency_stop.place,
                    **options,
                )
        except StoppedError:
            raise Interrupted("nothing was counted") from None
        for line in [result.to_json()] if self.json else describe(result):
            print_line(line)
        result.save()
        if self.video is not None:
            film = film_run(self.run, "best" if self.best else "last", self.video, film_options, **physics)
            print_note(f"video    {film.path}")


def describe(result: EvaluationResult) -> Iterator[str]:
    """Text lines of an evaluation, with its 95 % intervals."""
    from bricksrl.evaluation.report import labelled

    played, trained = counted(result.episodes, "episode"), counted(result.trained_episodes, "episode")
    yield f"{result.env}, {played} of {result.agent} after {trained} of training:"
    interval = result.return_interval
    bounds = f"  (95 % interval of the mean: {interval.low:.4g} to {interval.high:.4g})" if interval is not None else ""
    yield f"return   {result.return_mean:.4g} ± {result.return_std:.4g}{bounds}"
    if result.success_rate is not None and result.success_interval is not None:
        low, high = result.success_interval.low, result.success_interval.high
        count = round(result.success_rate * result.episodes)
        yield f"success  {count} of {played}  (95 % interval of the rate: {percent(low)} to {percent(high)})"
    for name, value in result.metrics.items():
        yield "  ".join(labelled(name, value))
