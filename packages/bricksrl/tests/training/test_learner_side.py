"""What a learner is sent and sends, without a process of its own."""

from __future__ import annotations

import io
import itertools
from dataclasses import replace
from queue import SimpleQueue
from typing import Any

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.envs import EnvBase, RewardScaling, TransformedEnv
from torchrl.envs.utils import ExplorationType, set_exploration_type
from toys import Cart

from bricksrl import child_process, make
from bricksrl.agents import make_learner
from bricksrl.agents.learner import Learner
from bricksrl.agents.ppo import PPOSettings
from bricksrl.agents.sac import SACSettings
from bricksrl.errors import LearnerError
from bricksrl.training import TrainConfig
from bricksrl.training import learner_side as sides
from bricksrl.training.learner_side import (
    AsyncLearner,
    InLoopLearner,
    LearningPace,
    serve,
)

SMALL = SACSettings(hidden=(8,), batch_size=4, prefill_episodes=0, updates_per_step=1)
OF_FOUR = PPOSettings(hidden=(8,), steps=4, batch_size=4, passes=1)
NEW = {"asked": 0, "done": 0}


class Messages(SimpleQueue):  # type: ignore[type-arg]
    """Messages of the robot's side, all there already: waiting for more fails."""

    def get(self, *_: Any, **__: Any) -> Any:
        return super().get_nowait()


def steps(env: EnvBase, learner: Learner, count: int) -> TensorDictBase:
    """Steps of a policy that explores, ``[count]``."""
    with set_exploration_type(ExplorationType.RANDOM), torch.no_grad():
        return env.rollout(count, learner.policy, break_when_any_done=False)


def state_of(learner: Learner, pace: dict[str, int] = NEW) -> dict[str, Any]:
    return {"agent": learner.state_dict(), "pace": pace, "collected": [], "transforms": {}}


def served(
    agent: str,
    settings: Any,
    count: int,
    *,
    asked_first: int = 0,
) -> list[tuple[int, dict[str, torch.Tensor], object]]:
    """What a learner tells of its updates, one after each step; all messages are there at once."""
    env = Cart()
    learner = make_learner(agent, env, settings)
    inbox = Messages()
    for frame in steps(env, learner, count).split(1):
        inbox.put(("remember", (0, dict(frame.flatten_keys(".").items()))))
        inbox.put(("learn", 1))
    learned: list[tuple[int, dict[str, torch.Tensor], object]] = []

    def send(kind: str, content: Any) -> None:
        if kind == "learned":
            learned.append(content)
        if len(learned) == count + asked_first:
            inbox.put(child_process.END)

    begin = {
        "config": TrainConfig("Cart", agent, settings=settings).to_dict(),
        "specs": {
            name: getattr(env, name).clone()
            for name in ("observation_spec", "action_spec", "reward_spec", "done_spec")
        },
        "layout": None,
        "has_task": False,
        "state": state_of(learner, {"asked": asked_first, "done": 0}),
    }
    serve(begin, inbox, send)
    return learned


def test_slow_on_policy_learner_uses_each_batch() -> None:
    """All frames are there before it begins; none may be overwritten before it was learned from."""
    learned = served("ppo", OF_FOUR, 8)
    assert [bool(metrics) for _, metrics, _ in learned] == [False, False, False, True] * 2


def test_updates_that_are_due_wait_for_no_message() -> None:
    """Those of a checkpoint too; and each message comes before the next update."""
    learned = served("sac", SMALL, 6, asked_first=2)
    assert [done for done, _, _ in learned] == list(range(1, 9))
    assert all(metrics for _, metrics, _ in learned), "all six steps are there from the first one"


def test_batches_of_the_learners_size_are_not_collected() -> None:
    """Single steps are, until they are as many."""
    env = Cart()
    learner = make_learner("ppo", env, OF_FOUR)
    remembered: list[int] = []
    learner.remember = lambda frames, _robot=0: remembered.append(frames.shape[-1])
    side = InLoopLearner(learner, state_of(learner))
    frames = steps(env, learner, 8)[None]
    side.remember(frames[:, :4])
    side.remember(frames[:, :5])
    assert remembered == [4, 5]
    for step in range(3):
        side.remember(frames[:, step : step + 1])
        assert side.learn(1) == {}
    assert remembered == [4, 5]
    side.remember(frames[:, 3:4])
    assert remembered == [4, 5, 4]
    assert side.pace == LearningPace(3, 3)


def test_weights_are_told_once() -> None:
    env = Cart()
    learner = make_learner("sac", env, SMALL)
    side = InLoopLearner(learner, state_of(learner))
    assert side.new_weights() is not None, "the first ones are new"
    assert side.new_weights() is None
    side.remember(steps(env, learner, 5)[None])
    side.learn(1)
    assert side.new_weights() is not None
    assert side.new_weights() is None


def test_pace_counts_only_steps_that_were_asked_for() -> None:
    learner = make_learner("sac", Cart(), replace(SMALL, updates_per_step=4))
    assert LearningPace(10, 5).updates_per_step(learner) == 2.0
    assert LearningPace().updates_per_step(learner) is None
    assert LearningPace(10, 5).updates_per_step(make_learner("random", Cart())) is None
    # Nothing is pending in the loop, whatever a checkpoint of another process says.
    side = InLoopLearner(learner, state_of(learner, {"asked": 30, "done": 10}))
    assert side.pace == LearningPace(30, 30)


