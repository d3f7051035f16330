"""Cost of a CQL update: ours, with the gradient at drawn actions and at all of them, and TorchRL's
``CQLLoss``.

    python -m benchmarks cql_updates

The paper's settings (10 sampled actions of each kind, networks of two layers of 256, batches of
256), an observation of 8 numbers and an action of 4, one thread. All take turns for ``ROUNDS``
rounds in one process; medians of the CPU time and of the ratio in each round.
"""

from __future__ import annotations

import statistics
import time

import torch
from torch import nn
from torchrl.objectives import CQLLoss, SoftUpdate

from benchmarks.contestants import (
    ACTION,
    HIDDEN,
    OBSERVATION,
    UPDATES,
    Update,
    critic,
    learner_of,
    spec,
    stored,
)
from benchmarks.session import Session
from bricksrl.agents.networks import gaussian_policy, mlp

ROUNDS = 5


def measure(update: Update) -> float:
    """CPU milliseconds of one update."""
    started_s = time.process_time()
    update()
    return (time.process_time() - started_s) * 1e3 / UPDATES


def ours(drawn_actions: int) -> Update:
    """``UPDATES`` updates of ours in one call."""
    learner = learner_of("cql", drawn_actions=drawn_actions, imitation_updates=0)
    return lambda: learner.make_updates(UPDATES)


def torchrl() -> Update:
    """``UPDATES`` updates with TorchRL's loss, without vmap and with fused Adam."""
    actor = gaussian_policy(nn.Identity(), mlp(OBSERVATION, 2 * ACTION, HIDDEN), spec())
    loss = CQLLoss(
        actor,
        critic(),
        loss_function="l2",
        action_spec=spec(),
        deterministic_backup=False,
        num_random=10,
        with_lagrange=True,
        lagrange_thresh=5.0,
        deactivate_vmap=True,
    )
    loss.make_value_estimator(gamma=0.99)
    targets, optimizer, buffer = (
        SoftUpdate(loss, tau=0.005),
        torch.optim.Adam(loss.parameters(), lr=3e-4, fused=True),
        stored(),
    )

    def update() -> None:
        for _ in range(UPDATES):
            batch = buffer.sample()
            losses = [
                *loss.q_loss(batch)[:1],
                *loss.cql_loss(batch)[:1],
                loss.alpha_prime_loss(batch)[0],
            ]
            actor_loss, metadata = loss.actor_loss(batch)
            total = sum([*losses, actor_loss, loss.alpha_loss(metadata)[0]])
            assert isinstance(total, torch.Tensor)
            total.backward()
            optimizer.step()
            optimizer.zero_grad()
            targets.step()

    return update


def main(session: Session) -> None:
    """Measure in turns and write the medians."""
    session.parse()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    contestants = {"ours": ours(1), "ours, full gradient": ours(0), "torchrl": torchrl()}
    runs: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(ROUNDS):
        for name, update in contestants.items():
            runs[name].append(measure(update))
    ratio = statistics.median(
        other / own for other, own in zip(runs["torchrl"], runs["ours"], strict=True)
    )
    cpu_ms = {name: round(statistics.median(values), 2) for name, values in runs.items()}
    result = {
        "cpu_ms": cpu_ms,
        "updates_per_cpu_s": {name: round(1e3 / value, 1) for name, value in cpu_ms.items()},
    }
    print(result)
    session.write({**result, "cpu_ratio": round(ratio, 2), "rounds": ROUNDS})
