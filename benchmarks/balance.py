"""Balance on two wheels: what the drawn balancer learns in thirty tries, and how long it stands.

    python -m benchmarks balance

Each seed searches by the agent `gait`, on the hub. The program with the numbers that it keeps plays
episodes of 20 s on the virtual hub by itself: how long it stands, and how far it has rolled then.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from brickhub.seed import episode_seed
from bricksrl.envs.abilities.of_plans import ABILITIES
from bricksrl.envs.registry import get_task
from bricksrl.policies.hub_export import export_program, play_as_env
from bricksrl.training import TrainConfig, train

PLAN = Path(__file__).parent.parent / "examples" / "drawings" / "balancer.ldr"
EPISODES = 20
EPISODE_S = 20
SEED = 4711


def search(seed: int) -> dict[str, Any]:
    """What one seed finds: seconds that the robot stands in each episode."""
    env_id = f"{PLAN}:upright"
    with tempfile.TemporaryDirectory() as parent:
        config = TrainConfig(
            env_id,
            "gait",
            episodes=ABILITIES["upright"].episodes,
            seed=seed,
            record=False,
            run_dir=Path(parent) / "run",
        )
        trained = train(config).episodes
        program = Path(parent) / "alone.py"
        exported = export_program(config.run_dir or Path(parent), program)
        source = program.read_text(encoding="utf-8")
    task = get_task(env_id)
    step_s = task.interface.settle.longest_ms / 1000
    longer = replace(task, max_steps=round(EPISODE_S / step_s))
    stood_s: list[float] = []
    rolled_deg: list[float] = []
    for number in range(EPISODES):
        alone = play_as_env(source, longer, None, episode_seed("evaluation", SEED, number))
        stood_s.append(round(alone.length * step_s, 2))
        if alone.seen is not None:
            observation, _ = alone.seen
            rolled_deg.append(round(float(observation[2])))
    return {
        "seed": seed,
        "steps": trained[-1].steps,
        "over_link": exported.policy_return,
        "alone": exported.hub_return,
        "stood_s": stood_s,
        "rolled_deg": rolled_deg,
    }


def main(session: Session) -> None:
    """Measure, and write."""
    args = session.parse(seeds=5)
    parts = {f"seed-{seed}": (seed,) for seed in range(args.seeds)}
    seeds = list(session.outcomes(search, parts))
    whole = sum(time_s >= EPISODE_S for one in seeds for time_s in one["stood_s"])
    session.write({"episode_s": EPISODE_S, "stood_whole": whole, "seeds": seeds})
