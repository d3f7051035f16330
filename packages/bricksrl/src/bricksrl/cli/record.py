"""``bricksrl record``: record datasets of a policy or a human."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional

from brickhub.cli.terminal import Interrupted, print_line, print_note
from brickhub.fields import Count
from brickhub.files import quoted
from brickhub.options import Existing, Flag, Seed, option, parsed
from brickhub.user_files import check_there
from bricksrl.cli.page import LivePageGroup, PageFlag, RobotGroup, run_on_page, shown
from bricksrl.cli.terminal import (
    DEVICES,
    Device,
    EmergencyStop,
    driving,
    load_learning,
    placing,
    quiet,
    with_human,
)
from bricksrl.data.dataset import EpisodeRow
from bricksrl.data.integrity import check
from bricksrl.data.recorder import Recorder
from bricksrl.data.schema import describe
from bricksrl.envs import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import task_with
from bricksrl.errors import (
    BricksError,
    DataError,
    DescriptionError,
    RunError,
    StoppedError,
    counted,
    hint,
)
from bricksrl.page.server import PageOptions
from bricksrl.policies import config_of

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.envs.rollout import Driver
    from bricksrl.page.live import LivePage
    from bricksrl.policies.policy import Player


_PATIENCE_S = 300.0
"""How long a lost robot is retried, as in a training by default."""


@dataclass(frozen=True)
class Record:
    """Record episodes of a policy or a human as a dataset in LeRobot's format.

    Each episode is on the disk when its line is printed. Where the link to the robot breaks, the
    recording goes on when the robot is back; that episode is kept as broken off, and does not
    count. Backspace, Discard on the page, or a button of the hub (--discard-button) discards the
    episode that goes on, and records it again. Ctrl-C ends the recording and keeps the whole
    episodes; keys and signals stop and pause the robot as in training. An existing dataset is
    extended, if it has the same robot, environment and shape.

    Examples:
      bricksrl record RunAway-v0 --policy random --episodes 100 --out datasets/run_away_random
      bricksrl record Walker-v0 --policy runs/walker --episodes 100 --out datasets/walker_expert
      bricksrl record Spinning-v0 --policy keyboard --episodes 5 --out datasets/by_hand
      bricksrl record Walker-v0 --policy random --discard-button left --out datasets/walker
      bricksrl record Walker-v0 --policy runs/walker --take-over gamepad --out datasets/corrected
    """

    env: Annotated[Positional[str], option(metavar="ENV"), Existing(check_there)]
    """Environment; `bricksrl list` shows them. A task of your own: my_task.py, my_task.py:TASK or
    module:TASK."""
    out: Annotated[Path, option(metavar="DIR")]
    """Folder of the dataset: a new one, or one to extend."""
    policy: Annotated[str, option(metavar="POLICY")] = "random"
    """Policy: random, keyboard, gamepad, controller, or the folder of a run or of a shared
    policy."""
    take_over: Annotated[Device | None, parsed(str, "DEVICE", choices=DEVICES), option()] = None
    """Let a human intervene with this device; these steps are marked in the data."""
    episodes: Annotated[Count, option(metavar="N")] = 10
    """Episodes to record."""
    seed: Seed = 0
    """Seed of the episodes and of random actions."""
    video: Annotated[Path | None, option(metavar="FILE")] = None
    """Film the virtual robot into this mp4 file."""
    explore: Flag = False
    """Let the agent of a run explore as in training; by default it acts deterministically."""
    discard_button: Annotated[str | None, option(metavar="BUTTON")] = None
    """Button of the hub that discards the episode that goes on, as Backspace does: left, or of a
    remote, remote.left_plus. Hold it until that is said."""
    page: PageFlag = False
    robot: RobotGroup = EnvOptions()
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        self._check_policy()
        task = task_with(self.env, self.robot)
        address = shown(self.live_page, self.page)
        load_learning()
        from bricksrl.envs.env_interface import interface_of
        from bricksrl.evaluation.film import filmed_env

        count = 0

        def report(episode: EpisodeRow) -> None:
            nonlocal count
            count += 1
            by_hand = ""
            if episode.interventions:
                by_hand = f"  {counted(episode.interventions, 'step')} by hand"
            print_line(
                f"episode {count}/{self.episodes}  return {episode.return_:.4g}  "
                f"{counted(episode.length, 'step')}{by_hand}"
            )

        device = self.policy if self.policy in DEVICES else self.take_over
        options = self.robot
        if device is not None:
            options = with_human(options, self.env)
        # All keys of a keyboard are for driving.
        keys = False if device == "keyboard" else None
        discard = threading.Event()

        def on_discard() -> None:
            discard.set()
            print_note("discarded; this episode is recorded again")

        try:
            with (
                EmergencyStop(
                    threading.Event(),
                    print_note,
                    keys=keys,
                    on_discard=on_discard,
                ) as emergency_stop,
                driving(
                    device,
                    self.env,
                    task,
                    in_charge=self.policy in DEVICES,
                    on_discard=on_discard,
                ) as human,
                closing(self._environment(options, human, emergency_stop)) as env,
                filmed_env(env, self.video, f"{self.env}: {self.policy}"),
                Recorder(self.out, describe(env, options.options)) as recorder,
                run_on_page(
                    address,
                    self.env,
                    options,
                    can_drive=human is None,
                ) as page,
            ):
                emergency_stop.attach(env)
                if self.discard_button is not None:
                    interface_of(env).on_button = on_discard
                self._check_dataset(recorder)
                if page is not None:
                    page.on_discard = on_discard
                self._collect(
                    env,
                    recorder,
                    human,
                    report,
                    page,
                    discard,
                )
        except (KeyboardInterrupt, StoppedError):
            raise Interrupted(f"saved {counted(count, 'whole episode')} in {self.out}") from None
        print_line(f"dataset         {self.out}, seed {self.seed}")
        if self.video is not None:
            print_line(f"video           {self.video}")
        print_line(f"look at it      bricksrl data info {quoted(self.out)}")

    def _check_policy(self) -> None:
        """Refuse names of no policy, and options that the policy ignores."""
        known = ("random", *DEVICES)
        if self.policy not in known and not Path(self.policy).exists():
            raise RunError(
                f"there is no run in {self.policy}{hint(self.policy, known)}; name a folder, or "
                f"{', '.join(known)}"
            )
        if self.policy in DEVICES and self.take_over is not None:
            raise DescriptionError(
                "a human drives from the start; omit --take-over, or name another --policy"
            )
        if self.explore and self.policy in known:
            raise DescriptionError(
                f"--explore has no effect with the policy '{self.policy}'; omit it, or name a run"
            )

    def _check_dataset(self, recorder: Recorder) -> None:
        """Say that a dataset is extended. Raises DataError if it is damaged."""
        if not recorder.rows:
            return
        if faults := check(self.out):
            remedy = f"`bricksrl data repair {quoted(self.out)} --out NEW` saves what is whole"
            raise DataError(
                f"{self.out} is damaged ({faults[0].detail.partition(';')[0]}); {remedy}"
            )
        print_note(
            f"{self.out} has {counted(len(recorder.rows), 'episode')} already, which are kept; "
            "this adds to them"
        )

    def _environment(
        self,
        options: EnvOptions,
        human: Driver | None,
        emergency_stop: EmergencyStop,
    ) -> EnvBase:
        # The policy of a run acts behind the transforms that it was trained behind.
        if self.policy != "random" and self.policy not in DEVICES:
            options = options.changed(**config_of(Path(self.policy)).transforms)
        return make(
            self.env,
            options,
            seed=self.seed,
            place=placing(partial(quiet, human), emergency_stop.quiet),
            watched_button=self.discard_button,
        )

    def _collect(
        self,
        env: EnvBase,
        recorder: Recorder,
        human: Driver | None,
        report: Callable[[EpisodeRow], None],
        page: LivePage | None,
        discard: threading.Event,
    ) -> None:
        from bricksrl.data.collect import collect
        from bricksrl.envs.env_interface import interface_of

        def on_episode(episode: EpisodeRow) -> None:
            report(episode)
            if page is not None:
                page.end(episode.return_, f"{episode.episode + 1}")
                page.begin()

        def on_lost(steps: int, error: BricksError) -> None:
            print_note(
                f"{error}; {counted(steps, 'step')} of this episode are kept as broken off, and "
                "another one is recorded"
            )

        # As in training: a link that breaks heals, and the recording goes on.
        reconnect = interface_of(env).reconnect
        if reconnect is not None:
            reconnect.patience_s = _PATIENCE_S
        hooks: dict[str, Any] = {"driver": human}
        if page is not None:
            page.attach(env)
            hooks = {"driver": human or page.driver, "on_frame": page.show_step_and_hold}
        player = self._player(env)
        hooks |= {"reset_policy": player.reset, "on_episode": on_episode, "on_lost": on_lost}
        collect(
            env,
            player.act,
            recorder,
            self.episodes,
            name=self.policy,
            seed=self.seed,
            hub=self.robot.hub,
            discard=discard,
            **hooks,
        )

    def _player(self, env: EnvBase) -> Player:
        from bricksrl.page.play import resting_player
        from bricksrl.policies.policy import Player, random_player
        from bricksrl.policies.sharing import is_policy, load_shared
        from bricksrl.training.learners import load_learner

        if self.policy == "random":
            return random_player(env, self.seed)
        # The robot rests while the human does not drive.
        if self.policy in DEVICES:
            return resting_player(env)
        path = Path(self.policy)
        learner = load_shared(path, env) if is_policy(path) else load_learner(path, env).learner
        return Player(learner.explore if self.explore else learner.exploit, learner.reset_policy)
