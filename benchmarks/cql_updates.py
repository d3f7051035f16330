"""What an update of CQL costs: ours, with the gradient at drawn actions and at all of them, against TorchRL's ``CQLLoss``.

    python benchmarks/cql_updates.py

The paper's settings (10 sampled actions of each kind, networks of two layers of 256, batches of 256), an observation of 8 numbers
and an action of 4, one thread. All take turns for ``ROUNDS`` rounds in one process; medians of the CPU time count.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import replace

import torch
from contestants import ACTION, HIDDEN, OBSERVATION, STORED, UPDATES, Update, critic, spec, stored
from machine import command, write
from torchrl.objectives import CQLLoss, SoftUpdate

from bricksrl.agents import CQLSettings, make_agent, preset
from bricksrl.agents.agent import Transitions
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.networks import make_actor, make_policy
from bricksrl.agents.off_policy import OffPolicyAgent

ROUNDS = 3


def measure(update: Update) -> float:
    """CPU milliseconds of one update."""
    started_s = time.process_time()
    update()
    return (time.process_time() - started_s) * 1e3 / UPDATES


def ours(drawn_actions: int) -> Update:
    """``UPDATES`` updates in one call."""
    settings = preset("paper", "cql")
    assert isinstance(settings, CQLSettings)
    layout = ObservationLayout((-1.0,) * OBSERVATION, (1.0,) * OBSERVATION, (False,) * OBSERVATION)
    agent = make_agent("cql", layout, ACTION, replace(settings, drawn_actions=drawn_actions, imitation_updates=0))
    assert isinstance(agent, OffPolicyAgent)
    one, other = (torch.rand(2, STORED, OBSERVATION) * 2 - 1).unbind()
    never = torch.zeros(STORED, dtype=torch.bool)
    agent.study(Transitions(one, torch.rand(STORED, ACTION) * 2 - 1, one.sum(-1), other, never, never))
    return lambda: agent.update(UPDATES)


def torchrls() -> Update:
    """The same with TorchRL's loss, eagerly."""
    actor = make_policy(make_actor(OBSERVATION, ACTION, HIDDEN, 0.1), ACTION)
    loss = CQLLoss(
        actor,
        critic(),
        loss_function="l2",
        action_spec=spec(),
        deterministic_backup=False,
        num_random=10,
        with_lagrange=True,
        lagrange_thresh=5.0,
    )
    loss.make_value_estimator(gamma=0.99)
    targets, optimiser, buffer = SoftUpdate(loss, tau=0.005), torch.optim.Adam(loss.parameters(), lr=3e-4), stored()

    def update() -> None:
        for _ in range(UPDATES):
            batch = buffer.sample()
            found = [*loss.q_loss(batch)[:1], *loss.cql_loss(batch)[:1], loss.alpha_prime_loss(batch)[0]]
            of_actor, about = loss.actor_loss(batch)
            total = sum([*found, of_actor, loss.alpha_loss(about)[0]])
            assert isinstance(total, torch.Tensor)
            total.backward()
            optimiser.step()
            optimiser.zero_grad()
            targets.step()

    return update


def main() -> None:
    """Measure in turns and write the medians."""
    command(__doc__).parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    contestants = {"ours": ours(1), "ours, full gradient": ours(0), "torchrl": torchrls()}
    runs: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(ROUNDS):
        for name, update in contestants.items():
            runs[name].append(measure(update))
    cpu_ms = {name: round(statistics.median(values), 2) for name, values in runs.items()}
    found = {"cpu_ms": cpu_ms, "updates_per_cpu_s": {name: round(1e3 / value, 1) for name, value in cpu_ms.items()}}
    print(found)
    print(write("cql_updates", {**found, "cpu_ratio": round(cpu_ms["torchrl"] / cpu_ms["ours"], 2), "rounds": ROUNDS}))


if __name__ == "__main__":
    main()
