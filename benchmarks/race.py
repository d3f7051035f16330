"""A race to a return of -20 on WalkerSim-v0: our agents, Stable-Baselines3, SBX and TorchRL's own
SAC, in robot steps and CPU seconds.

    python -m benchmarks race [--seeds 5] [--first-seed 0] [--every 100] [--limit 4000]

Each contestant trains in its own process with one thread, start-up (imports, compilation) included,
and is evaluated after every ``--every`` steps on 40 deterministic episodes, whose time is not
included; it has reached the goal once their mean return is -20. The others run twice: with our
features and the values of our default settings (learning rate, discount, temperature, networks,
layer normalisation where they have it, updates per step, initial random episodes), and with their
own defaults on raw observations; a delayed actor and mirrored batches only we have. TorchRL has no
defaults of its own for an agent; its losses run as fast as they can. Imports count, and some import
whatever they find (TorchRL's buffers import Ray), so an environment should have what users have:
``pip install bricksrl stable_baselines3``, and SBX, which loads JAX by itself. The contestants
take turns seed by seed, so that all run under the same load; the result is the median over the
seeds. A contestant that does not reach the goal within ``--limit`` steps counts with this limit.
Other contestants stay in the result.
"""

from __future__ import annotations

import importlib.util
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

from benchmarks.session import Session
from brickhub.cli import collect_rarely

ENV, ACTIONS, GOAL, EVALUATED = "WalkerSim-v0", 4, -20.0, 40
CONTESTANTS = {
    "ours_sac": ("", ""),
    "ours_td3": ("", ""),
    "ours_droq": ("", ""),
    "torchrl_sac_like_ours": ("torchrl", "sac"),
    "sb3_sac_like_ours": ("stable_baselines3", "sac"),
    "sbx_sac_like_ours": ("sbx", "sac"),
    "sbx_crossq_like_ours": ("sbx", "crossq"),
    "sbx_droq_like_ours": ("sbx", "droq"),
    "sb3_sac": ("stable_baselines3", "sac"),
    "sbx_sac": ("sbx", "sac"),
    "sbx_crossq": ("sbx", "crossq"),
    "sbx_droq": ("sbx", "droq"),
}


class Race:
    """Evaluations of one contestant after ``every`` steps, with the clock stopped meanwhile."""

    def __init__(self, limit: int, every: int) -> None:
        import torch

        import bricksrl

        torch.set_num_threads(1)
        self.limit, self.every, self._paused_s = limit, every, 0.0
        self.returns: list[tuple[int, float, float]] = []
        self._env = bricksrl.make(ENV, batch_size=EVALUATED, seed=1000)

    def is_over(self, steps: int, act: Callable[[Any], Any]) -> bool:
        """Evaluate ``act``, observations ``[40, n]`` to actions ``[40, m]``, after ``steps``; true
        at the goal or limit."""
        import torch

        started_s = time.process_time()
        self._env.set_seed(1000)
        state, total = self._env.reset(), torch.zeros(EVALUATED, 1)
        for _ in range(self._env.task.max_steps):
            state["action"] = torch.as_tensor(act(state["observation"]))
            state = self._env.step(state)["next"]
            total += state["reward"]
        value = float(total.mean())
        self.returns.append((steps, round(started_s - self._paused_s, 2), round(value, 2)))
        self._paused_s += time.process_time() - started_s
        return value >= GOAL or steps >= self.limit


def run_ours(agent: str, seed: int, race: Race) -> None:
    """Our agent, as `bricksrl train` runs it."""
    import tempfile
    import threading
    from pathlib import Path

    import torch
    from tensordict import TensorDict

    from bricksrl.agents import preset
    from bricksrl.agents.learner import Learner
    from bricksrl.training import Callback, Phase, TrainConfig, train

    stop = threading.Event()

    class Judge(Callback):
        """Evaluates the learner in mid-run."""

        steps = 0

        def on_learner(self, learner: Learner) -> None:
            self.learner = learner

        def on_step(self, episode: int, step: int, phase: Phase) -> None:
            self.steps += 1
            if self.steps % race.every == 0 and not stop.is_set():
                state = torch.get_rng_state()
                if race.is_over(self.steps, act):
                    stop.set()
                torch.set_rng_state(state)

    def act(observation: torch.Tensor) -> torch.Tensor:
        action: torch.Tensor = judge.learner.exploit(
            TensorDict({"observation": observation}, [len(observation)])
        )["action"]
        return action

    judge = Judge()
    with tempfile.TemporaryDirectory() as parent:
        episodes = race.limit // 100 + 1
        config = TrainConfig(
            ENV,
            agent,
            episodes,
            seed,
            settings=preset("default", agent),
            record=False,
            run_dir=Path(parent) / "run",
        )
        train(config, judge, stop=stop)


