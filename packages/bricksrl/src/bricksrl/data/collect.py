"""Data collection: recording of episodes of a policy, a human, or both; transitions as recorded
steps, and their provenance."""

import dataclasses
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from brickhub import HOUSES
from brickhub.seed import check_seed
from bricksrl.data.dataset import About, EpisodeRow
from bricksrl.data.recorder import Recorder
from bricksrl.data.steps import Step
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.rollout import TRIES, Driver, Policy, Rollout, play
from bricksrl.errors import BricksError

_VERSIONS = {name: metadata.version(name) for name in (*HOUSES, "torch", "torchrl", "mujoco")}


def random_policy(env: EnvBase, seed: int) -> Policy:
    """Policy of uniform random actions, with a generator of its own. Raises DescriptionError if the
    seed is invalid."""
    check_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    size = int(env.action_spec.shape[-1])
    return lambda state: state.set("action", 2.0 * torch.rand(size, generator=generator) - 1.0)


def collect(
    env: EnvBase,
    policy: Policy,
    recorder: Recorder,
    episodes: int,
    *,
    name: str,
    seed: int = 0,
    hub: str = "virtual",
    driver: Driver | None = None,
    reset_policy: Callable[[], None] = lambda: None,
    on_episode: Callable[[EpisodeRow], None] = lambda _: None,
    on_frame: Callable[[TensorDictBase], None] = lambda _: None,
    on_lost: Callable[[int, BricksError], None] = lambda _steps, _error: None,
    discard: threading.Event | None = None,
) -> list[EpisodeRow]:
    """Record episodes, and return their rows. An episode interrupted by a pause, an error or Ctrl-C
    is recorded up to that step.

    So is one in which the link to the robot broke; it is played again, with another seed, after the
    robot has been reached as ``env.reconnect`` says, and does not count.

    Args:
        name: name of the policy, to be stored.
        seed: seed of the episodes; each depends only on it, its number in the dataset and the
            actions.
        hub: how the robot is reached, to be stored.
        driver: asked first at each step.
        reset_policy: as in `play`.
        on_episode: called with the row of each episode.
        on_frame: called with each step, as returned by TorchRL's ``EnvBase.step``.
        on_lost: called with the number of steps of an episode in which the link broke, and the
            error.
        discard: set by another thread to discard the episode that is being played: it ends, is not
            written, and is played again with the same seed; cleared here.

    Raises:
        HubError: the robot cannot be reached, or the link broke in each of ``TRIES`` episodes one
            after the other.
        DataError: the episode cannot be recorded.
        DescriptionError: the seed is invalid.
    """
    check_seed(seed)
    ours = interface_of(env)
    first = len(recorder.rows)
    complete = 0
    # The number of links that were lost in a row changes the seed of the next try.
    lost = 0
    discarded = threading.Event() if discard is None else discard
    while complete < episodes:
        number = len(recorder.rows)
        # The seed is made of the episode's number in the dataset, so that a recording that goes on
        # another day equals one in a single piece. After a lost link it is another seed, because a
        # virtual link would break again at the same step.
        words = [seed, number, lost] if lost else [seed, number]
        episode_seed = int(np.random.SeedSequence(words).generate_state(1)[0] >> 1)
        env.set_seed(episode_seed)
        state = env.reset()
        # What was pressed while the robot was put back means the episode that is over.
        discarded.clear()
        provenance = about(env, name, seed=episode_seed, hub=hub)
        steps = list[Step]()
        episode = Rollout()
        try:
            for frame in play(
                env,
                policy,
                state,
                driver=driver,
                reset_policy=reset_policy,
            ):
                # A repeated action (`--frame-skip`) is several steps of the robot, and all of them
                # are recorded.
                for step in episode.add(frame, env):
                    steps.append(step_of(step, env))
                    on_frame(step)
                if episode.is_lost or discarded.is_set():
                    break
            is_cut = ours.is_cut
            success = None if is_cut or episode.is_lost else episode.judged(env)[0]
        except BaseException:
            # What the robot has done is data, whatever ended the episode.
            recorder.write(steps, dataclasses.replace(provenance, whole=False))
            raise
        if discarded.is_set():
            continue
        is_whole = not (is_cut or episode.is_lost)
        recorder.write(steps, dataclasses.replace(provenance, success=success, whole=is_whole))
        if episode.is_lost:
            lost += 1
            on_lost(len(steps), ours.link_error)
            if lost == TRIES:
                raise ours.link_error
            continue
        complete += 1
        lost = 0
        on_episode(recorder.rows[-1])
    return list(recorder.rows[first:])


def step_of(transition: TensorDictBase, env: EnvBase) -> Step:
    """Step from a transition of TorchRL's ``EnvBase.step``, copied, since the environment may reuse
    its tensors. ``env``: environment of the transition; its ``timing``, if any, is recorded."""
    after = transition["next"]
    ours = interface_of(env)
    extras: dict[str, Any] = {}
    # A simulation has no hub, and so neither a clock nor an age of what it observes.
    if ours.timing is not None:
        extras["age_s"] = ours.timing.age_s
        extras["hub_time_s"] = ours.timing.hub_time_s
    # The schema has the camera of a task, so images of an environment without a task have no place
    # in it.
    if ours.task is not None and "image" in after:
        extras["image"] = _numbers(transition["image"])
        extras["next_image"] = _numbers(after["image"])
    return Step(
        observation=_numbers(transition["observation"]),
        action=_numbers(transition["action"]),
        reward=float(after["reward"]),
        next_observation=_numbers(after["observation"]),
        terminated=bool(after["terminated"]),
        truncated=bool(after["done"]) and not bool(after["terminated"]),
        intervention=bool(transition.get("intervention", False)),
        **extras,
    )


def _numbers(tensor: Tensor) -> Any:
    return tensor.detach().cpu().numpy().copy()


def about(
    env: EnvBase,
    policy: str,
    *,
    seed: int | None = None,
    hub: str = "virtual",
) -> About:
    """Provenance of an episode that starts now.

    Args:
        policy: source of the actions.
        seed: seed of the episode.
        hub: how the robot is reached; ignored without a robot.
    """
    ours = interface_of(env)
    task = ours.task
    on_hub = ours.robots > 0
    program_hash = None
    if on_hub and task is not None and task.robot.hub.model.runs_programs:
        program_hash = task.hub_program.hash
    physics = {}
    twin = ours.twin if on_hub and hub == "virtual" else None
    if twin is not None:
        # A user's own body may have no physics with names.
        known = getattr(twin.body, "physics", None)
        if known is not None:
            physics = dataclasses.asdict(known.with_link(twin.link))
    return About(
        policy=policy,
        seed=seed,
        started=datetime.now(UTC).astimezone().isoformat(timespec="milliseconds"),
        hub=hub if on_hub else "",
        program_hash=program_hash,
        versions=_VERSIONS,
        physics=physics,
    )
