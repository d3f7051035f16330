"""Other worlds: what was learned on the twin, in worlds outside of all drawn ones and in drawn
ones, and after a minute there.

    python -m benchmarks worlds
    python -m benchmarks worlds --ways sac conditioned --steps-ms

Each seed of a way learns once, and goes on from there for 60 s of robot time in each world, as
`bricksrl train --from RUN` does:

==============  ========================================  =====================================================================
way             learns before                             in a world
==============  ========================================  =====================================================================
gait            300 robot steps on the nominal twin       searches on
sac             40 episodes in drawn worlds               learns on
retained        as sac                                    learns on, and draws half of each batch from what it saw before
steered         as sac                                    searches three numbers that steer it, see `benchmarks.steered`, after
                                                          300 robot steps of that on the nominal twin
conditioned     40 episodes in drawn worlds, told their   searches the numbers of the physics that the policy is told, after
                physics, see `benchmarks.conditioned`     300 robot steps of that on the nominal twin
fitted          as gait                                   fits a twin to its motion there, and searches on in that twin
==============  ========================================  =====================================================================

What can be had in a world is the best of 400 trials of gaits there: three quarters spread over all
numbers, the others where the Gaussian process of the first ones has its highest hopes. All are
evaluated in the same five episodes. Earlier results of other ways and worlds stay.

And which time of a step suits which Bluetooth link: the speed of gaits that were searched for 75 s
of robot time.
"""  # noqa: E501

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

import numpy as np
import torch
from tensordict.nn import TensorDictModule

import bricksrl
from benchmarks.conditioned import conditioned
from benchmarks.gait import SEED, STEPS, WALKER
from benchmarks.session import Session
from benchmarks.steered import steered
from benchmarks.study_tables import OUTSIDE, drawn_twins
from brickhub.hub.link.lockstep import HubLink
from brickhub.target import whole_interface
from brickhub.virtual.virtual_transport import VirtualHub
from bricksrl.agents import make_learner, preset
from bricksrl.envs.registry import get_task
from bricksrl.envs.rollout import play, play_episodes, seed_episode
from bricksrl.evaluation import evaluate
from bricksrl.training import RunFolder, TrainConfig, train
from bricktwin.twin.make_body import make_body
from bricktwin.twin.motion_log import identification_commands, record
from bricktwin.twin.physics import Physics
from bricktwin.twin.system_id import fit

EPISODES, LATER = 5, 2
"""Episodes of an evaluation; of 100 steps, in a world after the nominal twin."""
SAC_EPISODES, COMMANDS = 40, 160
"""Episodes of SAC in drawn worlds; commands of the motion to which a twin is fitted, in 22 s of the
robot's time."""
DRAWN = {f"drawn {number}": physics for number, physics in enumerate(drawn_twins(3), 1)}
WORLDS = OUTSIDE | DRAWN
SPREAD, HOPES, HOPE = 300, 100, 1.0
"""Trials in a world that are spread over all numbers, and those where the process hopes; standard
deviations of hope."""
LINKS, STEPS_MS = ("mac", "linux", "bad-room"), (250, 150, 100, 60)
SEARCH_MS, TRIAL_MS, SETTLE_MS = 75_000, 2_500, 1_000
"""Time of a search, of a trial, and of its first part, which does not count."""


