"""``bricksrl team``: train robots that share one world."""

from __future__ import annotations

import threading
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

from tyro.conf import Positional, UseAppendAction

from brickhub.cli.terminal import Interrupted, print_line
from brickhub.fields import Count
from brickhub.files import check_writable, folder_with, quoted
from brickhub.options import Existing, Seed, option, parsed, refuse_ignored
from brickhub.seed import evaluation_seed
from bricksrl.cli.page import LivePageGroup, play_until_stopped, shown
from bricksrl.cli.terminal import load_learning
from bricksrl.cli.train import run_folder
from bricksrl.envs.arenas import ARENAS, check_arena, get_arena_task, make_arena
from bricksrl.errors import RenderingUnavailableError, RunError, UnknownNameError, counted, percent
from bricksrl.page.server import PageOptions
from bricksrl.training.run_folder import file_name
from bricksrl.training.signals import StopSignals

if TYPE_CHECKING:
    from tensordict.nn import TensorDictModuleBase

    from bricksrl.training.teams.team import Team, TeamConfig, TeamProgress

TEAM_FILE = "team.bin"
FILM_FILE = "film.mp4"
_SIMULATED_FRAMES = 300_000
_COPIES = 256
_ARENA_FRAMES = 10_000
_EVALUATION_SEED = 7000
_FILMED_EPISODES = 2
_MAX_LINES = 20
"""Maximum number of lines on the progress of a training."""


def _look_for_team(folder: Path) -> None:
    if not (folder / TEAM_FILE).exists():
        remedy = f"name {folder_with(folder, TEAM_FILE)}, which `bricksrl team ARENA` writes"
        raise RunError(f"there is no team in {folder}; {remedy}")


Algorithm = Literal["mappo", "ippo", "sac"]


