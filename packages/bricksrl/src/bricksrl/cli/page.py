"""Live page on the command line: its flags, its address, and the commands ``play``, ``drive`` and
``plan show``."""

from __future__ import annotations

import functools
import os
import sys
import threading
import urllib.parse
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_args

from tyro.conf import OmitArgPrefixes, Positional

from brickhub.cli.ending import wait_for_end
from brickhub.cli.terminal import Interrupted, print_line, print_note
from brickhub.fields import Range
from brickhub.files import folder_with
from brickhub.hub.transports.address import parse_hub
from brickhub.options import Existing, SavesNothing, Seed, option, parsed, refuse_ignored
from brickhub.seed import evaluation_seed
from brickhub.user_files import check_there, is_reference
from bricksrl.cli.terminal import EmergencyStop, driving, load_learning, placing
from bricksrl.envs import get_task
from bricksrl.envs.arenas import ARENAS
from bricksrl.envs.make import has_arrays, make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.registry import task_with
from bricksrl.envs.task import Task
from bricksrl.errors import DescriptionError, RunError, StoppedError, UnknownNameError, counted
from bricksrl.page.server import LOOPBACK, PageOptions
from bricksrl.page.start import StartPage
from bricksrl.policies import config_of
from bricksrl.policies.by_name import array_policies
from bricktwin.cli.plan_commands import PlanArgument, read_named_plan

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

    from bricksrl.envs.tasks.scripted import ArrayPolicy
    from bricksrl.page.live import LivePage
    from bricksrl.policies.policy import Player

_T = TypeVar("_T")

PageFlag = Annotated[
    bool,
    option(
        help="Show it live in the browser: the robot in 3D, curves, buttons, and sliders to "
        "drive it."
    ),
]
"""``--page``."""
Pad = Literal["gamepad", "controller"]
"""Devices that drive in place of the page."""
RobotGroup = Annotated[EnvOptions, OmitArgPrefixes]
"""Options of a command's robot, as a separate group in the help."""


LivePageGroup = Annotated[PageOptions, OmitArgPrefixes]
"""Address of a command's live page, as a separate group in the help."""


def shown(address: PageOptions, page: bool) -> PageOptions | None:
    """The address if the page is to be shown, else ``None``. Raises DescriptionError if it is given
    without ``--page``."""
    if not page:
        refuse_ignored(address, (), "without --page")
    return address if page else None


def announce(url: str) -> None:
    """Print the address of a page, for a phone in the network as a QR code too, and open it if
    there is a screen."""
    print_note(f"live page: {url}")
    # A page for this computer alone is of no use to a phone.
    if urllib.parse.urlsplit(url).hostname not in LOOPBACK and sys.stderr is not None:
        with suppress(ImportError):
            import segno

            segno.make(url, error="l").terminal(sys.stderr, compact=True)
    if has_screen():
        webbrowser.open(url)


def has_screen() -> bool:
    """Whether the user can see a browser that is opened here."""
    # Over SSH the browser would open where nobody sits.
    if sys.stderr is None or not sys.stderr.isatty() or os.environ.get("SSH_CONNECTION"):
        return False
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return sys.platform in ("win32", "darwin") or bool(has_display)


@dataclass(frozen=True)
class ShowStart(SavesNothing):
    """Show the start page in the browser: environments to play, train and drive, runs to watch and
    compare, building plans, and the hub check, all without typing. Runs are kept in the folder
    runs. Ctrl-C ends it, and what it has started.

    Examples:
      bricksrl page
      bricksrl page --page-host 0.0.0.0
    """

    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        try:
            with StartPage(Path.cwd(), self.live_page) as page:
                announce(page.url)
                wait_for_end()
        except KeyboardInterrupt:
            raise Interrupted from None