def gait(seed: int, *_: Any) -> TrainConfig:
    """A gait of the nominal twin."""
    return TrainConfig(WALKER, "gait", STEPS // 100, seed, record=False)


def sac(seed: int, episodes: int, _: Path) -> TrainConfig:
    """SAC in drawn worlds."""
    return TrainConfig(WALKER, "sac", episodes, seed, randomize=True, record=False)


def recorded_sac(seed: int, episodes: int, folder: Path) -> TrainConfig:
    """SAC in drawn worlds, with the transitions kept."""
    return replace(sac(seed, episodes, folder), record=True)


WAYS: dict[str, Callable[[int, int, Path], TrainConfig]] = {
    "gait": gait,
    "sac": sac,
    "retained": recorded_sac,
    "steered": steered,
    "conditioned": conditioned,
    "fitted": gait,
}
"""What a way learns before: the run of a seed, with so many episodes of SAC; the folder is for what
comes before it."""


def prepared(way: str, runs: str, episodes: int, seed: int) -> str:
    """The run of a seed from which a way goes on, in a folder of ``runs``."""
    folder = Path(runs) / f"{way}-{seed}"
    shutil.rmtree(folder, ignore_errors=True)  # of an interrupted run
    folder.mkdir(parents=True)
    train(replace(WAYS[way](seed, episodes, folder), run_dir=folder / "run"))
    return str(folder / "run")


def adapted(
    way: str, runs: str, world: str, twin: dict[str, float] | None, seed: int
) -> tuple[float, float]:
    """Return in a world of a seed's run, and of the same after a minute there, or after as many
    steps in a twin of it."""
    start, physics = Path(runs) / f"{way}-{seed}" / "run", WORLDS[world]
    place = physics if twin is None else Physics(**twin)
    config = replace(
        RunFolder(start).read_config(),
        episodes=LATER,
        randomize=False,
        physics=place,
        start=str(start),
        demonstrations=str(start) if way == "retained" else None,
        record=False,
    )
    with tempfile.TemporaryDirectory() as parent:
        run = Path(parent) / "run"
        train(replace(config, run_dir=run))
        before, after = (
            evaluate(path, episodes=EPISODES, seed=SEED, save=False, physics=physics)
            for path in (start, run)
        )
    return before.return_mean, after.return_mean


def fitted_twin(world: str) -> dict[str, float]:
    """Physics of a twin that is fitted to the motion of a robot in a world, as `bricktwin twin
    record` and `twin fit` do it."""
    robot = get_task(WALKER).robot
    interface = whole_interface(robot)
    commands = identification_commands(interface, COMMANDS, np.random.default_rng(SEED))
    with HubLink(
        VirtualHub(make_body(robot, physics=WORLDS[world], seed=SEED)), robot, interface
    ) as link:
        log = record(link, robot, interface, commands)
    return asdict(fit(log, robot=robot).physics)


def gains(seeds: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """The returns before and after of each seed, the mean gain and its standard error."""
    differences = [after - before for before, after in seeds]
    error = stdev(differences) / len(differences) ** 0.5 if len(differences) > 1 else 0.0
    before, after = ([pair[place] for pair in seeds] for place in (0, 1))
    return {"before": before, "after": after, "gain": fmean(differences), "standard_error": error}


def best_of_many(world: str) -> float:
    """Return of the best of 400 trials in a world."""
    settings = replace(preset("default", "gait"), random_trials=SPREAD, optimism=HOPE)
    with closing(bricksrl.make(WALKER, seed=0, physics=WORLDS[world])) as env:
        learner: Any = make_learner("gait", env, settings)
        trials, episode = learner.search.trials, 0
        while len(trials) < SPREAD + HOPES:
            episode += 1
            seed_episode(env, episode)
            for frame in play(env, learner.explore):
                learner.remember(frame[None])
                learner.learn()
                if len(trials) == SPREAD + HOPES:
                    break
            learner.end_episodes()
        best = max((trial.numbers for trial in trials), key=learner.search.process.mean_at)
        learner.actor.best.copy_(torch.tensor(best))
        policy = TensorDictModule(learner.actor, ["observation"], ["action"])
        return fmean(score.return_ for score in play_episodes(env, policy, EPISODES, SEED))


def stepped(link: str, step_ms: int) -> dict[str, Any]:
    """A gait that was searched with steps of that time, over that link."""
    trial, settle = TRIAL_MS // step_ms, SETTLE_MS // step_ms
    settings = replace(preset("default", "gait"), trial_steps=trial, settle_steps=settle)
    options: dict[str, Any] = {"options": {"step_ms": step_ms}, "link": link}
    with tempfile.TemporaryDirectory() as parent:
        run = Path(parent) / "run"
        train(
            TrainConfig(
                WALKER,
                "gait",
                SEARCH_MS // 25_000,
                settings=settings,
                record=False,
                run_dir=run,
                **options,
            )
        )
        found = evaluate(run, episodes=2, seed=SEED, save=False)
    return {
        "link": link,
        "step_ms": step_ms,
        "return": found.return_mean,
        "speed_m_s": found.metrics["forward_speed_m_s"],
    }


def main(session: Session) -> None:
    """Measure, and write."""
    session.parser.add_argument("--seeds", type=int, default=5)
    session.parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=list(WAYS))
    session.parser.add_argument(
        "--episodes", type=int, default=SAC_EPISODES, help="of SAC in drawn worlds"
    )
    session.parser.add_argument(
        "--worlds", nargs="+", default=list(WORLDS), choices=list(WORLDS), metavar="WORLD"
    )
    session.parser.add_argument("--steps-ms", type=int, nargs="*", default=list(STEPS_MS))
    args = session.parse()
    known = session.known()
    rows: dict[str, Any] = {**known.get("worlds", {}), **known.get("drawn", {})}
    unknown = [world for world in args.worlds if "gait" in args.ways or world not in rows]
    bests = session.outcomes(best_of_many, {f"best-{_name(world)}": (world,) for world in unknown})
    for world, best in zip(unknown, bests, strict=True):
        rows[world] = {**rows.get(world, {}), "best": best}
    runs = str(session.folder / "runs")
    for way in args.ways:
        session.by_seed(prepared, {way: (way, runs, args.episodes)}, args.seeds)
        fits = {f"fit-{_name(world)}": (world,) for world in args.worlds if way == "fitted"}
        twins = list(session.outcomes(fitted_twin, fits)) or [None] * len(args.worlds)
        cells = {
            f"{way}-{_name(one)}": (way, runs, one, twin)
            for one, twin in zip(args.worlds, twins, strict=True)
        }
        for world, seeds in zip(
            args.worlds, session.by_seed(adapted, cells, args.seeds).values(), strict=True
        ):
            rows[world] |= gains(seeds) if way == "gait" else {way: gains(seeds)}
    links = {
        f"step-{link}-{step_ms}": (link, step_ms) for link in LINKS for step_ms in args.steps_ms
    }
    outside = {world: row for world, row in rows.items() if world in OUTSIDE}
    steps = list(session.outcomes(stepped, links)) or known.get("steps", [])
    drawn = {world: row for world, row in rows.items() if world in DRAWN}
    ways = {
        way: totals(outside.values(), way)
        for way in WAYS
        if all(_of(row, way) for row in outside.values())
    }
    session.write(
        {
            "env": WALKER,
            "worlds": outside,
            **ways.get("gait", {}),
            "ways": ways,
            "drawn": drawn,
            "steps": steps,
        }
    )


def totals(rows: Iterable[dict[str, Any]], way: str) -> dict[str, float]:
    """What a way loses in worlds, beside the best of them, and what it regains."""
    parts = [(row["best"], _of(row, way)) for row in rows]
    lost = sum(best - fmean(part["before"]) for best, part in parts)
    return {"lost": lost, "regained": sum(part["gain"] for _, part in parts)}


def _of(row: dict[str, Any], way: str) -> dict[str, Any]:
    """The results of a way in a world, empty if there are none; those of the gait are in the row
    itself."""
    part: dict[str, Any] = row.get(way, {}) if way != "gait" else row if "gain" in row else {}
    return part


def _name(world: str) -> str:
    return world.replace(" ", "-")
