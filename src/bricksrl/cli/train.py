"""``bricksrl train`` and ``bricksrl resume``: learn, evaluate, draw."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, UseAppendAction, arg

from bricksrl.cli.console import INTERRUPTED, print_interrupted, print_line
from bricksrl.cli.loading import load_learning
from bricksrl.errors import BricksError, DescriptionError, StoppedError

if TYPE_CHECKING:
    import numpy as np

    from bricksrl.cli.hand import Hand
    from bricksrl.cli.progress import LineProgress
    from bricksrl.training import RunResult, TrainConfig

_EVALUATED_EPISODES = 5


@dataclass(frozen=True)
class Train:
    """Train an agent on a robot, by default a virtual one.

    The run folder gets the configuration, the metrics, a checkpoint, the learning curve, an evaluation and, where OpenGL is
    there, a video. Ctrl-C ends the training early and keeps what was learned. In a terminal, space, q or Esc stops the robot at
    once, and p pauses it; the signals SIGUSR1 and SIGTERM (Windows: Ctrl-Break) stop it too.

    Examples:
      bricksrl train RunAway-v0
      bricksrl train Spinning-v0 --episodes 15 --seed 3 --run runs/spin
      bricksrl train RunAway-v0 --preset paper
      bricksrl train Walker-v0 --data datasets/walker
      bricksrl train Walker-v0 --from runs/first
      bricksrl train Walker-v0 --agent sac --from runs/bc --data datasets/walker
      bricksrl train Walker-v0 --set learning_rate=3e-4 --set hidden=128,128
      bricksrl train Walker-v0 --hub ble
      bricksrl train WalkerSim-v0 --seeds 5
      bricksrl train --resume runs/spin
    """

    env: Annotated[Positional[str | None], arg(metavar="ENV")] = None
    """Environment; `bricksrl list` shows them. A task of your own: my_task.py, my_task.py:TASK or module:TASK."""
    agent: Annotated[str | None, arg(metavar="NAME")] = None
    """Agent; `bricksrl list` shows them. Without a name sac, or that of --from."""
    preset: Annotated[str | None, arg(metavar="NAME")] = None
    """Settings of the agent: default, or paper, those of the BricksRL paper. Without a name default, or those of --from."""
    settings: Annotated[Path | None, arg(metavar="FILE")] = None
    """Settings in place of those of the preset: a JSON file such as `bricksrl tune` writes."""
    changes: Annotated[UseAppendAction[tuple[str, ...]], arg(name="set", metavar="NAME=VALUE")] = ()
    """A single setting, such as learning_rate=3e-4 or hidden=128,128. May be given several times."""
    hub: Annotated[str, arg(metavar="HUB")] = "virtual"
    """How to reach the robot: virtual, ble or usb; ble:NAME, ble:ADDRESS or usb:PORT where there are several."""
    streaming: bool = False
    """Have the hub send observations 100 times a second, and take the latest command: steps then last their own time only."""
    app_data: bool = False
    """Speak to the program over AppData, where a new command replaces an old one, instead of its standard input."""
    episodes: Annotated[int | None, arg(metavar="N")] = None
    """Episodes to train for; without it as many as suit the environment."""
    seed: Annotated[int, arg(metavar="N")] = 0
    """Of everything random: the same seed gives the same run."""
    seeds: Annotated[int | None, arg(metavar="N")] = None
    """Train so many times, with as many seeds from --seed on, side by side, and sum up."""
    run: Annotated[Path | None, arg(metavar="DIR")] = None
    """Folder to write to, which must not exist; without it runs/<env>-<agent>-<seed>-<time>."""
    realtime: bool = False
    """Let the virtual robot take as long as a real one."""
    randomize: bool = False
    """Draw another physics of the virtual robot (battery, friction, masses, noise, link) for each episode."""
    physics: Annotated[Path | None, arg(metavar="FILE")] = None
    """Physics of the virtual robot: a JSON file such as `bricksrl twin fit` writes."""
    option: Annotated[UseAppendAction[tuple[str, ...]], arg(metavar="NAME=VALUE")] = ()
    """Option of the environment's task, as often as needed: sparse=true, threshold_deg=20, calibration=red.json."""
    data: Annotated[Path | None, arg(metavar="DIR")] = None
    """Learn from this dataset too: half of each batch is drawn from it."""
    start: Annotated[Path | None, arg(name="from", metavar="RUN")] = None
    """Folder of a run whose agent goes on learning here, from where it was; with another --agent, whose policy that one takes."""
    no_record: bool = False
    """Do not keep the transitions; else they are a dataset, in the folder data of the run."""
    take_over: Literal["keyboard", "gamepad"] | None = None
    """Let a human take over from the agent, and give back; the agent learns from these steps too, and the data marks them."""

    asynchronous: bool = False
    """Learn beside the robot, which never waits; so it is on a real robot and with --realtime."""
    synchronous: bool = False
    """Learn while the robot waits, on a real robot too; runs on a virtual one are then repeatable."""
    patience: Annotated[float, arg(metavar="SECONDS")] = 300.0
    """How long to try to reach a robot again whose link broke."""
    log: Annotated[Literal["none", "tensorboard", "wandb", "trackio"], arg(metavar="NAME")] = "none"
    """Also tell tensorboard, wandb or trackio; metrics.csv is always written."""
    resume: Annotated[Path | None, arg(metavar="RUN")] = None
    """Go on with that run, as `bricksrl resume` does, in place of a new one."""

    def execute(self) -> int:
        """Train, evaluate, draw."""
        if self.resume is not None:
            if self.env is not None:
                raise DescriptionError("a run that is resumed has an environment; leave ENV or --resume away")
            return Resume(self.resume, self.episodes).execute()
        if self.env is None:
            raise DescriptionError("name an environment to train in, or a run to --resume; `bricksrl list` shows environments")
        config = self.config(self.env)
        if self.seeds is not None:
            from bricksrl.cli.seeds import train_seeds

            return train_seeds(config, self.seeds)
        from bricksrl.training import train

        if self.take_over is None:
            return see_through(lambda progress, stop: train(config, progress, place=progress.place, stop=stop))
        from bricksrl.cli.hands import driving, quiet
        from bricksrl.data.description import describe_task
        from bricksrl.envs import get_task

        with driving(self.take_over, describe_task(get_task(self.env, **config.options)), in_charge=False) as driver:

            def start(progress: LineProgress, stop: threading.Event) -> RunResult:
                def place(rng: np.random.Generator) -> None:
                    with quiet(driver):
                        progress.place(rng)

                return train(config, progress, place=place, driver=driver, stop=stop)

            by_keys = self.take_over == "keyboard"  # who drives by keys needs them all
            return see_through(start, keys=False if by_keys else None)

    def config(self, env: str) -> TrainConfig:
        """What all this says about a run."""
        from bricksrl.envs.registry import training_episodes
        from bricksrl.training import RunFolder, TrainConfig
        from bricksrl.training.config import settings_for
        from bricksrl.training.offline import settings_like
        from bricksrl.training.run import file_name
        from bricksrl.training.settings import read_settings, with_changes
        from bricksrl.twin.physics import read_physics

        if self.asynchronous and self.synchronous:
            raise DescriptionError("a run is synchronous or asynchronous; choose one of the two")
        before = None if self.start is None else RunFolder(self.start).read_config()
        agent = self.agent or ("sac" if before is None else before.agent)
        if before is not None and self.preset is None and before.agent == agent:
            settings = before.settings
        else:
            settings = settings_for(env, self.preset or "default", agent)
            settings = settings if before is None or before.agent == agent else settings_like(before, settings)
        if self.settings is not None:
            settings = read_settings(self.settings, settings)
        time = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
        return TrainConfig(
            env=env,
            agent=agent,
            episodes=training_episodes(env) if self.episodes is None else self.episodes,
            seed=self.seed,
            hub=self.hub,
            realtime=self.realtime or self.take_over is not None,
            streaming=self.streaming,
            app_data=self.app_data,
            record=not self.no_record,
            randomize=self.randomize,
            physics=None if self.physics is None else read_physics(self.physics),
            options=dict(map(parse_option, self.option)),
            asynchronous=True if self.asynchronous else False if self.synchronous else None,
            patience_s=self.patience,
            log=self.log,
            settings=with_changes(settings, self.changes),
            data=None if self.data is None else str(self.data.absolute()),
            start=None if self.start is None else str(self.start.absolute()),
            run_dir=self.run or Path("runs") / f"{file_name(env)}-{agent}-{self.seed}-{time}",
        )