@dataclass(frozen=True)
class Demo(SavesNothing):
    """Show a trained robot in the browser, at once and without training: a Walker, or the robot of
    another environment.

    The page can switch to random actions and to a hand-written controller, and lets you drive.
    Ctrl-C ends it.

    Examples:
      bricksrl demo
      bricksrl demo LineFollow-v0
      bricksrl demo Walker-v1 --policy random
    """

    env: Annotated[Positional[str], option(metavar="ENV"), Existing(check_there)] = "Walker-v1"
    """Environment; `bricksrl list` shows them."""
    policy: Annotated[str | None, option(metavar="NAME")] = None
    """Policy to begin with: random, scripted (a hand-written controller) or best, the trained one
    that comes with BricksRL."""
    episodes: Annotated[int | None, Range(1), option(metavar="N")] = None
    """Episodes to show; by default until Ctrl-C."""
    seed: Seed = 1000
    """Seed of the episodes and of random actions."""
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        from bricksrl.page.robot_play import play_robot

        if not has_arrays(self.env):
            raise DescriptionError(
                f"{self.env} has no robot to show; `bricksrl demo` shows a Walker"
            )
        env = make(self.env, seed=self.seed, arrays=True)
        policies = _array_policies(
            self.env,
            env.task,
            self.policy,
            self.seed,
        )
        with closing(env):
            _on_page(
                self.live_page,
                env,
                self.env,
                play_robot,
                policies,
                subtitle="comes with BricksRL",
                episodes=self.episodes,
            )


@dataclass(frozen=True)
class Play(SavesNothing):
    """Play episodes with a trained agent; with --page in the browser, at the speed of a real robot.

    Without a page, a virtual robot is as fast as this computer unless --realtime is given. The page
    can switch between policies: of a run random, first (untrained), best and last; of an
    environment random, scripted, and best, which comes with BricksRL. Ctrl-C ends it.

    Examples:
      bricksrl play runs/spin --page
      bricksrl play Walker-v1 --page
      bricksrl play runs/spin --hub ble --page
      bricksrl play runs/spin --episodes 3
    """

    target: Annotated[Positional[str], option(metavar="RUN|ENV"), Existing(check_there)]
    """Folder of a run or of a shared policy; or an environment."""
    policy: Annotated[str | None, option(metavar="NAME")] = None
    """Policy to begin with: random, first, best or last; of an environment random, scripted or
    best; by default the last."""
    episodes: Annotated[int | None, Range(1), option(metavar="N")] = None
    """Episodes to play; by default until Ctrl-C."""
    seed: Seed = 1000
    """Seed of the episodes and of random actions."""
    page: PageFlag = False
    robot: RobotGroup = EnvOptions()
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        address = shown(self.live_page, self.page)
        folder = Path(self.target)
        is_run = folder.is_dir()
        if not is_run and len(folder.parts) > 1 and not is_reference(self.target):
            remedy = f"name {folder_with(folder, 'config.json', 'policy.json')}, or an environment"
            raise RunError(f"there is no run in {self.target}; {remedy}")
        if not is_run:
            _look_for_env(self.target, folder)
        is_virtual = parse_hub(self.robot.hub).is_virtual
        is_shown = is_virtual and address is not None and not is_run
        if is_shown and address is not None and has_arrays(self.target, self.robot):
            # Without TorchRL the page is there seconds earlier.
            robot = make(
                self.target,
                self.robot,
                seed=self.seed,
                arrays=True,
            )
            from bricksrl.page.robot_play import play_robot

            arrays = _array_policies(
                self.target,
                robot.task,
                self.policy,
                self.seed,
            )
            with closing(robot):
                _on_page(
                    address,
                    robot,
                    self.target,
                    play_robot,
                    arrays,
                    episodes=self.episodes,
                )
            return
        load_learning()
        with _environment(self, self.target, folder if is_run else None) as (env, env_id):
            players = _players(
                folder if is_run else None,
                env,
                env_id,
                self.policy,
                self.seed,
            )
            if address is not None:
                from bricksrl.page.play import play_on_page

                subtitle = self.target if is_run else ""
                _on_page(
                    address,
                    env,
                    env_id,
                    play_on_page,
                    players,
                    subtitle=subtitle,
                    episodes=self.episodes,
                )
            else:
                seed = self.seed
                if is_run:  # the episodes that `bricksrl evaluate` plays
                    from bricksrl.training.run_folder import RunFolder

                    seed = evaluation_seed(RunFolder(folder).origin().seed, seed)
                _in_terminal(
                    env,
                    list(players.values())[-1](),
                    self.episodes,
                    seed,
                )


