"""What an update costs: our agents against the same agents written with TorchRL's losses, CPU milliseconds and wall time.

    python benchmarks/updates.py

Networks of two layers of 256, batches of 256, an observation of 8 numbers and an action of 4, one thread. Both draw their batches
from their own replay buffers of 10,000 transitions. All contestants take turns for ``ROUNDS`` rounds in one process; medians
count. DroQ and REDQ are counted per update of the critics; 20 of them share one update of the actor on either side.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from machine import write
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.data import Bounded, LazyTensorStorage, TensorDictReplayBuffer
from torchrl.modules import MLP, ValueOperator
from torchrl.objectives import CrossQLoss, SACLoss, SoftUpdate, TD3Loss

from bricksrl.agents import Settings, make_agent, preset
from bricksrl.agents.agent import Transition
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import make_actor, make_deterministic_actor, make_normalised_actor, make_policy
from bricksrl.agents.off_policy import OffPolicyAgent

ROUNDS = 5
UPDATES = 20
OBSERVATION, ACTION, HIDDEN, BATCH = 8, 4, (256, 256), 256
STORED = 10_000
SPEC = Bounded(-1.0, 1.0, (ACTION,))


def settings_of(agent: str) -> Settings:
    """The paper's settings with the networks and the batch of this comparison; 20 updates in one call."""
    return replace(preset("paper", agent), hidden=HIDDEN, batch_size=BATCH, updates_per_step=UPDATES)


def ours(agent: str) -> Callable[[], object]:
    """``UPDATES`` updates in one call."""
    layout = ObservationLayout((-1.0,) * OBSERVATION, (1.0,) * OBSERVATION, (False,) * OBSERVATION)
    learner = make_agent(agent, layout, ACTION, settings_of(agent))
    assert isinstance(learner, OffPolicyAgent)
    for _ in range(STORED):
        one, other = torch.rand(2, OBSERVATION) * 2 - 1
        learner.remember(Transition(one, torch.rand(ACTION) * 2 - 1, float(one.sum()), other, False))
    return learner.update


class Critic(nn.Module):
    """An action value, from ordinary layers."""

    def __init__(self, *, layer_norm: bool = False, dropout: float = 0.0, batch_norm: bool = False) -> None:
        super().__init__()
        norm: dict[str, Any] = {}
        if layer_norm:
            norm = {"norm_class": nn.LayerNorm, "norm_kwargs": {"normalized_shape": HIDDEN[0]}}
        if batch_norm:
            norm = {"norm_class": nn.BatchNorm1d, "norm_kwargs": {"num_features": HIDDEN[0], "momentum": 0.01, "eps": 1e-3}}
        size = OBSERVATION + ACTION
        first = [nn.BatchNorm1d(size, momentum=0.01, eps=1e-3)] if batch_norm else []
        mlp = MLP(size, 1, num_cells=list(HIDDEN), activation_class=nn.ReLU, dropout=dropout or None, **norm)
        self.layers = nn.Sequential(*first, mlp)

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """The value ``[*batch, 1]``."""
        value: Tensor = self.layers(torch.cat((observation, action), -1))
        return value


def stored() -> TensorDictReplayBuffer:
    """TorchRL's replay buffer, full of random transitions."""
    buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(STORED), batch_size=BATCH)
    done = torch.zeros(STORED, 1, dtype=torch.bool)
    observation, following = (torch.rand(2, STORED, OBSERVATION) * 2 - 1).unbind()
    after = {"observation": following, "reward": observation.sum(-1, keepdim=True), "done": done, "terminated": done.clone()}
    data = {"observation": observation, "action": torch.rand(STORED, ACTION) * 2 - 1, "next": TensorDict(after, [STORED])}
    buffer.extend(TensorDict(data, [STORED]))
    return buffer


def torchrls_sac(critic: Critic, critics: int = 2, delay: int = 1) -> Callable[[], None]:
    """SAC, or DroQ and REDQ where the actor learns in every ``delay``-th update."""
    actor = make_policy(make_actor(OBSERVATION, ACTION, HIDDEN, 0.1), ACTION)
    value = ValueOperator(critic, in_keys=["observation", "action"])
    loss = SACLoss(actor, value, num_qvalue_nets=critics, loss_function="l2", action_spec=SPEC)
    loss.make_value_estimator(gamma=0.99)
    targets, optimiser, buffer = SoftUpdate(loss, tau=0.005), torch.optim.Adam(loss.parameters(), lr=3e-4), stored()

    def update() -> None:
        for i in range(1, UPDATES + 1):
            batch = buffer.sample()
            if i % delay == 0:
                found = loss(batch)
                total = found["loss_qvalue"] + found["loss_actor"] + found["loss_alpha"]
            else:
                total, _ = loss.qvalue_v2_loss(batch)
            total.backward()
            optimiser.step()
            optimiser.zero_grad()
            targets.step()

    return update


