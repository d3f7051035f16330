"""`train` and `resume`: a run from its config to its files."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bricksrl.agents import AGENTS, make_agent
from bricksrl.errors import BricksError, CheckpointError, RunError, UnknownNameError
from bricksrl.training.config import TrainConfig
from bricksrl.training.curve import draw_learning_curve
from bricksrl.training.interrupt import Interruption
from bricksrl.training.observer import Episode, Observer, Phase, Progress, RunResult
from bricksrl.training.run import RunFolder

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torchrl.envs import EnvBase

    from bricksrl.agents.agent import Agent

RATE_WINDOW = 5
"""Episodes that the rate of a run is taken over."""


def train(
    config: TrainConfig, observer: Observer | None = None, *, env: EnvBase | None = None, stop: threading.Event | None = None
) -> RunResult:
    """Train an agent from nothing, into a new folder, which is made once the robot has answered.

    Ctrl-C, or ``stop`` set from another thread, ends the run after the step at hand; its files are then in order, and `resume`
    goes on from the end of the last whole episode.

    Args:
        env: an environment of your own, which stays open; without one, ``config.env`` is made and closed at the end.

    Raises:
        RunError: the folder exists already.
        UnknownNameError: there is no such environment, hub or agent.
        HubError: the link to the robot failed; what was learned until then is saved.
        KeyboardInterrupt: Ctrl-C before the robot has answered; nothing was made.
    """
    if config.agent not in AGENTS:
        raise UnknownNameError(f"there is no agent '{config.agent}'; choose one of {', '.join(AGENTS)}")
    if config.run_dir is not None and config.run_dir.exists():
        raise RunError(f"{config.run_dir} exists already; resume that run or choose another folder")
    with _prepared(config, env, stop) as (ready, agent, interruption):
        state = _reset(ready, config, 1, interruption)
        with interruption.held_back():
            folder = RunFolder.create(config)
            run = _Run(config, folder, ready, agent, observer or Observer(), interruption)
            run.save()
        return run.go_on(state)


def resume(
    run_dir: Path,
    observer: Observer | None = None,
    *,
    episodes: int | None = None,
    env: EnvBase | None = None,
    stop: threading.Event | None = None,
) -> RunResult:
    """Go on with a run where its last whole episode ended; it ends bit-identical to one that was never interrupted.

    Args:
        episodes: train up to this many in all, where that is more than the run was started with.
        env: as in `train`.

    Raises:
        RunError: there is no run in the folder.
        CheckpointError: its checkpoint is damaged or belongs to another run.
        HubError: as in `train`.
    """
    folder = RunFolder(run_dir)
    config = folder.read_config()
    if episodes is not None and episodes < config.episodes:
        raise RunError(f"the run in {run_dir} is for {config.episodes} episodes already; give that many or more, not {episodes}")
    config = replace(config, episodes=episodes or config.episodes)
    with _prepared(config, env, stop) as (ready, agent, interruption):
        run = _Run(config, folder, ready, agent, observer or Observer(), interruption)
        run.restore()
        state = None
        if len(run.episodes) < config.episodes:
            state = _reset(ready, config, len(run.episodes) + 1, interruption)
        return run.go_on(state)


@dataclass(frozen=True)
class Trained:
    """An agent as a run's last checkpoint has it, and the number of episodes that it learned from."""

    agent: Agent
    episodes: int


def load_agent(run_dir: Path, env: EnvBase) -> Trained:
    """The agent of a run, to act in ``env``.

    Raises:
        RunError, CheckpointError: as in `resume`; also when ``env`` observes or acts otherwise than the run's environment.
    """
    folder = RunFolder(run_dir)
    config = folder.read_config()
    agent = _make_agent(config, env)
    state = _load(folder, config, env)
    agent.load_state_dict(state["agent"])
    return Trained(agent, len(state["episodes"]))


@contextmanager
def _prepared(
    config: TrainConfig, env: EnvBase | None, stop: threading.Event | None
) -> Iterator[tuple[EnvBase, Agent, Interruption]]:
    """Everything that a run needs: repeatable randomness, Ctrl-C in our hands, an open environment, a fresh agent."""
    from bricksrl.training.reproducible import derive_seed, reproducible

    own = env is None
    ready = make_env(config) if env is None else env
    interruption = Interruption(stop or threading.Event())
    try:
        with reproducible(derive_seed(config.seed, "agent")), interruption:
            yield ready, _make_agent(config, ready), interruption
    finally:
        if own:
            ready.close(raise_if_closed=False)


def make_env(config: TrainConfig) -> EnvBase:
    """The environment that a config names.

    Raises:
        UnknownNameError: there is no such environment or hub.
    """
    from bricksrl.envs.registry import make
    from bricksrl.twin.physics import RandomPhysics

    physics = RandomPhysics() if config.randomize else config.physics
    return make(config.env, hub=config.hub, seed=config.seed, realtime=config.realtime, physics=physics)


def _make_agent(config: TrainConfig, env: EnvBase) -> Agent:
    from bricksrl.agents.layout import layout_of

    task = getattr(env, "task", None)
    return make_agent(config.agent, layout_of(env), int(env.action_spec.shape[-1]), config.settings, task)


