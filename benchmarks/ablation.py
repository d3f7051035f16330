"""Ablation of the default settings: each set back, one at a time, to the paper's value.

    python -m benchmarks ablation

An agent trains in a simulation with the default preset, with the paper's, and with the default one
in which a single setting is the paper's, for `STEPS` robot steps in total. Means over the seeds of
``EVALUATED_EPISODES`` deterministic episodes, with 95 % bootstrap intervals over the seeds; all
variants use the same seeds. Earlier results of other agents stay in the result.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from benchmarks.learning import EVALUATED_EPISODES, run, summary
from benchmarks.session import Session
from bricksrl.agents import AGENTS
from bricksrl.training.config import settings_for

STEPS = {"WalkerSim-v0": 1000, "RoboArmSim-v0": 400, "Walker-v1": 1000}
FOR_GOALS = ("goals", "hindsight", "new_goals")
"""Settings without effect in a task without goals."""
FOR_IMAGES = ("encoder",)
"""Settings without effect in a task without images, as all of these are."""


PRODUCTS: dict[str, Any] = {"batch_size": 256, "actor_delay": 1, "mirror": False}
"""The settings that make SAC's updates cheaper, all set back at once."""


def variants(env: str, agent: str) -> dict[str, tuple[str, dict[str, Any]]]:
    """Preset and changes by variant: default, default with one value of the paper, or with
    `PRODUCTS`, paper."""
    default, paper = (asdict(settings_for(env, name, agent)) for name in ("default", "paper"))
    without_effect = FOR_IMAGES + FOR_GOALS * env.startswith("Walker")
    differ = [name for name in paper if paper[name] != default[name] and name not in without_effect]
    one = {name: ("default", {name: paper[name]}) for name in differ}
    together = {"products": ("default", PRODUCTS)} if agent == "sac" else {}
    return {"default": ("default", {}), **one, **together, "paper": ("paper", {})}


def main(session: Session) -> None:
    """Train all and write the results."""
    parser = session.parser
    parser.add_argument("--agent", default="sac", choices=AGENTS)
    parser.add_argument("--only", nargs="+", help="variants to train")
    parser.add_argument(
        "--steps", type=int, help="robot steps, in place of those of each environment"
    )
    args = session.parse(envs=list(STEPS), seeds=5)
    agent, known = args.agent, session.known().get("environments", {})
    cells: dict[str, tuple[Any, ...]] = {}
    settings: list[tuple[dict[str, Any], str, Any]] = []
    for env in args.envs:
        steps, found = args.steps or STEPS[env], dict[str, Any]()
        known.setdefault(env, {})[agent] = {"steps": steps, "variants": found}
        for name, (preset_name, changes) in variants(env, agent).items():
            if args.only is None or name in args.only:
                cells[f"{env}-{agent}-{name}-{steps}"] = (
                    env,
                    agent,
                    preset_name,
                    (steps,),
                    "steps",
                    changes,
                )
                settings.append(
                    (found, name, changes or asdict(settings_for(env, preset_name, agent)))
                )
    for (found, name, setting), runs in zip(
        settings, session.by_seed(run, cells, args.seeds).values(), strict=True
    ):
        (outcome,) = summary(runs)
        found[name] = {
            "setting": setting,
            "returns": [marks[-1]["return"] for marks in runs],
            **outcome,
        }
    session.write({"evaluated_episodes": EVALUATED_EPISODES, "environments": known})