def run_other(package: str, agent: str, seed: int, race: Race, *, like_ours: bool) -> None:
    """The agent of Stable-Baselines3 or SBX, with our features and settings or with its own."""
    import gymnasium
    import numpy as np
    import torch

    import bricksrl.envs  # registers with Gymnasium
    from bricksrl.agents import preset
    from bricksrl.agents.features.observed import ObservationEncoder
    from bricksrl.envs.transforms import layout_of

    env = gymnasium.make(f"bricksrl/{ENV}")
    encoder = ObservationEncoder(layout_of(bricksrl.make(ENV)))

    def features(observation: Any) -> Any:
        return encoder(torch.as_tensor(observation)).numpy()

    if like_ours:
        space = gymnasium.spaces.Box(-np.inf, np.inf, (encoder.size,), np.float32)
        env = gymnasium.wrappers.TransformObservation(env, features, space)
    settings: dict[str, Any] = {}
    policy: dict[str, Any] = {}
    if like_ours:
        ours = preset("default", agent)
        settings = {
            "learning_rate": ours.learning_rate,
            "gamma": ours.gamma,
            "batch_size": ours.batch_size,
        }
        settings |= {
            "gradient_steps": round(ours.updates_per_step),
            "learning_starts": 100 * ours.prefill_episodes,
        }
        settings |= {
            "ent_coef": f"auto_{ours.alpha_init}",
            "target_entropy": ours.target_entropy * ACTIONS,
        }
        policy = {"net_arch": list(ours.hidden)}
        if package == "sbx" and agent == "sac":
            policy["layer_norm"] = ours.critic_norm == "layer"
    if agent == "droq":
        policy |= {"dropout_rate": 0.01, "layer_norm": True}
        settings |= {"gradient_steps": 20, "policy_delay": 20}
    module = importlib.import_module(package)
    algorithm = module.CrossQ if agent == "crossq" else module.SAC
    model = algorithm(
        "MlpPolicy", env, seed=seed, policy_kwargs=policy or None, device="cpu", **settings
    )

    def act(observation: torch.Tensor) -> Any:
        inputs = features(observation) if like_ours else observation.numpy()
        return model.predict(inputs, deterministic=True)[0]

    from stable_baselines3.common.callbacks import BaseCallback

    class Judge(BaseCallback):  # type: ignore[misc]
        """Evaluates the model in mid-run."""

        def _on_step(self) -> bool:
            return self.num_timesteps % race.every != 0 or not race.is_over(self.num_timesteps, act)

    model.learn(race.limit, callback=Judge())