@dataclass(frozen=True)
class TrainTeam:
    """Train robots that share one world, let them play, and film them.

    They learn in a kinematic simulation of their arena or, with --copies 0 or without such a
    simulation, in the arena itself: virtual hubs in one physics world, where they also play
    afterwards. The folder gets team.bin and, with OpenGL, a film. Ctrl-C ends the training after
    the current round and keeps the team; another one ends at once. Algorithms: mappo has a critic
    of the whole group, ippo a critic of each robot, sac learns from each robot independently.

    Examples:
      bricksrl team Tag-v0
      bricksrl team Tag-v0 --agent sac --learn runner
      bricksrl team --play runs/tag
      bricksrl team Tag-v0 --page --page-host 0.0.0.0
      bricksrl team Carry-v0
      bricksrl team Guide-v0 --agent mappo
    """

    env: Annotated[Positional[str | None], option(metavar="ARENA"), Existing(check_arena)] = None
    """Arena; `bricksrl list` shows them."""
    agent: Annotated[
        Algorithm | None,
        parsed(str, "NAME", choices=get_args(Algorithm)),
        option(),
    ] = None
    """Algorithm; by default ippo in the simulation, and sac, which needs fewer steps, in the arena
    itself."""
    learn: Annotated[UseAppendAction[tuple[str, ...]], option(metavar="GROUP")] = ()
    """Group of robots that learns; the others follow their scripts. May be repeated. By default the
    arena's first group."""
    frames: Annotated[int | None, option(metavar="N")] = None
    """Steps of all copies together; by default 300,000 in the simulation, 10,000 in the arena
    itself."""
    copies: Annotated[int | None, option(metavar="N")] = None
    """Copies of the simulation; 0 for the arena itself. By default 256 if there is a simulation."""
    seed: Seed = 0
    """Seed of all random numbers: the same seed gives the same team."""
    deaf: bool = False
    """Robots do not hear what the others tell them over the air, in an arena where they do."""
    episodes: Annotated[Count, option(metavar="N")] = 20
    """Episodes to play after the training."""
    run: Annotated[Path | None, option(metavar="DIR")] = None
    """Folder to write to, which must not exist; by default runs/<arena>-<agent>-<seed>-<time>."""
    play: Annotated[Path | None, option(metavar="DIR"), Existing(_look_for_team)] = None
    """Play with the team of this folder instead of training one."""
    page: Annotated[
        bool,
        option(
            help="Play in the browser instead of training: each visitor, as on a phone, may "
            "drive a robot."
        ),
    ] = False
    live_page: LivePageGroup = PageOptions()

    def execute(self) -> None:
        if self.play is not None and self.env is not None:
            raise RunError("a team that only plays has an arena; omit ARENA or --play")
        address = shown(self.live_page, self.page)
        if self.page:
            refuse_ignored(
                self, ("--env", "--page", "--play", "--page-host", "--page-port"), "with --page"
            )
        elif self.play is not None:
            refuse_ignored(self, ("--play", "--seed", "--episodes"), "with --play")
        load_learning()
        from bricksrl.training.teams.team import load_team

        if self.play is not None:
            team = load_team(self.play / TEAM_FILE)
            if address is None:
                self._play(team, None)
            else:
                _show(
                    team.config.env,
                    team.policy,
                    str(self.play),
                    address,
                )
            return
        if self.env is None:
            raise RunError(
                f"name an arena to train in ({', '.join(ARENAS)}), or a folder to --play"
            )
        if address is not None:
            policy, by = _latest_policy(self.env)
            _show(self.env, policy, by, address)
            return
        config = self.config(self.env)
        folder = run_folder(
            self.run,
            self.env,
            next(iter(config.agents.values())),
            self.seed,
        )
        if folder.exists():
            raise RunError(f"{folder} exists already; choose another folder with --run")
        check_writable(folder / TEAM_FILE)
        try:
            self._play(self._train(config, folder), folder)
        except KeyboardInterrupt:
            raise Interrupted(_kept(folder)) from None

    def _train(
        self,
        config: TeamConfig,
        folder: Path,
    ) -> Team:
        from bricksrl.training.teams.team import train_team

        learning = ", ".join(f"{group} by {agent}" for group, agent in config.agents.items())
        print_line(f"{config.env}, seed {config.seed}: {learning}; {folder}")

        lines = 0

        def report(progress: TeamProgress) -> None:
            nonlocal lines
            # The same number of lines for a training of a minute and for one of a night.
            due = progress.frames * _MAX_LINES // config.frames
            if not progress.episodes or due <= lines:
                return
            lines = due
            texts = [f"{group} {value:.4g}" for group, value in progress.returns.items()]
            step = f"step {progress.frames}/{config.frames}"
            episodes = counted(progress.episodes, "episode")
            success = percent(progress.success)
            print_line(f"{step}  {episodes}  return {'  '.join(texts)}  success {success}")

        stop = threading.Event()
        with StopSignals(stop) as signals:
            team = train_team(config, on_progress=report, stop=stop)
            with signals.held_back():
                team.save(folder / TEAM_FILE)
        if stop.is_set():
            raise KeyboardInterrupt
        return team

    def config(self, env: str) -> TeamConfig:
        """Configuration of the training. Raises UnknownNameError for an unknown arena or group."""
        from bricksrl.training.teams.team import TeamConfig

        task = get_arena_task(env)
        for group in self.learn:
            if group not in task.groups:
                raise UnknownNameError(
                    f"{env} has no group '{group}'; choose {', '.join(task.groups)}"
                )
        learning = self.learn or tuple(task.groups)[:1]
        others = [group for group in task.groups if group not in learning]
        scripts = {group: task.opponents.get(group, "random") for group in others}
        copies = self.copies
        if copies is None:
            # What is pushed has no kinematic simulation, which alone makes copies.
            copies = 0 if task.arena.loads else _COPIES
        default_frames = _SIMULATED_FRAMES if copies else _ARENA_FRAMES
        frames = default_frames if self.frames is None else self.frames
        agent = self.agent or ("ippo" if copies else "sac")
        return TeamConfig(
            env,
            dict.fromkeys(learning, agent),
            scripts,
            frames,
            copies,
            self.seed,
            self.deaf,
        )

    def _play(
        self,
        team: Team,
        folder: Path | None,
    ) -> None:
        from bricksrl.evaluation.film import film_arena
        from bricksrl.training.teams.team import play_team

        env = make_arena(team.config.env, deaf=team.config.deaf)
        seed = evaluation_seed(team.config.seed, _EVALUATION_SEED + self.seed)
        episodes = play_team(
            env,
            team.policy,
            self.episodes,
            seed,
        )
        succeeded = sum(episode.success for episode in episodes)
        mean_steps = sum(episode.length for episode in episodes) / len(episodes)
        count = counted(len(episodes), "episode")
        print_line(
            f"success         {succeeded} of {count} in the arena, {mean_steps:.1f} steps "
            "on average"
        )
        if folder is not None:
            print_line(f"team            {folder / TEAM_FILE}")
            try:
                film_arena(
                    env,
                    team.policy,
                    folder / FILM_FILE,
                    _FILMED_EPISODES,
                    seed,
                )
                print_line(f"film            {folder / FILM_FILE}")
            except RenderingUnavailableError as error:
                print_line(f"film            none: {error}")
        env.close()


def _latest_policy(env: str) -> tuple[TensorDictModuleBase, str]:
    """Policy of the latest team of an arena in the folder ``runs``, and what it is: by its scripts
    where none is trained."""
    from bricksrl.training.teams.groups import team_policy
    from bricksrl.training.teams.team import load_team

    task = get_arena_task(env)
    found = Path("runs").glob(f"{file_name(env)}-*/{TEAM_FILE}")
    teams = sorted(found, key=lambda path: path.stat().st_mtime)
    if teams:
        return load_team(teams[-1]).policy, str(teams[-1].parent)
    default = next(iter(task.scripts), "random")
    scripts = {group: task.opponents.get(group, default).partition(",")[0] for group in task.groups}
    return team_policy(make_arena(env), {}, scripts), "by script"


def _show(
    env_id: str,
    policy: TensorDictModuleBase,
    by: str,
    address: PageOptions,
) -> None:
    """Play in the browser until Ctrl-C."""
    from bricksrl.page.arena import ArenaPage, play_arena

    with closing(make_arena(env_id)) as env:
        page = ArenaPage(env.task, f"without a driver: {by}", address)
        play_until_stopped(env, page, lambda stop: play_arena(env, page, policy, stop=stop))


def _kept(folder: Path) -> str:
    """Text on what is saved of a training that ends now."""
    if not (folder / TEAM_FILE).exists():
        return "nothing was saved"
    return f"the team is in {folder}; `bricksrl team --play {quoted(folder)}` plays with it"
