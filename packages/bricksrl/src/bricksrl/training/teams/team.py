"""Training and evaluation of teams: groups of robots in an arena."""

import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import torch
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from brickhub.fields import Range, check_fields
from brickhub.seed import check_seed, derive_seed, episode_seed
from bricksrl.envs.arenas import make_arena
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.rollout import play
from bricksrl.errors import CheckpointError, RunError, message_of
from bricksrl.training.checkpoint import load_checkpoint, save_checkpoint
from bricksrl.training.reproducible import reproducible
from bricksrl.training.sources import collect_round
from bricksrl.training.teams.groups import GroupLearner, TeamSettings, make_group, team_policy

MAX_FRAMES = 10**9
"""Maximum number of steps of a training, which take days."""
MAX_COPIES = 2**16
"""Maximum number of copies of a simulation."""


@dataclass(frozen=True)
class TeamConfig:
    """Training of one or several groups.

    Attributes:
        env: name of an arena.
        agents: algorithm of each learning group.
        scripts: script of each other group: one of the task, "random", or several separated by
            commas for the copies in turn.
        frames: total steps of all copies.
        copies: number of copies of the kinematic simulation; 0 trains in the arena itself, with its
            hubs.
        deaf: train robots that do not hear what the others tell them.
    """

    env: str
    agents: Mapping[str, str]
    scripts: Mapping[str, str] = field(default_factory=dict)
    frames: Annotated[int, Range(1, MAX_FRAMES)] = 500_000
    copies: Annotated[int, Range(0, MAX_COPIES)] = 256
    seed: int = 0
    deaf: bool = False

    def __post_init__(self) -> None:
        check_seed(self.seed)
        check_fields(type(self), vars(self))
        if not self.agents:
            raise RunError("a team learns nothing without a learning group; name one in agents")


@dataclass(frozen=True)
class TeamProgress:
    """Progress of a training: mean return per robot of each group, and success rate, over the
    episodes that ended."""

    frames: int
    episodes: int
    returns: dict[str, float]
    success: float


@dataclass
class Team:
    """Trained groups. ``policy``: policy of all robots; explores under
    ``ExplorationType.RANDOM``."""

    config: TeamConfig
    settings: TeamSettings
    learners: dict[str, GroupLearner]
    policy: TensorDictModuleBase

    def save(self, path: Path | str) -> None:
        """Save the acting networks."""
        # A checkpoint has plain types only, because it is read without executing anything.
        config = asdict(self.config)
        config["agents"] = dict(self.config.agents)
        config["scripts"] = dict(self.config.scripts)
        settings = asdict(self.settings)
        settings["hidden"] = list(self.settings.hidden)
        groups = {
            group: dict(learner.policy.state_dict()) for group, learner in self.learners.items()
        }
        state = {"config": config, "settings": settings, "groups": groups}
        save_checkpoint(Path(path), state)


def load_team(path: Path | str, scripts: Mapping[str, str] | None = None) -> Team:
    """Load a team, optionally against other scripts. Raises CheckpointError if it is damaged or no
    team."""
    state = load_checkpoint(Path(path))
    try:
        config_values = dict(state["config"])
        if scripts is not None:
            config_values["scripts"] = dict(scripts)
        settings_values = dict(state["settings"])
        settings_values["hidden"] = tuple(settings_values["hidden"])
        config = TeamConfig(**config_values)
        settings = TeamSettings(**settings_values)
        team = _new_team(make_arena(config.env), config, settings)
        for group, learner in team.learners.items():
            learner.policy.load_state_dict(state["groups"][group])
    except (KeyError, TypeError, RuntimeError) as error:
        raise CheckpointError(
            f"{path} has no team ({message_of(error, typed=True)}); choose another file or "
            "train one"
        ) from None
    return team


def _new_team(
    env: EnvBase,
    config: TeamConfig,
    settings: TeamSettings,
) -> Team:
    agents: Any = config.agents
    learners = {group: make_group(env, group, agent, settings) for group, agent in agents.items()}
    policy = team_policy(env, learners, config.scripts)
    return Team(config, settings, learners, policy)