class Told:
    """The learner's process, as far as the robot's side knows it."""

    def __init__(self, _module: str, deliver: Any) -> None:
        self.deliver = deliver
        self.sent: list[tuple[str, Any]] = []

    def send(self, kind: str, content: Any) -> None:
        self.sent.append((kind, content))

    def end(self, _timeout_s: float) -> None:
        """It has nothing pending."""


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[Told]:
    """Processes that were started."""
    started: list[Told] = []

    def start(module: str, deliver: Any) -> Told:
        started.append(Told(module, deliver))
        return started[-1]

    monkeypatch.setattr(sides, "ChildProcess", start)
    return started


def test_transforms_that_the_process_cannot_know_are_refused_before_it_starts(
    told: list[Told],
) -> None:
    """With a dataset, which has to pass through them; the config's own it makes itself."""
    env = TransformedEnv(Cart(), RewardScaling(0.0, 0.1))
    learner = make_learner("sac", Cart(), SMALL)
    config = TrainConfig("Cart", settings=SMALL)
    of_data = replace(config, demonstrations="somewhere")
    with pytest.raises(LearnerError, match="does not know this environment's transforms"):
        AsyncLearner(of_data, env, learner, state_of(learner))
    assert not told
    normalized = replace(of_data, transform="mine.py")
    allowed = [(config, env), (of_data, Cart()), (normalized, env)]
    for one, given in allowed:
        with AsyncLearner(one, given, learner, state_of(learner)):
            (kind, begin), *_ = told[-1].sent
        assert kind == "begin"
        assert TrainConfig.from_dict(begin["config"]) == one
        assert told[-1].sent[-1][0] == "end"


def test_what_the_process_says_is_known_at_once(told: list[Told]) -> None:
    learner = make_learner("sac", Cart(), SMALL)
    config = TrainConfig("Cart", settings=SMALL, realtime=True)
    with AsyncLearner(config, Cart(), learner, state_of(learner)) as side:
        (process,) = told
        assert side.new_weights() is None
        process.deliver(("ready", {"weight": torch.zeros(1)}))
        side.wait_until_ready()
        assert side.new_weights() == {"weight": torch.zeros(1)}
        assert side.learn(3) == {}
        assert side.pace == LearningPace(3, 0)
        process.deliver(("learned", (1, {"loss": torch.tensor(1.0)}, {})))
        process.deliver(("learned", (2, {"loss": torch.tensor(3.0)}, {})))
        assert side.pace == LearningPace(3, 2)
        assert side.learn(0) == {"loss": torch.tensor(2.0)}, "the mean of both updates"
        assert side.learn(0) == {}, "which is told once"
        process.deliver(("failed", "failed (it is broken)"))
        with pytest.raises(
            LearnerError,
            match=r"^the learner's process failed \(it is broken\); resume the run from its last",
        ):
            side.learn(1)


def test_networks_on_a_gpu_are_sent_over_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = make_learner("sac", make("RunAway-v0"), device="meta")  # stands for a GPU
    with monkeypatch.context() as patched:
        patched.setattr(
            torch.Tensor, "cpu", lambda tensor: torch.zeros(tensor.shape, dtype=tensor.dtype)
        )
        data = io.BytesIO()
        child_process._Pickler(data).dump(learner.state_dict())
    assert data.tell() > 10_000


def test_real_time_runs_are_asynchronous_by_default() -> None:
    assert not TrainConfig("Walker-v0").asynchronous
    assert TrainConfig("Walker-v0", realtime=True).asynchronous
    assert TrainConfig("Walker-v0", hub="ble").asynchronous
    assert not TrainConfig("Walker-v0", realtime=True, asynchronous=False).asynchronous
    for config, chosen in itertools.product(
        (TrainConfig("Walker-v0"), TrainConfig("Walker-v0", realtime=True)), (True, False)
    ):
        told = replace(config, asynchronous=chosen)
        assert TrainConfig.from_dict(told.to_dict()) == told


def test_copy_of_the_policy_stays_when_the_policy_learns_on() -> None:
    learner = make_learner("sac", Cart(), SMALL)
    state = learner.policy_state()
    before = {name: tensor.clone() for name, tensor in state.items()}
    with torch.no_grad():
        for parameter in learner.policy.parameters():
            parameter.add_(1.0)
    assert all(torch.equal(state[name], tensor) for name, tensor in before.items())
    assert not any(
        torch.equal(state[name], tensor.detach())
        for name, tensor in learner.policy.named_parameters()
    )


def test_weights_of_another_process_are_taken_between_two_actions() -> None:
    learner, other = (make_learner("sac", Cart(), SMALL) for _ in range(2))
    seen = TensorDict({"observation": torch.tensor([300.0, 0.5])})
    best = other.exploit(seen.clone())["action"]
    assert not torch.equal(learner.exploit(seen.clone())["action"], best)
    learner.weights.append(other.policy_state())
    assert torch.equal(learner.exploit(seen.clone())["action"], best)
    assert not learner.weights