def _look_for_env(name: str, folder: Path) -> None:
    """Raise UnknownNameError if there is no environment of that name, before anything is loaded; a
    name may be meant as the folder of a run."""
    try:
        get_task(name)
    except UnknownNameError as error:
        if is_reference(name) or name in ARENAS:
            raise
        runs = folder_with(folder, "config.json", "policy.json")
        raise UnknownNameError(f"{error}; or the folder of a run: {runs}") from None


def _array_policies(
    env_id: str,
    task: Task,
    policy: str | None,
    seed: int,
) -> dict[str, Callable[[], ArrayPolicy]]:
    return _beginning_with(policy, array_policies(env_id, task, seed), env_id)


def _players(
    run: Path | None,
    env: EnvBase,
    env_id: str,
    policy: str | None,
    seed: int,
) -> dict[str, Callable[[], Player]]:
    """Players of a run, or of an environment of ours."""
    from bricksrl.policies.policy import array_player, named_policies

    if run is not None:
        return _beginning_with(policy, named_policies(run, env, seed), str(run))
    arrays = _array_policies(
        env_id,
        env.task,
        policy,
        seed,
    )
    return {name: functools.partial(array_player, make) for name, make in arrays.items()}


def _beginning_with(
    policy: str | None,
    policies: Mapping[str, _T],
    target: str,
) -> dict[str, _T]:
    """The policies, with the named one last, with which a page begins. Raises DescriptionError if
    there is none of that name."""
    name = policy or list(policies)[-1]
    if name not in policies:
        raise DescriptionError(f"{target} has no policy '{policy}'; choose {', '.join(policies)}")
    ordered = dict(policies)
    # Taken out and put in again, which makes it the last one.
    ordered[name] = ordered.pop(name)
    return ordered


@dataclass(frozen=True)
class DriveRobot(SavesNothing):
    """Drive a robot, by default a virtual one, with the sliders and the joystick of a page in the
    browser, or with levers or sticks in your hands. Ctrl-C ends it.

    Examples:
      bricksrl drive Spinning-v0
      bricksrl drive RoboArm-v0
      bricksrl drive Walker-v0 --hub ble
      bricksrl drive Spinning-v0 --page-host 0.0.0.0
      bricksrl drive Spinning-v0 --with controller
    """

    env: Annotated[Positional[str], option(metavar="ENV"), Existing(check_there)]
    """Environment; `bricksrl list` shows them. A task of your own: my_task.py, my_task.py:TASK or
    module:TASK."""
    seed: Seed = 0
    """Seed of the episodes."""
    device: Annotated[
        Pad | None,
        parsed(str, "DEVICE", choices=get_args(Pad)),
        option(name="with"),
    ] = None
    """Drive with a gamepad, or with the Controller of LEGO's kits, instead of the page."""
    robot: RobotGroup = EnvOptions()
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        from bricksrl.page.robot_play import play_robot

        if not self.device and has_arrays(self.env, self.robot):
            robot = make(
                self.env,
                self.robot,
                seed=self.seed,
                place=placing(),
                arrays=True,
            )
            with closing(robot):
                _on_page(
                    self.live_page,
                    robot,
                    self.env,
                    play_robot,
                    {},
                    subtitle="driven by hand",
                    in_charge=True,
                )
            return
        from bricksrl.page.play import play_on_page, resting_player

        load_learning()
        with (
            _environment(self, self.env, None) as (env, env_id),
            driving(
                self.device,
                env_id,
                env.task,
                in_charge=True,
            ) as driver,
        ):
            players = {"by hand": lambda: resting_player(env, driver)}
            _on_page(
                self.live_page,
                env,
                env_id,
                play_on_page,
                players,
                subtitle="driven by hand",
                in_charge=driver is None,
            )


