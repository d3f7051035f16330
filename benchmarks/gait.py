"""Gaits: policy search on the Walker and on six legs, and policies that run on the hub alone.

    python -m benchmarks gait

Each seed searches for 300 robot steps; the gait that it keeps is compared with the hand-written
trot, in the same episodes on the same twin. CPU seconds are those of the run without its start-up.
A picture in docs/images shows what the searches of all seeds together know of the landscape. On the
hub: the gait of the first seed, and SAC's policies as networks, see `bricksrl.policies.hub_export`.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from tensordict.nn import TensorDictModule

from benchmarks.learning import has_made
from benchmarks.scripted import CONTROLLERS
from benchmarks.session import Session
from benchmarks.stopping import StopWhen
from brickhub.search.gaussian_process import GaussianProcess
from bricksrl.agents.search.gait import PolicySearch
from bricksrl.training import TrainConfig, train

STEPS, EPISODES, SEED, FIRST_SEED = 300, 2, 4711, 100
"""Robot steps of a search; episodes of an evaluation, and its seed; first seed of the searches.
Settings were chosen on others and on the first four of these; the last six chose none."""
WALKER = "Walker-v1"
PICTURES = Path(__file__).parent.parent / "docs" / "images"
SIX_LEGS = f"{Path(__file__).parent.parent / 'examples' / '15_six_legs.py'}:WALK"
ON_HUB = {
    "gait": (WALKER, "gait", 3),
    "network": (WALKER, "sac", 12),
    "network with the distance": ("RunAway-v0", "sac", 12),
}
"""Environment, agent and training episodes of what is exported."""


class Watch(StopWhen):
    """Callback that ends a run after enough steps, counts falls, and measures CPU time."""

    def __init__(self, steps: int) -> None:
        super().__init__(partial(has_made, steps, "steps"))
        self.falls, self.cpu_s, self._started_s = 0, 0.0, 0.0
        self.learner: Any = None

    def on_learner(self, learner: Any) -> None:
        self.learner = learner

    def on_start(self, *_: Any) -> None:
        self._started_s = time.process_time()

    def on_transition(self, _episode: int, _step: int, _phase: Any, transition: Any) -> None:
        self.falls += int(transition["next", "terminated"])

    def on_end(self, _: Any) -> None:
        self.cpu_s = time.process_time() - self._started_s


def evaluated(env_id: str, policy: Any) -> dict[str, float]:
    """Mean return and speed of a policy on episodes of its own."""
    import bricksrl
    from bricksrl.envs.rollout import play_episodes

    env = bricksrl.make(env_id, seed=SEED)
    played = list(play_episodes(env, policy, EPISODES, SEED))
    env.close()
    speeds = [episode.metrics["forward_speed_m_s"] for episode in played]
    return {
        "return": sum(episode.return_ for episode in played) / EPISODES,
        "speed_m_s": sum(speeds) / EPISODES,
    }


def trot() -> dict[str, float]:
    """The hand-written trot."""
    return evaluated(WALKER, CONTROLLERS[WALKER])


def search(env_id: str, seed: int) -> dict[str, Any]:
    """A search: the gait that it keeps, and its trials."""
    watch = Watch(STEPS)
    with tempfile.TemporaryDirectory() as parent:
        config = TrainConfig(
            env_id, "gait", STEPS, seed, record=False, run_dir=Path(parent) / "run"
        )
        steps = train(config, watch, stop=watch.stop).episodes[-1].steps
    learner: PolicySearch = watch.learner
    names = [entry.name for entry in learner.search.entries]
    best = {name: round(value, 3) for name, value in zip(names, learner.search.best, strict=True)}
    outcome = evaluated(env_id, TensorDictModule(learner.actor, ["observation"], ["action"]))
    return {
        "steps": steps,
        **outcome,
        "falls": watch.falls,
        "cpu_s": round(watch.cpu_s, 2),
        "best": best,
        "trials": learner.search.state(),
    }


def on_hub(env_id: str, agent: str, episodes: int) -> dict[str, Any]:
    """A policy as a program, and what it does on the virtual hub."""
    from bricksrl.policies.hub_export import export_program

    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        train(TrainConfig(env_id, agent, episodes, record=False, run_dir=folder))
        return {
            "env": env_id,
            "agent": agent,
            **asdict(export_program(folder, Path(parent) / "program.py")),
        }


def draw(path: Path, searches: list[dict[str, Any]]) -> None:
    """Draw what the Gaussian process of all trials knows of speed and phase; a dot for each
    trial."""
    from bricksrl.agents.search.structures import make_oscillators
    from bricksrl.envs import make
    from bricksrl.plotting import new_figure, save

    env = make(WALKER, seed=0)
    entries = make_oscillators(env).numbers
    env.close()
    numbers = [row for one in searches for row in one["trials"]["numbers"]]
    scores = [score for one in searches for score in one["trials"]["scores"]]
    # in the scales of the first search: those of all trials together would take minutes to find
    process = GaussianProcess(entries, searches[0]["trials"]["scales"], len(scores))
    for row, score in zip(numbers, scores, strict=True):
        process.tell(row, score)
    places = [place / 60 for place in range(61)]
    across, along = (
        [entry.low + place * (entry.high - entry.low) for place in places] for entry in entries
    )
    means = [[process.mean_at((x, y)) for x in across] for y in along]
    figure = new_figure(6.4, 5.2)
    axes = figure.subplots()
    image = axes.pcolormesh(across, along, means, cmap="viridis", shading="gouraud")
    tried_across, tried_along = zip(*numbers, strict=True)
    axes.scatter(tried_across, tried_along, s=6, c="white", linewidths=0)
    axes.set_xlabel("speed / share of the largest")
    axes.set_ylabel("the back lags behind the front by / degrees")
    figure.colorbar(image, label="reward of a step")
    save(figure, path, 110)


def main(session: Session) -> None:
    """Measure, and write."""
    session.parser.add_argument(
        "--on-hub", nargs="*", default=list(ON_HUB), choices=list(ON_HUB), metavar="KIND"
    )
    args = session.parse(seeds=10, six_legs_seeds=3)
    (reference,) = session.outcomes(trot, {"trot": ()})
    walkers, sixes = (
        range(FIRST_SEED, FIRST_SEED + count) for count in (args.seeds, args.six_legs_seeds)
    )
    walker = list(session.outcomes(search, {f"walker-{seed}": (WALKER, seed) for seed in walkers}))
    six = list(session.outcomes(search, {f"six-legs-{seed}": (SIX_LEGS, seed) for seed in sixes}))
    programs = list(
        session.outcomes(
            on_hub, {f"hub-{name.replace(' ', '-')}": ON_HUB[name] for name in args.on_hub}
        )
    )
    if walker:
        draw(session.place_of(PICTURES) / "gait_landscape.png", walker)
    for one in (*walker, *six):
        del one["trials"]
    for one in walker:
        one["of_trot"] = round(one["return"] / reference["return"], 3)
    session.write(
        {"steps": STEPS, "trot": reference, "walker": walker, "six_legs": six, "hub": programs}
    )