@dataclass(frozen=True)
class Resume:
    """Go on with a run that was interrupted, or train a finished one for longer.

    Examples:
      bricksrl resume runs/spin
      bricksrl resume runs/spin --episodes 60
    """

    run: Annotated[Positional[Path], arg(metavar="RUN")]
    """Folder that `bricksrl train` wrote."""
    episodes: Annotated[int | None, arg(metavar="N")] = None
    """Episodes in all, those that were trained already included; without it as many as the run was started with."""

    def execute(self) -> int:
        """Train on, evaluate, draw."""
        from bricksrl.training import resume

        return see_through(
            lambda progress, stop: resume(self.run, progress, episodes=self.episodes, place=progress.place, stop=stop)
        )


def parse_option(text: str) -> tuple[str, Any]:
    """``NAME=VALUE`` as a name and a number, true or false, or else a text.

    Raises:
        DescriptionError: there is no value.
    """
    name, equals, value = text.partition("=")
    if not (name.isidentifier() and equals):
        raise DescriptionError(f"'{text}' is no option; give NAME=VALUE, such as sparse=true")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def see_through(start: Callable[[LineProgress, threading.Event], RunResult], *, keys: bool | None = None) -> int:
    """A run from its first step to its video; returns the exit code. ``keys`` as :class:`Hand` takes it."""
    from bricksrl.cli.hand import Hand
    from bricksrl.cli.progress import make_progress

    progress, stop = make_progress(), threading.Event()
    try:
        load_learning()
        with Hand(stop, progress.tell, keys=keys) as hand:
            progress.on_ready, progress.quiet = hand.take, hand.quiet
            result = start(progress, stop)
            progress.close()
            if not result.interrupted:
                _show(result, hand)
                return 0
    except (KeyboardInterrupt, StoppedError):  # before the training, after it, or for the second time
        pass
    finally:
        progress.close()
    print_interrupted(progress.saved())
    return INTERRUPTED


def _show(result: RunResult, hand: Hand) -> None:
    """Evaluate, film, and say where everything is."""
    from bricksrl.cli.evaluate import describe
    from bricksrl.cli.video import record
    from bricksrl.evaluation import evaluate
    from bricksrl.training import RunFolder

    last = result.episodes[-1]
    print_line(f"trained {last.episode} episodes, {last.steps} steps, in {last.seconds:.0f} s")
    if result.caught_up:
        print_line(
            f"learning made {result.updates_per_step:.3g} updates a step while the robot was at work, {result.caught_up} after it"
        )
    print_line("evaluating")
    for line in describe(evaluate(result.run_dir, episodes=_EVALUATED_EPISODES, on_env=hand.take, place=hand.place)):
        print_line(line)
    try:
        video = str(record(result.run_dir))
    except BricksError as error:
        video = f"none: {error}"
    print_line(f"learning curve  {RunFolder(result.run_dir).curve_path}")
    print_line(f"video           {video}")
    print_line(f"more episodes   bricksrl evaluate {result.run_dir} --episodes 20")
