"""Other worlds: gaits found on the nominal twin, in worlds outside of all drawn ones, and after a minute of search there.

    python -m benchmarks worlds

Each seed searches for 300 robot steps on the nominal twin, and goes on from there for 60 s of robot time in each world, as
`bricksrl train Walker-v1 --agent gait --from RUN` does. What can be had in a world is the best of 400 trials there: three
quarters spread over all numbers, the others where the Gaussian process of the first ones has its highest hopes. All gaits are
evaluated in the same five episodes.

And which time of a step suits which Bluetooth link: the speed of gaits that were searched for 75 s of robot time.
"""

from __future__ import annotations

import tempfile
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from tensordict.nn import TensorDictModule

import bricksrl
from benchmarks.gait import SEED, STEPS, WALKER
from benchmarks.session import Session
from benchmarks.study_tables import OUTSIDE
from bricksrl.agents import make_learner, preset
from bricksrl.agents.search.gait import Posterior, embedded
from bricksrl.envs.rollout import play, play_episodes, seed_episode
from bricksrl.evaluation import evaluate
from bricksrl.training import TrainConfig, train

EPISODES, LATER = 5, 2
"""Episodes of an evaluation; of 100 steps, in a world after the nominal twin."""
SPREAD, HOPES, HOPE = 300, 100, 1.0
"""Trials in a world that are spread over all numbers, and those where the process hopes; standard deviations of hope."""
LINKS, STEPS_MS = ("mac", "linux", "bad-room"), (250, 150, 100, 60)
SEARCH_MS, TRIAL_MS, SETTLE_MS = 75_000, 2_500, 1_000
"""Time of a search, of a trial, and of its first part, which does not count."""


def adapted(seed: int) -> dict[str, tuple[float, float]]:
    """Return in each world of the gait of the nominal twin, and of the one after a minute there."""
    found = {}
    with tempfile.TemporaryDirectory() as parent:
        nominal = Path(parent) / "nominal"
        train(TrainConfig(WALKER, "gait", STEPS // 100, seed, record=False, run_dir=nominal))
        for number, (world, physics) in enumerate(OUTSIDE.items()):
            run = Path(parent) / str(number)
            train(TrainConfig(WALKER, "gait", LATER, seed, physics=physics, start=str(nominal), record=False, run_dir=run))
            before, after = (evaluate(path, episodes=EPISODES, seed=SEED, save=False, physics=physics) for path in (nominal, run))
            found[world] = before.return_mean, after.return_mean
    return found


def best_of_many(world: str) -> float:
    """Return of the best of 400 trials in a world."""
    settings = replace(preset("default", "gait"), random_trials=SPREAD)
    with closing(bricksrl.make(WALKER, seed=0, physics=OUTSIDE[world])) as env:
        search: Any = make_learner("gait", env, settings)
        entries, plan, episode = search.actor.structure.numbers, list(search.start), 0
        while len(search.scores) < SPREAD + HOPES:
            episode += 1
            seed_episode(env, episode)
            for frame in play(env, search.explore):
                tried = len(search.scores)
                search.remember(frame[None])
                if len(search.scores) == tried:
                    continue
                if len(search.scores) == SPREAD:
                    posterior = Posterior(embedded(search.numbers, entries), search.scores, search.worlds)
                    candidates = search._candidates(entries, search.numbers[search.scores.argmax()])
                    means, deviations = posterior.at(embedded(candidates, entries))
                    plan += list(candidates[(means + HOPE * deviations).argsort(descending=True)[:HOPES]])
                if len(search.scores) == SPREAD + HOPES:
                    break
                search.actor.trial.copy_(plan[len(search.scores)])
            search.end_episodes()
        points = embedded(search.numbers, entries)
        means, _ = Posterior(points, search.scores, search.worlds).at(points)
        search.actor.best.copy_(search.numbers[means.argmax()])
        policy = TensorDictModule(search.actor, ["observation"], ["action"])
        return fmean(score.return_ for score in play_episodes(env, policy, EPISODES, SEED))


def stepped(link: str, step_ms: int) -> dict[str, Any]:
    """A gait that was searched with steps of that time, over that link."""
    trial, settle = TRIAL_MS // step_ms, SETTLE_MS // step_ms
    settings = replace(preset("default", "gait"), trial_steps=trial, settle_steps=settle)
    options: dict[str, Any] = {"options": {"step_ms": step_ms}, "link": link}
    with tempfile.TemporaryDirectory() as parent:
        run = Path(parent) / "run"
        train(TrainConfig(WALKER, "gait", SEARCH_MS // 25_000, settings=settings, record=False, run_dir=run, **options))
        found = evaluate(run, episodes=2, seed=SEED, save=False)
    return {"link": link, "step_ms": step_ms, "return": found.return_mean, "speed_m_s": found.metrics["forward_speed_m_s"]}


def main(session: Session) -> None:
    """Measure, and write."""
    session.parser.add_argument("--seeds", type=int, default=5)
    session.parser.add_argument("--worlds", nargs="+", default=list(OUTSIDE), choices=list(OUTSIDE), metavar="WORLD")
    session.parser.add_argument("--steps-ms", type=int, nargs="*", default=list(STEPS_MS))
    args = session.parse()
    bests = list(session.outcomes(best_of_many, {f"best-{world.replace(' ', '-')}": (world,) for world in args.worlds}))
    seeds = list(session.outcomes(adapted, {f"seed-{seed}": (seed,) for seed in range(args.seeds)}))
    rows = {}
    for world, best in zip(args.worlds, bests, strict=True):
        before, after = ([one[world][place] for one in seeds] for place in (0, 1))
        gains = [late - early for early, late in zip(before, after, strict=True)]
        error = stdev(gains) / len(gains) ** 0.5 if len(gains) > 1 else 0.0
        rows[world] = {"best": best, "before": before, "after": after, "gain": fmean(gains), "standard_error": error}
    lost = sum(row["best"] - fmean(row["before"]) for row in rows.values())
    gained = sum(row["gain"] for row in rows.values())
    links = {f"step-{link}-{step_ms}": (link, step_ms) for link in LINKS for step_ms in args.steps_ms}
    session.write(
        {"env": WALKER, "worlds": rows, "lost": lost, "regained": gained, "steps": list(session.outcomes(stepped, links))}
    )
