"""``bricksrl train``, ``resume`` and ``train-offline``: train, evaluate, report."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, UseAppendAction

from brickhub.cli.terminal import Interrupted, print_line
from brickhub.fields import Count, Range
from brickhub.files import only_writer, quoted, remove_unfinished
from brickhub.hub.transports.address import parse_hub
from brickhub.options import Existing, Flag, Seed, existing_file, option, parsed, refuse_ignored
from brickhub.user_files import check_there
from bricksrl.agents import check_agent
from bricksrl.cli.evaluate import describe
from bricksrl.cli.page import LivePageGroup, PageFlag, RobotGroup, has_screen, run_on_page, shown
from bricksrl.cli.progress import RunProgress, train_seeds
from bricksrl.cli.terminal import (
    DEVICES,
    Device,
    EmergencyStop,
    driving,
    load_learning,
    placing,
    quiet,
    telling,
    with_human,
)
from bricksrl.data.dataset import existing_dataset
from bricksrl.envs.options import EnvOptions, TransformOptions
from bricksrl.envs.registry import get_task, task_with, training_agent, training_episodes
from bricksrl.errors import DescriptionError, RunError, StoppedError, counted
from bricksrl.evaluation.settings_text import SETTINGS_REMEDY, read_settings, with_changes
from bricksrl.page.server import PageOptions
from bricksrl.training.callbacks import Callback, CallbackList, RunResult
from bricksrl.training.config import SCRIPTED, RunOptions, TrainConfig, settings_for
from bricksrl.training.existing_run import CONFIG, existing_run
from bricksrl.training.run_folder import RunFolder, file_name

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.envs.rollout import Driver
    from bricksrl.page.live import LivePage

_EVALUATED_EPISODES = 5
_SETTINGS = existing_file("the settings", DescriptionError, SETTINGS_REMEDY)


FilmFlag = Annotated[
    bool,
    option(help="Do not film a virtual robot before and after the training."),
]
"""``--no-film``."""


@dataclass(frozen=True)
class Train:
    """Train an agent on a robot, by default a virtual one.

    The run folder gets the configuration, the metrics, a checkpoint, the learning curve, an
    evaluation and, with OpenGL, a video. Ctrl-C ends the training early and keeps what was learned.
    In a terminal, space, q or Esc stops the robot at once, and p pauses it; the signals SIGUSR1 and
    SIGTERM (Windows: Ctrl-Break) stop it too.

    Examples:
      bricksrl train RunAway-v0
      bricksrl train Walker-v1 --page
      bricksrl train Spinning-v0 --episodes 15 --seed 3 --run runs/spin
      bricksrl train RunAway-v0 --preset paper
      bricksrl train Walker-v0 --from runs/first
      bricksrl train Walker-v0 --base scripted
      bricksrl train Walker-v0 --demonstrations datasets/walker
      bricksrl train Walker-v0 --set learning_rate=3e-4 --set "hidden=128,128"
      bricksrl train Walker-v0 --hub ble
      bricksrl train Walker-v0 --hub "ble:A,ble:B"
      bricksrl train RunAway-v0 --robots 4 --realtime
      bricksrl train WalkerSim-v0 --seeds 5
      bricksrl train WalkerSim-v0 --seeds 10 --on ray
      bricksrl train WalkerSim-v0 --agent ppo --num-envs 1024
      bricksrl train Walker-v0 --agent my_agent.py
      bricksrl train --resume runs/spin
    """

    env: Annotated[Positional[str | None], option(metavar="ENV"), Existing(check_there)] = None
    """Environment; `bricksrl list` shows them. A task of your own: my_task.py, my_task.py:TASK or
    module:TASK."""
    agent: Annotated[str | None, option(metavar="NAME"), Existing(check_there)] = None
    """Agent; `bricksrl list` shows them. An algorithm of your own: my_agent.py[:NAME]. Default:
    sac, of a plan what suits what it learns, or the agent of --from."""
    episodes: Annotated[int | None, Range(1), option(metavar="N")] = None
    """Episodes to train for; the default depends on the environment and, with thousands of copies,
    on their number."""
    seed: Seed = 0
    """Seed of all random numbers: the same seed gives the same run."""
    run: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder to write to, which must not exist; by default runs/<env>-<agent>-<seed>-<time>."""
    page: PageFlag = False
    changes: Annotated[
        UseAppendAction[tuple[str, ...]], option(name="set", metavar="NAME=VALUE")
    ] = ()
    """A single setting, such as learning_rate=3e-4 or hidden=128,128. May be repeated."""
    preset: Annotated[str | None, option(metavar="NAME")] = None
    """Settings of the agent: default, or paper for those of the BricksRL paper. Default: default,
    or the settings of --from."""
    settings: Annotated[Path | None, option(metavar="FILE"), _SETTINGS] = None
    """Settings that replace those of the preset: a JSON file such as `bricksrl tune` writes."""
    resume: Annotated[Path | None, option(metavar="RUN")] = None
    """Resume this run, as `bricksrl resume` does, instead of starting a new one."""
    seeds: Annotated[int | None, option(metavar="N")] = None
    """Train N seeds, starting with --seed, in parallel, and summarise them."""
    on: Annotated[str | None, option(metavar="WHERE")] = None
    """Where to train the --seeds: ray, or ray:ADDRESS for a cluster (pip install
    "bricksrl[distributed]")."""
    take_over: Annotated[Device | None, parsed(str, "DEVICE", choices=DEVICES), option()] = None
    """Let a human intervene with this device; the agent learns from these steps too, and the data
    marks them."""
    asynchronous: Flag = False
    """Learn in parallel with the robot, which never waits; the default on a real robot and with
    --realtime."""
    synchronous: Flag = False
    """Learn while the robot waits, even on a real robot; runs of a virtual robot are then
    reproducible."""
    film: FilmFlag = True
    learning: Annotated[RunOptions, OmitArgPrefixes] = RunOptions()
    robot: RobotGroup = EnvOptions()
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        if self.resume is not None:
            if self.env is not None:
                raise DescriptionError(
                    "a run that is resumed has an environment; omit ENV or --resume"
                )
            refuse_ignored(
                self,
                ("--resume", "--episodes", "--page", "--no-film", "--page-host", "--page-port"),
                "with --resume",
            )
            Resume(
                self.resume,
                self.episodes,
                self.page,
                self.film,
                self.live_page,
            ).execute()
            return
        if self.env is None:
            raise DescriptionError(
                "name an environment to train in, or a run to --resume; `bricksrl list` shows "
                "environments"
            )
        address = shown(self.live_page, self.page)
        if self.seeds is not None and (self.page or self.take_over is not None):
            raise DescriptionError(
                "several seeds have no page and nobody who takes over; omit --seeds, or --page "
                "and --take-over"
            )
        if self.learning.eval_episodes != RunOptions.eval_episodes and not self.learning.eval_every:
            raise DescriptionError(
                "--eval-episodes has no effect without --eval-every; omit it, or give both"
            )
        self._check(self.env)
        load_learning()
        from bricksrl.training.run import train

        config = self.config(self.env)
        if self.seeds is not None:
            train_seeds(config, self.seeds, self.on)
            return
        if self.on is not None:
            raise DescriptionError("a single run needs no cluster; give --seeds, or omit --on")
        if self.take_over is None:
            run_training(
                partial(train, config),
                config,
                address,
                film=self.film,
            )
            return
        # All keys of a keyboard are for driving, so that none is left to stop the robot.
        keys = False if self.take_over == "keyboard" else None
        task = task_with(self.env, config)
        with driving(
            self.take_over,
            self.env,
            task,
            in_charge=False,
        ) as driver:
            run_training(
                partial(train, config),
                config,
                address,
                driver=driver,
                keys=keys,
                film=self.film,
            )

    def _check(self, env: str) -> None:
        """Refuse what is wrong before torch is loaded, which takes seconds."""
        if (Path(env) / CONFIG).exists():
            run = quoted(env)
            raise DescriptionError(
                f"{env} is a run; `bricksrl resume {run}` goes on with it, and `bricksrl train ENV "
                f"--from {run}` lets its agent go on in a new one"
            )
        task_with(env, self.robot)
        if self.agent is not None:
            check_agent(self.agent)
        for hub in self.robot.hub.split(","):
            parse_hub(hub.strip())
        if self.run is not None and self.run.exists():
            raise RunError(f"{self.run} exists already; resume that run or choose another folder")

    def config(self, env: str) -> TrainConfig:
        """Configuration of the run from the flags."""
        if self.asynchronous and self.synchronous:
            raise DescriptionError("a run is synchronous or asynchronous; choose one of the two")
        start = self.learning.start
        source = None if start is None else RunFolder(start).read_config()
        agent = self.agent
        if agent is None:
            agent = training_agent(env) if source is None else source.agent
        # The same agent goes on with the settings that it was trained with.
        if source is not None and self.preset is None and source.agent == agent:
            settings = source.settings
        else:
            settings = settings_for(env, "default" if self.preset is None else self.preset, agent)
        base = self.learning.base
        if base is None and source is not None:
            base = source.base
        if self.settings is not None:
            settings = read_settings(self.settings, settings)
        known = {**vars(self.learning), "base": base}
        # Absolute paths, with which the run can go on in any folder.
        for name in ("start", "base", "demonstrations"):
            if known[name] not in (None, SCRIPTED):
                known[name] = str(Path(known[name]).absolute())
        # Neither flag leaves the choice to the run, which knows whether the robot is a real one.
        asynchronous = None
        if self.asynchronous or self.synchronous:
            asynchronous = self.asynchronous
        robot = self.robot if self.take_over is None else with_human(self.robot, env)
        return TrainConfig(
            **vars(robot),
            **known,
            env=env,
            agent=agent,
            episodes=self.episodes or training_episodes(env, self.learning.num_envs),
            seed=self.seed,
            asynchronous=asynchronous,
            settings=with_changes(settings, self.changes),
            run_dir=run_folder(self.run, env, agent, self.seed),
        )