def run_torchrl(seed: int, race: Race) -> None:
    """SAC of TorchRL's modules in a plain loop, with our features and settings: without vmap, with
    one backward pass and a fused Adam."""
    import torch
    from tensordict.nn import NormalParamExtractor, TensorDictModule
    from torch import nn
    from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
    from torchrl.envs.utils import ExplorationType, set_exploration_type, step_mdp
    from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator
    from torchrl.objectives import SACLoss, SoftUpdate

    import bricksrl
    from bricksrl.agents import preset
    from bricksrl.agents.features.observed import ObservationEncoder
    from bricksrl.envs.transforms import layout_of

    torch.manual_seed(seed)
    env = bricksrl.make(ENV, seed=seed)
    encoder, ours = ObservationEncoder(layout_of(env)), preset("default", "sac")

    def network(inputs: int, outputs: int) -> Any:
        return MLP(inputs, outputs, num_cells=list(ours.hidden), activation_class=nn.ReLU)

    class Critic(nn.Module):
        """An action value; without layer normalisation, as with it three seeds needed 700 steps in
        place of 400."""

        def __init__(self) -> None:
            super().__init__()
            self.network = network(encoder.size + ACTIONS, 1)

        def forward(self, features: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
            value: torch.Tensor = self.network(torch.cat((features, action), -1))
            return value

    policy = nn.Sequential(network(encoder.size, 2 * ACTIONS), NormalParamExtractor())
    spec = env.action_spec
    actor = ProbabilisticActor(
        TensorDictModule(policy, ["features"], ["loc", "scale"]),
        spec=spec,
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        return_log_prob=True,
    )
    loss = SACLoss(
        actor,
        ValueOperator(Critic(), in_keys=["features", "action"]),
        num_qvalue_nets=2,
        loss_function="l2",
        action_spec=spec,
        alpha_init=ours.alpha_init,
        target_entropy=ours.target_entropy * ACTIONS,
        deactivate_vmap=True,
    )
    loss.make_value_estimator(gamma=ours.gamma)
    targets = SoftUpdate(loss, tau=ours.tau)
    optimizer = torch.optim.Adam(loss.parameters(), lr=ours.learning_rate, fused=True)
    buffer = TensorDictReplayBuffer(
        storage=LazyTensorStorage(race.limit), batch_size=ours.batch_size
    )

    @torch.no_grad()
    def act(observation: torch.Tensor) -> torch.Tensor:
        loc, _ = policy(encoder(observation))
        return torch.tanh(loc)

    def update() -> None:
        parts = loss(buffer.sample())
        (parts["loss_qvalue"] + parts["loss_actor"] + parts["loss_alpha"]).backward()
        optimizer.step()
        optimizer.zero_grad()
        targets.step()

    first = 100 * ours.prefill_episodes
    state = env.reset()
    for step in range(1, race.limit + 1):
        state["features"] = encoder(state["observation"])
        with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
            state = env.rand_action(state) if step <= first else actor(state)
        stepped = env.step(state)
        stepped["next", "features"] = encoder(stepped["next", "observation"])
        buffer.add(stepped)
        if step % race.every == 0 and race.is_over(step, act):
            return
        for _ in range(round(ours.updates_per_step) if step > first else 0):
            update()
        state = env.reset() if bool(stepped["next", "done"]) else step_mdp(stepped)


def run(name: str, seed: int, limit: int, every: int) -> list[tuple[int, float, float]]:
    """Evaluations of a contestant: steps, CPU seconds, return."""
    if hasattr(os, "sched_setaffinity"):
        # what starts threads all the same shares one core with them
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    package, agent = CONTESTANTS[name]
    if not package:
        collect_rarely()  # as the command does
    race = Race(limit, every)
    if package == "torchrl":
        run_torchrl(seed, race)
    elif package:
        run_other(package, agent, seed, race, like_ours=name.endswith("like_ours"))
    else:
        run_ours(name.removeprefix("ours_"), seed, race)
    return race.returns


def main(session: Session) -> None:
    """Race all of them and write the medians."""
    parser = session.parser
    parser.add_argument("--seeds", type=int, choices=range(1, 101), metavar="N", default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--every", type=int, default=100, help="robot steps between evaluations")
    parser.add_argument("--limit", type=int, default=4000, help="robot steps at most")
    parser.add_argument(
        "--contestants", nargs="+", default=list(CONTESTANTS), choices=list(CONTESTANTS)
    )
    args = session.parse()
    names = [
        name
        for name in args.contestants
        if not CONTESTANTS[name][0] or importlib.util.find_spec(CONTESTANTS[name][0])
    ]
    for name in set(args.contestants) - set(names):
        print(
            f"{name} is left out: {CONTESTANTS[name][0]} is missing; pip install "
            '"bricksrl[benchmarks]"'
        )
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    jobs = {
        f"{name}-{seed}-{args.every}-{args.limit}": (name, seed, args.limit, args.every)
        for seed in seeds
        for name in names
    }
    runs: dict[str, list[Any]] = {}
    for (name, *_), evaluations in zip(
        jobs.values(), session.outcomes(run, jobs, processes=1, fresh=True), strict=True
    ):
        runs.setdefault(name, []).append(evaluations)
    known = session.known()
    setup = {"env": ENV, "goal": GOAL, "limit": args.limit, "evaluated_episodes": EVALUATED}
    results: dict[str, Any] = known["contestants"] if known.get("setup") == setup else {}
    results |= {
        name: summary(runs_of) | {"every": args.every, "seeds": list(seeds)}
        for name, runs_of in runs.items()
    }
    for name, result in results.items():
        reached = f"{result['there']} of {len(result['runs'])} there"
        print(f"{name:22} {result['steps']:6} steps {result['cpu_s']:7.1f} s CPU, {reached}")
    session.write(
        {
            "setup": setup,
            "contestants": {name: results[name] for name in CONTESTANTS if name in results},
        }
    )


def summary(runs: list[Any]) -> dict[str, Any]:
    """Medians over the seeds of a contestant, and how many of them reached the goal."""
    ends = [evaluations[-1] for evaluations in runs]
    return {
        "steps": statistics.median(end[0] for end in ends),
        "cpu_s": round(statistics.median(end[1] for end in ends), 1),
        "there": sum(end[2] >= GOAL for end in ends),
        "runs": runs,
    }