@contextmanager
def _environment(
    flags: Play | DriveRobot,
    target: str,
    run: Path | None,
) -> Iterator[tuple[EnvBase, str]]:
    """The named environment, or that of a run, open inside this context, and its id."""
    env_id = target
    options = flags.robot
    if run is not None:
        config = config_of(run)
        env_id = config.env
        options = options.changed(**config.transforms, **config.options | options.options)
        if options.scene is None and options.hub == "virtual":
            options = options.changed(scene=config.scene)
    with closing(
        make(
            env_id,
            options,
            seed=flags.seed,
            place=placing(),
        )
    ) as env:
        yield env, env_id


def _on_page(
    address: PageOptions,
    env: Any,
    env_id: str,
    play: Callable[..., list[float]],
    policies: Mapping[str, Any],
    *,
    subtitle: str = "",
    in_charge: bool = False,
    episodes: int | None = None,
) -> None:
    """Show an environment, or a robot without TorchRL, played by `play_on_page` or `play_robot`."""
    from bricksrl.page.live import LivePage

    page = LivePage(
        env_id,
        subtitle,
        task=env.task,
        in_charge=in_charge,
        policies=tuple(policies),
        speed="1x",
        options=address,
    )
    play_until_stopped(
        env,
        page,
        lambda stop: play(
            env,
            page,
            policies,
            episodes=episodes,
            stop=stop,
        ),
    )


def play_until_stopped(
    env: Any,
    page: LivePage,
    play: Callable[[threading.Event], list[float]],
) -> None:
    """Serve a page while an environment is played on it; Ctrl-C, or the event that ``play`` is
    given, ends it."""
    stop = threading.Event()
    try:
        with page, EmergencyStop(stop, print_note) as emergency_stop:
            announce(page.url)
            emergency_stop.attach(env)
            returns = play(stop)
    except (KeyboardInterrupt, StoppedError):
        raise Interrupted from None
    print_line(f"{counted(len(returns), 'episode')}, mean return {sum(returns) / len(returns):.4g}")


def _in_terminal(
    env: EnvBase,
    player: Player,
    episodes: int | None,
    seed: int,
) -> None:
    """Play without a page, and print a line for each whole episode."""
    from bricksrl.envs.rollout import play_episodes

    try:
        with EmergencyStop(threading.Event(), print_note) as emergency_stop:
            emergency_stop.attach(env)
            scores = play_episodes(
                env,
                player.act,
                episodes or sys.maxsize,
                seed,
                reset_policy=player.reset,
            )
            for number, score in enumerate(scores, 1):
                print_line(
                    f"episode {number}  return {score.return_:.4g}  {counted(score.length, 'step')}"
                )
    except (KeyboardInterrupt, StoppedError):
        raise Interrupted from None


@contextmanager
def run_on_page(
    address: PageOptions | None,
    env_id: str,
    options: EnvOptions,
    *,
    on_stop: Callable[[], None] = lambda: None,
    can_drive: bool = True,
) -> Iterator[LivePage | None]:
    """The live page of a run or a recording, served inside this context; ``None`` without an
    address."""
    if address is None:
        yield None
        return
    from bricksrl.page.live import LivePage

    task = task_with(env_id, options)
    with LivePage(
        env_id,
        task=task,
        can_drive=can_drive,
        on_stop=on_stop,
        options=address,
    ) as page:
        announce(page.url)
        yield page


@dataclass(frozen=True)
class ShowPlan(SavesNothing):
    """Show a building plan in the browser in 3D, step by step, with sliders for its joints. Ctrl-C
    ends it.

    Examples:
      bricksrl plan show walker
      bricksrl plan show my_robot.mpd --page-host 0.0.0.0
    """

    plan: PlanArgument
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        plan = read_named_plan(self.plan)  # raises if there is none, before anything is loaded
        from bricksrl.page.plan_view import PlanView

        try:
            with PlanView(plan, self.live_page) as page:
                announce(page.url)
                wait_for_end()
        except KeyboardInterrupt:
            raise Interrupted from None