def _reset(env: EnvBase, config: TrainConfig, episode: int, interruption: Interruption) -> TensorDictBase:
    from bricksrl.training.online import seed_episode

    seed_episode(env, config.seed, "episode", episode)
    with interruption.at_once():  # a reset may wait for a hub or for a hand, and nothing is lost in it
        return env.reset()


def _identity(config: TrainConfig, env: EnvBase) -> dict[str, Any]:
    """What must be equal for a checkpoint to belong to a run."""
    from bricksrl.agents.layout import layout_of

    data = config.to_dict()
    run = {key: data[key] for key in ("env", "agent", "seed", "settings")}
    return {**run, "layout": layout_of(env).to_dict(), "action_size": int(env.action_spec.shape[-1])}


def _load(folder: RunFolder, config: TrainConfig, env: EnvBase) -> dict[str, Any]:
    from bricksrl.training.checkpoint import load_checkpoint

    state = load_checkpoint(folder.checkpoint_path)
    if state.get("identity") != _identity(config, env):
        path = folder.checkpoint_path
        raise CheckpointError(f"{path} belongs to another config or environment; use those that it was made with")
    return state


@dataclass
class _Run:
    """A run under way."""

    config: TrainConfig
    folder: RunFolder
    env: EnvBase
    agent: Agent
    observer: Observer
    interruption: Interruption
    episodes: list[Episode] = field(default_factory=list)

    def go_on(self, state: TensorDictBase | None) -> RunResult:
        """Train from ``state``, the reset of the next episode, to the last episode or to an interruption."""
        self.observer.on_start(self.config, self.folder.path, len(self.episodes))
        try:
            while state is not None and self._one_episode(state):
                state = None
                if len(self.episodes) < self.config.episodes:
                    state = _reset(self.env, self.config, len(self.episodes) + 1, self.interruption)
        except (KeyboardInterrupt, BricksError):
            if not self.interruption.requested:
                raise
        finally:
            with self.interruption.held_back():
                title = f"{self.config.env} · {self.config.agent} · seed {self.config.seed}"
                draw_learning_curve(self.folder.curve_path, self.episodes, title)
        result = RunResult(self.folder.path, tuple(self.episodes), interrupted=len(self.episodes) < self.config.episodes)
        self.observer.on_end(result)
        return result

    def _one_episode(self, state: TensorDictBase) -> bool:
        """Run an episode and save it; false when it was interrupted, and then nothing of it stays."""
        from bricksrl.training.online import EpisodeStoppedError, is_success, run_episode

        started = time.perf_counter()
        number = len(self.episodes) + 1
        phase = Phase.PREFILL if number <= self.agent.prefill_episodes else Phase.TRAIN

        def on_step(step: int) -> bool:
            self.observer.on_step(number, step, phase)
            return not self.interruption.requested

        def on_transition(step: int, transition: TensorDictBase) -> None:
            self.observer.on_transition(number, step, phase, transition)

        try:
            rollout = run_episode(self.env, self.agent, state, phase, on_step, on_transition)
        except EpisodeStoppedError:
            return False
        before = self.episodes[-1] if self.episodes else None
        episode = Episode(
            episode=number,
            phase=phase,
            steps=rollout.length + (before.steps if before else 0),
            length=rollout.length,
            return_=rollout.return_,
            success=is_success(self.env, rollout),
            losses=rollout.losses,
            seconds=time.perf_counter() - started + (before.seconds if before else 0.0),
        )
        with self.interruption.held_back():
            self.episodes.append(episode)
            self.folder.append(episode)
            self.save()
        self.observer.on_episode(episode, self._progress())
        return not self.interruption.requested

    def _progress(self) -> Progress:
        recent = self.episodes[-RATE_WINDOW - 1 :]
        first_seconds, first_steps = (recent[0].seconds, recent[0].steps) if len(self.episodes) > RATE_WINDOW else (0.0, 0)
        counted = min(len(self.episodes), RATE_WINDOW)
        seconds = max(recent[-1].seconds - first_seconds, 1e-9)
        left = self.config.episodes - len(self.episodes)
        return Progress(self.config.episodes, (recent[-1].steps - first_steps) / seconds, left * seconds / counted)

    def save(self) -> None:
        """Write the checkpoint."""
        import torch

        from bricksrl.training.checkpoint import save_checkpoint

        state = {
            "identity": _identity(self.config, self.env),
            "episodes": [episode.to_dict() for episode in self.episodes],
            "generator": torch.get_rng_state(),
            "agent": self.agent.state_dict(),
        }
        save_checkpoint(self.folder.checkpoint_path, state)

    def restore(self) -> None:
        """Take over the checkpoint, and bring the other files to where it is."""
        import torch

        state = _load(self.folder, self.config, self.env)
        self.agent.load_state_dict(state["agent"])
        torch.set_rng_state(state["generator"])
        with self.interruption.held_back():
            self.episodes = [Episode.from_dict(data) for data in state["episodes"]]
            self.folder.write_episodes(self.episodes)
            self.folder.write_config(self.config)
