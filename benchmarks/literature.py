"""What the literature offers, next to the default SAC, at equal robot steps.

    python benchmarks/literature.py [--seeds 10]

Each variant is SAC with one change, or another algorithm of TorchRL with its default settings, and trains as in `learning.py`,
with the same seeds. Networks are those of `networks.py`. Runs in the result are not repeated: an interrupted script resumes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from learning import EVALUATED_EPISODES, Job, run_all, summary
from machine import RESULTS, command, write

MARKS = {"WalkerSim-v0": (500, 1000), "RoboArmSim-v0": (175, 400)}
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "SAC with its default settings": ("sac", {}),
    "without layer normalisation": ("sac", {"critic_layer_norm": False}),
    "layer normalisation in the critics' first layer only": ("sac", {"network": "first_normalized"}),
    "layer normalisation in the critics' last layer only": ("sac", {"network": "last_normalized"}),
    "weight and layer normalisation": ("sac", {"network": "weight_normalized"}),
    "SimBa networks": ("sac", {"network": "simba"}),
    "n-step returns, n = 3": ("sac", {"n_step": 3}),
    "twice the learning rate": ("sac", {"learning_rate": 2e-3}),
    "TQC": ("tqc", {}),
}
NETWORKS = Path(__file__).with_name("networks.py")


def job(env: str, variant: str, seed: int) -> Job:
    """The training of a variant."""
    agent, changes = VARIANTS[variant]
    changes = {name: f"{NETWORKS}:{value}" if name == "network" else value for name, value in changes.items()}
    return Job(env, agent, "default", seed, MARKS[env], tuple(changes.items()))


def main() -> None:
    """Train all and write the results."""
    parser = command(__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    args = parser.parse_args()
    path = RESULTS / "literature.json"
    known: dict[str, Any] = json.loads(path.read_text())["environments"] if path.exists() else {}
    results: dict[str, Any] = {env: {name: {"seeds": []} for name in VARIANTS} | known.get(env, {}) for env in MARKS}
    wanted = [(env, name, seed) for env in MARKS for seed in range(args.seeds) for name in VARIANTS]
    todo = [(env, name, seed) for env, name, seed in wanted if seed >= len(results[env][name]["seeds"])]
    for (env, name, seed), result in zip(todo, run_all([job(*one) for one in todo]), strict=True):
        runs = results[env][name]["seeds"]
        runs.append(result)
        results[env][name]["summary"] = summary(runs)
        print(env, name, seed, [(mark["steps"], mark["return"], mark["success_rate"]) for mark in result], flush=True)
        write("literature", {"setup": {"evaluated_episodes": EVALUATED_EPISODES}, "environments": results})


if __name__ == "__main__":
    main()