def train_team(
    config: TeamConfig,
    settings: TeamSettings | None = None,
    on_progress: Callable[[TeamProgress], None] = lambda _: None,
    stop: threading.Event | None = None,
) -> Team:
    """Train the groups of a config; reproducible. Ends after the round in which ``stop`` is set.
    Raises UnknownNameError or DescriptionError if there is no such arena, group, agent or
    script."""
    settings = settings or TeamSettings()
    env = make_arena(
        config.env,
        seed=derive_seed(config.seed, "arena"),
        deaf=config.deaf,
        batch_size=config.copies,
    )
    with reproducible(derive_seed(config.seed, "team")):
        team = _new_team(env, config, settings)
        _learn(
            env,
            team,
            on_progress,
            stop or threading.Event(),
        )
    env.close(raise_if_closed=False)
    return team


def _learn(
    env: EnvBase,
    team: Team,
    on_progress: Callable[[TeamProgress], None],
    stop: threading.Event,
) -> None:
    config = team.config
    # An arena with its hubs exists only once.
    copies = max(1, config.copies)
    steps_per_batch = team.settings.steps
    batches = max(1, config.frames // (steps_per_batch * copies))
    # These are the rewards so far of the episodes that have not ended, [copies].
    running_returns = {group: torch.zeros(copies) for group in config.agents}
    frames_done = 0
    steps = batches * steps_per_batch
    for collected in collect_round(
        env,
        team.policy,
        steps,
        steps_per_batch,
    ):
        frames = collected if collected.ndim == 2 else collected[None]  # [copies, time]
        frames_done += frames.numel()
        # This comes before learning, which adds entries to the frames.
        on_progress(
            _progress(
                team,
                frames,
                running_returns,
                frames_done,
            )
        )
        for learner in team.learners.values():
            learner.learn(frames)
        if stop.is_set():
            return


def _progress(
    team: Team,
    frames: Any,
    running_returns: dict[str, Any],
    frames_done: int,
) -> TeamProgress:
    """Progress over the episodes that ended in these frames; ``running_returns``, of the current
    ones, go on."""
    after = frames["next"]
    done = after["done"].squeeze(-1)  # [copies, time]
    ended = int(done.sum())
    returns = {}
    for group in team.config.agents:
        total = 0.0
        running = running_returns[group]
        # The mean over the robots is [copies, time].
        rewards = after[group, "reward"].mean((-1, -2))
        # This goes step by step, because an episode may end and another one begin within a batch.
        for step in range(frames.shape[1]):
            has_ended = done[:, step]
            running += rewards[:, step]
            total += float((running * has_ended).sum())
            running *= ~has_ended
        returns[group] = total / ended if ended else float("nan")
    successes = float((after["success"] & after["done"]).sum())
    success_rate = successes / ended if ended else float("nan")
    return TeamProgress(
        frames_done,
        ended,
        returns,
        success_rate,
    )


@dataclass(frozen=True)
class TeamEpisode:
    """An evaluated episode: success, steps, and mean return of each group's robots."""

    success: bool
    length: int
    returns: dict[str, float]


def play_team(
    env: EnvBase,
    policy: TensorDictModuleBase,
    episodes: int,
    seed: int,
) -> list[TeamEpisode]:
    """Run episodes in an arena with its hubs; episode ``k`` depends on ``seed``, ``k`` and the
    policy only. Raises HubError if a link broke."""
    played = []
    for number in range(1, episodes + 1):
        env.set_seed(episode_seed("evaluation", seed, number))
        # Scripts such as "random" draw from torch's generator, so the seed makes them repeatable.
        torch.manual_seed(derive_seed(seed, "policy", number))
        with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
            outcomes = [frame["next"] for frame in play(env, policy)]
        last = outcomes[-1]
        if bool(last["link_lost"]):
            raise interface_of(env).link_error
        returns = {}
        for group in env.task.groups:
            rewards = [float(outcome[group, "reward"].mean()) for outcome in outcomes]
            returns[group] = sum(rewards)
        played.append(TeamEpisode(bool(last["success"]), len(outcomes), returns))
    return played
