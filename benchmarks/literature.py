"""What the literature offers, next to the default SAC, at equal robot steps.

    python -m benchmarks literature [--seeds 10]

Each variant is SAC with one change, or another algorithm of TorchRL with its default settings, and
trains as in `learning.py`, with the same seeds. Networks are those of `networks.py`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.learning import EVALUATED_EPISODES, run, summary
from benchmarks.session import Session

MARKS = {"WalkerSim-v0": (500, 1000), "RoboArmSim-v0": (175, 400)}
NETWORKS = Path(__file__).with_name("networks.py")
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "SAC with its default settings": ("sac", {}),
    "without layer normalisation": ("sac", {"critic_norm": "none"}),
    "layer normalisation in the critics' first layer only": (
        "sac",
        {"network": f"{NETWORKS}:first_normalized"},
    ),
    "layer normalisation in the critics' last layer only": (
        "sac",
        {"network": f"{NETWORKS}:last_normalized"},
    ),
    "weight and layer normalisation": ("sac", {"network": f"{NETWORKS}:weight_normalized"}),
    "SimBa networks": ("sac", {"network": f"{NETWORKS}:simba"}),
    "n-step returns, n = 3": ("sac", {"n_step": 3}),
    "twice the learning rate": ("sac", {"learning_rate": 2e-3}),
    "TQC": ("tqc", {}),
}


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=list(VARIANTS))
    parser.add_argument(
        "--steps", type=int, help="robot steps, in place of those of each environment"
    )
    args = session.parse()
    marks = {env: (args.steps,) if args.steps else ends for env, ends in MARKS.items()}
    names = [(env, name) for env in MARKS for name in args.variants]
    cells: dict[str, tuple[Any, ...]] = {}
    for env, name in names:
        agent, changes = VARIANTS[name]
        cells[f"{env}-{name}-{marks[env][-1]}"] = (
            env,
            agent,
            "default",
            marks[env],
            "steps",
            changes,
        )
    results: dict[str, Any] = {env: {} for env in MARKS}
    for (env, name), runs in zip(
        names, session.by_seed(run, cells, args.seeds).values(), strict=True
    ):
        results[env][name] = {"seeds": runs, "summary": summary(runs)}
    session.write({"setup": {"evaluated_episodes": EVALUATED_EPISODES}, "environments": results})