def torchrls_td3() -> Callable[[], None]:
    """TD3 with an actor that learns in every second update."""
    actor = TensorDictModule(make_deterministic_actor(OBSERVATION, ACTION, HIDDEN), ["observation"], ["action"])
    value = ValueOperator(Critic(), in_keys=["observation", "action"])
    loss = TD3Loss(actor, value, action_spec=SPEC, loss_function="l2")
    loss.make_value_estimator(gamma=0.99)
    targets, buffer = SoftUpdate(loss, tau=0.005), stored()
    for_critics = torch.optim.Adam(list(loss.qvalue_network_params.flatten_keys().values()), lr=3e-4)
    for_actor = torch.optim.Adam(list(loss.actor_network_params.flatten_keys().values()), lr=3e-4)

    def update() -> None:
        for i in range(1, UPDATES + 1):
            batch = buffer.sample()
            of_critics, _ = loss.value_loss(batch)
            of_critics.backward()
            for_critics.step()
            for_critics.zero_grad()
            if i % 2 == 0:
                of_actor, _ = loss.actor_loss(batch)
                of_actor.backward()
                for_actor.step()
                for_actor.zero_grad()
                targets.step()

    return update


def torchrls_crossq() -> Callable[[], None]:
    """CrossQ with an actor that learns in every third update."""
    actor = make_policy(make_normalised_actor(OBSERVATION, ACTION, HIDDEN, 0.1, 0.01), ACTION)
    value = ValueOperator(Critic(batch_norm=True), in_keys=["observation", "action"])
    loss = CrossQLoss(actor, value, num_qvalue_nets=2, loss_function="l2", action_spec=SPEC)
    loss.make_value_estimator(gamma=0.99)
    optimiser, buffer = torch.optim.Adam(loss.parameters(), lr=1e-3, betas=(0.5, 0.999)), stored()

    def update() -> None:
        for i in range(1, UPDATES + 1):
            batch = buffer.sample()
            total, _ = loss.qvalue_loss(batch)
            if i % 3 == 0:
                of_actor, found = loss.actor_loss(batch)
                total = total + of_actor + loss.alpha_loss(found["log_prob"])
            total.backward()
            optimiser.step()
            optimiser.zero_grad()

    return update


CONTESTANTS: dict[str, Callable[[], Callable[[], None]]] = {
    "sac": lambda: torchrls_sac(Critic()),
    "td3": torchrls_td3,
    "droq": lambda: torchrls_sac(Critic(layer_norm=True, dropout=0.01), delay=20),
    "redq": lambda: torchrls_sac(Critic(), critics=10, delay=20),
    "crossq": torchrls_crossq,
}


def measure(update: Callable[[], object]) -> tuple[float, float]:
    """CPU and wall milliseconds of one update."""
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    update()
    return tuple((end - start) * 1e3 / UPDATES for end, start in ((time.process_time(), cpu_s), (time.perf_counter(), wall_s)))  # type: ignore[return-value]


def main() -> None:
    """Measure all in turns and write the medians."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    contestants = {(agent, "ours"): ours(agent) for agent in CONTESTANTS}
    contestants |= {(agent, "torchrl"): make() for agent, make in CONTESTANTS.items()}
    runs: dict[tuple[str, str], list[tuple[float, float]]] = {key: [] for key in contestants}
    for update in contestants.values():
        update()  # the first calls warm up
    for _ in range(ROUNDS):
        for key, update in contestants.items():
            runs[key].append(measure(update))
    agents: dict[str, Any] = {}
    for agent in CONTESTANTS:
        found = {}
        for who in ("ours", "torchrl"):
            cpu_ms, wall_ms = (statistics.median(values) for values in zip(*runs[agent, who], strict=True))
            found[who] = {"cpu_ms": round(cpu_ms, 2), "wall_ms": round(wall_ms, 2)}
        ratio = statistics.median(t[0] / o[0] for o, t in zip(runs[agent, "ours"], runs[agent, "torchrl"], strict=True))
        agents[agent] = {**found, "cpu_ratio": round(ratio, 2)}
        print(agent, agents[agent])
    setup = {"hidden": HIDDEN, "batch_size": BATCH, "observation": OBSERVATION, "action": ACTION, "rounds": ROUNDS}
    print(write("updates", {"setup": setup, "agents": agents}))


if __name__ == "__main__":
    main()
