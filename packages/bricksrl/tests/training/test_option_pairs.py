"""Options that were never tried together: what one does, another one must not undo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torchrl.envs import TransformedEnv
from toys import LosingCart

import bricksrl
from brickhub.hub.link.lockstep import HubLink
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.agents import AGENTS, make_learner, preset
from bricksrl.agents.td3 import TD3Settings
from bricksrl.agents.teachers import Base, add_base
from bricksrl.data import load
from bricksrl.envs import get_task
from bricksrl.envs.connection import Connection, Reconnect
from bricksrl.envs.env import HubEnv
from bricksrl.envs.make import make
from bricksrl.envs.options import EnvOptions
from bricksrl.envs.transforms import FrameSkip
from bricksrl.errors import CameraError, HubError, HubTimeoutError
from bricksrl.training import TrainConfig, train
from bricktwin.twin.make_body import make_body


class Forgetful(VirtualHub):
    """Loses one answer, and with it the link, once it is told to."""

    answers_left = 10**9

    def read(self, timeout_s: float) -> bytes:
        data = super().read(timeout_s)
        self.answers_left -= bool(data)
        if self.answers_left == 0:
            raise HubError("the connection was lost; bring the hub nearer")
        return data


class Film:
    """A camera whose frames are numbered, and which fails once it is told to."""

    def __init__(self) -> None:
        self.shown, self.fails_at = 0, 10**9

    def frame(self) -> Any:
        self.shown += 1
        if self.shown == self.fails_at:
            raise CameraError("the camera shows nothing; plug it in")
        return np.full((480, 640, 3), self.shown % 256, np.uint8)

    def close(self) -> None:
        pass


def seeing(max_steps: int = 8) -> tuple[HubEnv, Forgetful, Film]:
    task = replace(get_task("RoboArm_mixed-v0"), max_steps=max_steps)
    film, hub = Film(), Forgetful(make_body(task.robot))
    link = HubLink(hub, task.robot, task.interface)
    return HubEnv(task, lambda _seed: Connection(link, hub.reset, hub, film), seed=0), hub, film


@pytest.mark.parametrize("lost", ["link", "camera"])
def test_a_lost_step_with_a_camera_has_the_previous_image(lost: str) -> None:
    env, hub, film = seeing()
    before = env.step(env.rand_action(env.reset()))["next"]
    if lost == "link":
        hub.answers_left = 1
    else:
        film.fails_at = film.shown + 1
    after = env.step(env.rand_action(before.clone()))["next"]
    assert bool(after["link_lost"]) and bool(after["truncated"])
    assert torch.equal(after["image"], before["image"]) and torch.equal(
        after["observation"], before["observation"]
    )
    assert after["image"].data_ptr() != before["image"].data_ptr()
    assert env.observation_spec.is_in(after.select(*env.observation_spec.keys()))
    assert not bool(env.reset()["link_lost"])
    env.close()


@pytest.mark.parametrize("lost", ["link", "camera"])
def test_a_run_with_a_camera_goes_on_after_a_lost_step(lost: str, tmp_path: Path) -> None:
    env, hub, film = seeing(max_steps=4)
    if lost == "link":
        hub.answers_left = 10
    else:
        film.fails_at = 9
    settings = replace(
        preset("default", "sac", images=True),
        hidden=(8,),
        batch_size=4,
        prefill_episodes=1,
        updates_per_step=0.5,
    )
    config = TrainConfig(
        "RoboArm_mixed-v0", episodes=3, settings=settings, run_dir=tmp_path / "run"
    )
    result = train(config, env=env)
    env.close()
    assert [episode.link_lost for episode in result.episodes].count(True) == 1
    data = load(tmp_path / "run", images=True)
    assert len(data) == result.episodes[-1].steps


def test_a_camera_that_never_showed_anything_is_told_at_once() -> None:
    env, _, film = seeing()
    film.fails_at, env.reconnect.patience_s = 1, 300.0
    with pytest.raises(CameraError, match="shows nothing"):
        env.reset()


def test_placing_and_pauses_do_not_use_up_the_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, waits = [0.0], list[float]()
    monkeypatch.setattr("bricksrl.envs.connection.time.monotonic", lambda: now_s[0])
    reconnect = Reconnect(patience_s=10.0, wait=waits.append)

    def begin() -> str:
        with reconnect.by_hand():
            now_s[0] += 600.0
        return "answered"

    for _ in range(3):
        assert reconnect.until_answered(begin) == "answered"
        now_s[0] += 100.0  # of an episode
        reconnect.failed(HubTimeoutError("the hub did not answer"))
    assert waits == [0.5]

    def fail() -> str:
        with reconnect.by_hand():
            now_s[0] += 600.0
        now_s[0] += 2.0
        raise HubTimeoutError("the hub did not answer")

    with pytest.raises(HubTimeoutError):
        reconnect.until_answered(fail)
    assert waits == [0.5, 1.0, 2.0], "1.5 s, then 2 and 2 s, then 4 s would be 11.5 s in all"


@pytest.mark.parametrize("skip", [2, 5, 1000])
def test_copies_end_by_themselves_behind_a_frame_skip(skip: int) -> None:
    options = EnvOptions(frame_skip=skip, options={"threshold_deg": 60})
    # Random actions meet the goal in one of twelve episodes: none of 128 does by 1 to 100,000.
    env = make("RoboArmSim-v0", options, copies=64, seed=3)
    frames = env.rollout(max(2, 250 // skip), break_when_any_done=False)["next"]
    assert bool(frames["terminated"].any())
    assert int(frames["step_count"].max()) <= 100
    assert bool((frames["done"] | (frames["step_count"] % skip == 0)).all())
    observed = frames["observation"][frames["terminated"].squeeze(-1)]
    goal_deg = (observed[:, :4] - observed[:, 4:]).abs().sum(-1)
    assert bool((goal_deg < 60 + 360).all()), "the end is what the agent sees"
    total = torch.zeros(64, 1)
    for frame in frames.unbind(1):
        total += frame["reward"]
        assert torch.allclose(total, frame["episode_reward"], atol=1e-3), (
            "all steps count, and none after the end"
        )
        total[frame["done"]] = 0.0


def test_a_run_of_copies_behind_a_frame_skip_counts_all_steps(tmp_path: Path) -> None:
    settings = replace(preset("default", "sac"), hidden=(8,), batch_size=4, updates_per_step=0.1)
    common: dict[str, Any] = {
        "options": {"max_steps": 20},
        "frame_skip": 4,
        "episodes": 2,
        "settings": settings,
    }
    copies = train(
        TrainConfig("WalkerSim-v0", num_envs=8, run_dir=tmp_path / "copies", **common)
    ).episodes
    alone = train(TrainConfig("WalkerSim-v0", run_dir=tmp_path / "alone", **common)).episodes
    assert (
        [episode.length for episode in copies] == [episode.length for episode in alone] == [20, 20]
    )
    # a round has as many steps of the agent as an episode of the robot
    assert copies[0].steps == 8 * 4 * 20
    # random actions, not a quarter of their rewards
    assert copies[0].return_ == pytest.approx(alone[0].return_, rel=0.5)


def test_a_link_that_is_lost_within_a_skip_ends_the_step(tmp_path: Path) -> None:
    settings = replace(preset("default", "sac"), hidden=(8,), batch_size=4, updates_per_step=0.1)
    config = TrainConfig("Cart", episodes=5, settings=settings, run_dir=tmp_path / "run")
    env = TransformedEnv(LosingCart(5), FrameSkip(3))
    result = train(config, env=env)
    lost = [episode for episode in result.episodes if episode.link_lost]
    assert [episode.length for episode in lost] == [4], "the step of the robot before it counts"
    data = load(tmp_path / "run")
    assert len(data) == result.episodes[-1].steps
    returns = [float(data.reward[data.episode == number].sum()) for number in range(5)]
    assert returns == pytest.approx([episode.return_ for episode in result.episodes], abs=1e-3)


def test_a_robots_link_that_is_lost_within_a_skip_keeps_the_steps_before(tmp_path: Path) -> None:
    task = replace(get_task("RunAway-v0"), max_steps=6)
    hub = Forgetful(make_body(task.robot, scene=task.scene))
    hub.answers_left = 4  # hello, reading, and a step of the three
    env = HubEnv(
        task,
        lambda _seed: Connection(HubLink(hub, task.robot, task.interface), hub.reset, hub),
        seed=0,
    )
    settings = replace(preset("default", "sac"), hidden=(8,), batch_size=4, updates_per_step=0.1)
    result = train(
        TrainConfig("RunAway-v0", episodes=2, settings=settings, run_dir=tmp_path / "run"),
        env=TransformedEnv(env, FrameSkip(3)),
    )
    env.close()
    assert [(episode.length, episode.link_lost) for episode in result.episodes] == [
        (1, True),
        (6, False),
    ]
    data = load(tmp_path / "run")
    assert len(data) == 7 and float(data.hub_time_s[0]) > 0


@pytest.mark.parametrize("agent", ["sac", "td3", "droq", "redq"])
def test_what_is_frozen_is_never_reset(agent: str) -> None:
    env = bricksrl.make("WalkerSim-v0", seed=0)
    settings = replace(preset("default", agent), hidden=(8,), batch_size=4, reset_every=3)
    teacher = make_learner("td3", env, replace(preset("default", "td3"), hidden=(8,))).policy
    learner = make_learner(agent, env, settings)
    add_base(learner, Base(teacher))
    learner.remember(env.rollout(20))
    kept = {
        name: part
        for name, part in learner.loss.state_dict().items()
        if name.startswith(("base.", "anchor."))
    }
    frozen = {name: part.clone() for name, part in kept.items() if isinstance(part, torch.Tensor)}
    assert any(name.startswith("base.") for name in frozen) and any(
        name.startswith("anchor.") for name in frozen
    )
    actor = [tensor.detach().clone() for tensor in learner.loss.actor.parameters()]
    learner.make_updates(3)
    after = learner.loss.state_dict()
    for name, tensor in frozen.items():
        assert torch.equal(tensor, after[name]), name
    now = [tensor.detach() for tensor in learner.loss.actor.parameters()]
    assert any(
        float((one - other).abs().max()) > 0.05 for one, other in zip(actor, now, strict=True)
    ), "the actor is"


def test_frozen_layers_of_an_own_network_are_never_reset(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from torch import nn\n"
        "def make_network(n, m):\n"
        "    known = nn.Linear(n, 8).requires_grad_(False)\n"
        "    half = nn.Linear(8, 8)\n"
        "    half.weight.requires_grad_(False)\n"
        "    return nn.Sequential(known, nn.ReLU(), half, nn.ReLU(), nn.Linear(8, m))\n"
    )
    env = bricksrl.make("WalkerSim-v0", seed=0)
    settings = replace(
        preset("default", "sac"), batch_size=4, reset_every=2, network=str(tmp_path / "mine.py")
    )
    learner = make_learner("sac", env, settings)
    learner.remember(env.rollout(20))
    before = [
        (name, tensor.clone(), tensor.requires_grad)
        for name, tensor in learner.loss.actor.named_parameters()
    ]
    learner.make_updates(2)
    for (name, tensor, is_learned), (_, now) in zip(
        before, learner.loss.actor.named_parameters(), strict=True
    ):
        assert torch.equal(tensor, now) is not is_learned, name


MEMORY_MAPPED = [agent for agent in AGENTS if hasattr(preset("default", agent), "memory_mapped")]


@pytest.mark.parametrize("agent", MEMORY_MAPPED)
def test_each_agent_learns_from_a_memory_mapped_buffer_as_from_memory(
    agent: str, tmp_path: Path
) -> None:
    learned = []
    for memory_mapped in (False, True):
        torch.manual_seed(0)
        env = bricksrl.make("RoboArmSim-v0", seed=0)
        settings = replace(
            preset("default", agent),
            hidden=(8,),
            batch_size=4,
            n_step=2,
            memory_mapped=memory_mapped,
        )
        learner = make_learner(agent, env, settings)
        learner.remember(env.rollout(20))
        learner.learn(1)
        learner.make_updates(3)
        learner.load_state_dict(learner.state_dict())
        learner.make_updates(1)
        learned.append(learner.policy_state())
    assert learned[0].keys() == learned[1].keys()
    assert all(torch.equal(learned[0][name], learned[1][name]) for name in learned[0])


@pytest.mark.parametrize(("gamma", "most"), [(0.95, 20), (0.999, 1000), (0.9999, 50), (1.0, 50)])
def test_td3_starts_at_a_value_that_the_data_show(gamma: float, most: float) -> None:
    env = bricksrl.make("WalkerSim-v0", seed=0)
    learner = make_learner("td3", env, TD3Settings(hidden=(8,), gamma=gamma, start_value=True))
    frames = env.rollout(50)
    frames["next", "terminated"][:] = False
    learner.loss.start_at_mean_value(frames)
    bias = float(learner.loss.critics[0][-1].bias.detach())
    assert bias / float(frames["next", "reward"].mean()) == pytest.approx(most, rel=0.02)