@dataclass(frozen=True)
class Resume:
    """Resume an interrupted run, or train a finished one for longer.

    Examples:
      bricksrl resume runs/spin
      bricksrl resume runs/spin --episodes 60
    """

    run: Annotated[Positional[Path], option(metavar="RUN"), Existing(existing_run)]
    """Folder that `bricksrl train` wrote."""
    episodes: Annotated[int | None, Range(1), option(metavar="N")] = None
    """Total number of episodes, including those already trained; by default as when the run was
    started."""
    page: PageFlag = False
    film: FilmFlag = True
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        address = shown(self.live_page, self.page)
        config = RunFolder(self.run).read_config()
        load_learning()
        from bricksrl.training.run import resume

        resumed = partial(resume, self.run, episodes=self.episodes)
        run_training(
            resumed,
            config,
            address,
            film=self.film,
        )


@dataclass(frozen=True)
class TrainOffline:
    """Train an agent from a dataset alone, without the robot.

    The agent is tested in a few episodes, spread over the updates. The run folder is that of
    `bricksrl train`. To continue the training on the robot, use `bricksrl train ENV --from RUN`;
    `bricksrl train ENV --demonstrations RUN` teaches SAC its policy.

    Examples:
      bricksrl train-offline Walker-v0 --data datasets/walker
      bricksrl train-offline RunAway-v0 --data runs/first --agent iql --updates 2000
      bricksrl train-offline RoboArm-v0 --data datasets/arm --agent bc --preset paper
    """

    env: Annotated[Positional[str], option(metavar="ENV"), Existing(check_there)]
    """Environment of the data; `bricksrl list` shows them."""
    data: Annotated[Path, option(metavar="DIR"), Existing(existing_dataset)]
    """Folder of the dataset, or of a run that recorded one."""
    agent: Annotated[str, option(metavar="NAME"), Existing(check_there)] = "iql"
    """Agent: bc, act, iql, cql, td3bc; or an agent for online learning, such as sac and td3."""
    preset: Annotated[str, option(metavar="NAME")] = "default"
    """Settings of the agent: default, or paper for those of the BricksRL paper."""
    updates: Annotated[Count, option(metavar="N")] = 5000
    """Updates from the data."""
    episodes: Annotated[Count, option(metavar="N")] = 10
    """Test episodes, spread evenly over the updates."""
    seed: Seed = 0
    """Seed of all random numbers: the same seed gives the same run."""
    run: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder to write to, which must not exist; by default runs/<env>-<agent>-<seed>-<time>."""
    page: PageFlag = False
    film: FilmFlag = True
    transforms: Annotated[TransformOptions, OmitArgPrefixes] = TransformOptions()
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        address = shown(self.live_page, self.page)
        # It raises if there is none, before anything slow is imported.
        get_task(self.env)
        load_learning()
        from bricksrl.training.run import train

        config = TrainConfig(
            **vars(self.transforms),
            env=self.env,
            agent=self.agent,
            episodes=self.episodes,
            seed=self.seed,
            settings=settings_for(self.env, self.preset, self.agent),
            data=str(self.data.absolute()),
            updates=self.updates,
            run_dir=run_folder(
                self.run,
                self.env,
                self.agent,
                self.seed,
            ),
        )
        run_training(
            partial(train, config),
            config,
            address,
            can_drive=False,
            film=self.film,
        )


def run_folder(
    named: Path | None,
    env: str,
    agent: str,
    seed: int,
) -> Path:
    """The folder that the user has named for a run; by default one with the run's and the time's
    name."""
    time = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    return named or Path("runs") / f"{file_name(env)}-{file_name(agent)}-{seed}-{time}"


def run_training(
    run: Callable[..., RunResult],
    config: TrainConfig,
    address: PageOptions | None,
    *,
    driver: Driver | None = None,
    keys: bool | None = None,
    can_drive: bool = True,
    film: bool = True,
) -> None:
    """Run, evaluate and report a training with its displays, in the terminal and on an optional
    page.

    Args:
        run: `train` or `resume`, called with a callback and with ``place``, ``stop`` and
            ``driver``.
        driver: a human who may take over; by default one at the page.
        keys: as in :class:`EmergencyStop`.
        can_drive: whether a human at the page may drive.
        film: whether to film the robot, before and after.
    """
    progress = RunProgress(config.hub)
    stop = threading.Event()
    # Nobody at a page can drive several robots at once.
    is_one_robot = config.num_envs == len(config.hubs) == 1
    can_drive = can_drive and driver is None and is_one_robot
    served_page = run_on_page(
        address,
        config.env,
        config.robot,
        on_stop=stop.set,
        can_drive=can_drive,
    )
    try:
        with (
            served_page as page,
            EmergencyStop(stop, progress.note, keys=keys) as emergency_stop,
        ):
            progress.on_ready = emergency_stop.attach
            callback: Callback = progress
            # While somebody is asked to place the robot, keys are an answer, and nothing else is
            # drawn.
            place = placing(partial(quiet, driver), progress.hidden, emergency_stop.quiet)
            if page is not None:
                from bricksrl.page.play import PageCallback

                callback = CallbackList(progress, PageCallback(page, stop))
                driver = driver or page.driver
            result = run(
                callback,
                place=place,
                stop=stop,
                driver=driver,
            )
            progress.close()
            if not result.interrupted:
                with only_writer(result.run_dir, RunError):
                    _report(
                        result,
                        emergency_stop,
                        page,
                        film=film,
                    )
                return
    except (KeyboardInterrupt, StoppedError):
        # A Ctrl-C before or after the training, or a second one in it. There is nothing to do: the
        # training has saved what it has.
        pass
    finally:
        progress.close()
    raise Interrupted(progress.saved())


def _report(
    result: RunResult,
    emergency_stop: EmergencyStop,
    page: LivePage | None,
    *,
    film: bool,
) -> None:
    """Evaluate, film, and print the paths of the results."""
    from bricksrl.evaluation.evaluator import evaluate
    from bricksrl.evaluation.report import can_film, write_report

    last = result.episodes[-1]
    print_line(
        f"trained {counted(last.episode, 'episode')}, {counted(last.steps, 'step')}, in "
        f"{last.seconds:.0f} s"
    )
    if result.caught_up:
        print_line(
            f"learning made {result.updates_per_step:.3g} updates a step while the robot was at "
            f"work, {result.caught_up} after it"
        )

    def on_env(env: EnvBase) -> None:
        emergency_stop.attach(env)
        if page is not None:
            page.board.update_status(state="evaluating")
            page.attach(env)

    # Such as a film whose process was killed in an earlier try.
    remove_unfinished(result.run_dir)
    with telling("evaluating"):
        place = placing(emergency_stop.quiet)
        evaluation = evaluate(
            result.run_dir,
            episodes=_EVALUATED_EPISODES,
            save=False,
            on_env=on_env,
            place=place,
        )
    # Said before it is saved: a full disk must not swallow it.
    for line in describe(evaluation):
        print_line(line)
    evaluation.save()
    if page is not None:
        play = f"bricksrl play {quoted(result.run_dir)} --page"
        page.finish(f"Done. `{play}` shows what it has learned.")
    work = "writing the report"
    # Without OpenGL, or of a robot without a body, there is nothing to wait for.
    if film and can_film(result.run_dir):
        work = "filming before and after, and writing the report"
    with telling(work):
        summary, video = write_report(
            result.run_dir,
            result.episodes,
            evaluation,
            film=film,
        )
    print_line(f"learning curve  {RunFolder(result.run_dir).curve_path}")
    print_line(f"video           {video}")
    print_line(f"report          {summary}")
    print_line(f"more episodes   bricksrl evaluate {quoted(result.run_dir)} --episodes 20")
    if has_screen():
        webbrowser.open(summary.absolute().as_uri())
