"""Sharing of policies on the Hugging Face hub: tensors as safetensors and config as JSON. No
pickles."""

import json
import tempfile
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from torchrl.envs import EnvBase

from brickhub.files import (
    atomic_folder,
    folder_with,
    parsing,
    reading,
    refuse_existing,
    write_durably,
)
from bricksrl.agents.learner import Learner
from bricksrl.data.share import CARD, downloaded, hub_client
from bricksrl.envs.make import make
from bricksrl.envs.transforms import prepare, transform_state
from bricksrl.errors import CheckpointError, RunError, counted
from bricksrl.training.config import TrainConfig, code_in, portable
from bricksrl.training.existing_run import POLICY
from bricksrl.training.learners import load_learner, make_learner_for, one_robot
from bricksrl.training.run_folder import RunFolder
from bricksrl.training.trust import is_trusted, remember, require_trusted
from bricktwin.worlds import WORLDS

TENSORS = "policy.safetensors"
ABOUT = POLICY
_VERSION = 1


def is_policy(path: Path) -> bool:
    """Whether a folder holds a shared policy rather than a run."""
    return (path / ABOUT).is_file() and (path / TENSORS).is_file()


def export_policy(
    run_dir: Path,
    out: Path,
    *,
    licence: str = "mit",
) -> Path:
    """Write the policy of a run to the folder ``out``, atomically: `TENSORS`, `ABOUT` and a card.
    Raises RunError if ``out`` exists or cannot be written, or there is no run, CheckpointError if
    the run's checkpoint is damaged."""
    from safetensors.torch import save

    refuse_existing(out, RunError)
    folder = RunFolder(run_dir)
    config = folder.read_config()
    if config.base is not None:
        raise RunError(
            "a shared policy comes without the run of its base; `bricksrl export RUN --out FILE` "
            "writes both to one file"
        )
    with closing(make(config.env, config.robot, seed=config.seed)) as env:
        prepare(env)
        made = transform_state(env)
        trained = load_learner(run_dir, env)
        kept = transform_state(env)
        # What a transform measured in the training is in the run's checkpoint, not in the policy.
        is_measured = kept.keys() != made.keys()
        is_measured = is_measured or any(str(kept[name]) != str(made[name]) for name in kept)
        if is_measured:
            raise RunError(
                "a shared policy has no statistics that a transform measured; train it with "
                "--normalize instead"
            )
    state = trained.learner.policy_state()
    # safetensors takes no views of other tensors.
    tensors = {name: tensor.contiguous() for name, tensor in state.items()}
    # Files that the training has read do not exist on other computers, and settings of training
    # alone say nothing on the policy.
    acting = replace(
        one_robot(config),
        data=None,
        updates=0,
        start=None,
        demonstrations=None,
        compile=False,
        scene=config.scene if config.scene in WORLDS else None,
    )
    shared = portable(acting.to_dict())
    about = {"bricksrl_policy": _VERSION, "episodes": trained.episodes, "config": shared}
    evaluation = folder.own_evaluation(trained.episodes)
    card = _card(
        shared["env"],
        shared["agent"],
        trained.episodes,
        evaluation,
        licence,
    )
    with atomic_folder(out) as new:
        write_durably(new / TENSORS, save(tensors))
        text = (json.dumps(about, indent=1, default=str) + "\n").encode()
        remember(text)
        write_durably(new / ABOUT, text)
        write_durably(new / CARD, card.encode())
    return out


def read_policy(path: Path) -> tuple[TrainConfig, dict[str, Any]]:
    """Read the policy in a folder, as `export_policy` wrote it: the config of its run, and its
    tensors by name. Nothing in it is executed. Raises CheckpointError or RunError if there is no
    policy, it is damaged, or its config names untrusted code."""
    text, config, tensors = _read_files(path)
    require_trusted(path / ABOUT, text, code_in(config))
    return _config_from(path, config), tensors


def _read_files(path: Path) -> tuple[bytes, dict[str, Any], dict[str, Any]]:
    """Content of `ABOUT`, the config in it, and the tensors. Raises CheckpointError if there is no
    policy, or it is damaged."""
    from safetensors.torch import load

    if not is_policy(path):
        raise CheckpointError(f"there is no policy in {path}; choose {folder_with(path, TENSORS)}")
    with reading(
        "the policy",
        path / ABOUT,
        CheckpointError,
        "fetch the policy again",
    ):
        text = (path / ABOUT).read_bytes()
        data = (path / TENSORS).read_bytes()
        about = json.loads(text)
        config = dict(about["config"])
        version = about["bricksrl_policy"]
    if version != _VERSION:
        raise CheckpointError(
            f"{path / ABOUT} describes no policy of this version of BricksRL; choose another"
        )
    reason = "is not a valid safetensors file; fetch the policy again"
    with parsing(CheckpointError(f"{path / TENSORS} {reason}")):
        return text, config, load(data)


def _config_from(path: Path, config: dict[str, Any]) -> TrainConfig:
    try:
        return TrainConfig.from_dict(config)
    except RunError as error:
        raise CheckpointError(f"{path / ABOUT} is damaged: {error}") from None


def load_shared(path: Path, env: EnvBase) -> Learner:
    """A learner with a shared policy, to act in ``env``; its other training state is not restored.
    Raises CheckpointError if there is no policy, it is damaged, or ``env`` has other observations
    or actions."""
    config, tensors = read_policy(path)
    learner = make_learner_for(config, env, device="cpu")
    shapes = {name: tensor.shape for name, tensor in learner.policy_state().items()}
    if shapes != {name: tensor.shape for name, tensor in tensors.items()}:
        raise CheckpointError(
            f"the policy in {path} observes or acts otherwise than this environment; use the one "
            "it is for"
        )
    learner.policy.load_state_dict(tensors)
    return learner


def push_policy(
    run_dir: Path,
    repo: str,
    *,
    private: bool = False,
    licence: str = "mit",
) -> str:
    """Upload the policy of a run, or a shared one, to the hub; returns its address. Raises RunError
    or CheckpointError as in `export_policy`, DataError if the hub is out of reach or refuses. A
    shared policy keeps the ``licence`` on its card."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = run_dir
        if not is_policy(run_dir):
            folder = export_policy(run_dir, Path(temporary) / "policy", licence=licence)
        with hub_client(repo) as api:
            api.create_repo(
                repo,
                repo_type="model",
                private=private,
                exist_ok=True,
            )
            api.upload_folder(
                repo_id=repo,
                repo_type="model",
                folder_path=str(folder),
                allow_patterns=[TENSORS, ABOUT, CARD],
            )
            return f"{api.endpoint}/{repo}"


def pull_policy(
    repo: str,
    out: Path,
    *,
    revision: str | None = None,
) -> Path:
    """Download a policy from the hub into the folder ``out``; it is checked before it is moved
    there.

    Raises:
        CheckpointError: the repository has no policy of BricksRL, or it is damaged.
        DataError: ``out`` exists, there is no such policy, or the hub is out of reach.
    """
    with downloaded(
        repo,
        "model",
        out,
        [TENSORS, ABOUT, CARD],
        revision,
    ) as folder:
        text, config, _ = _read_files(folder)
        # Fetching executes nothing; whether its code may run is asked when it is used.
        if not code_in(config) or is_trusted(text):
            _config_from(folder, config)
    return out


def _card(
    env: str,
    agent: str,
    episodes: int,
    evaluation: dict[str, Any] | None,
    licence: str,
) -> str:
    """Card of a policy, as Markdown, with the results of an evaluation if there is one."""
    result = "It has not been evaluated yet."
    if evaluation is not None:
        mean = evaluation["return_mean"]
        std = evaluation["return_std"]
        count = evaluation["episodes"]
        result = f"Return {mean:.4g} ± {std:.4g} in {counted(count, 'episode')} of evaluation."
    return f"""---
license: {licence}
library_name: bricksrl
pipeline_tag: reinforcement-learning
tags:
- BricksRL
- reinforcement-learning
- robotics
---

# {agent} for {env}

Trained with BricksRL on {json.dumps(env)} for {counted(episodes, "episode")}. {result}

`policy.safetensors` holds the tensors that the policy acts with, `policy.json` what they belong to.

```
bricksrl data pull <this repository> --policy --out policy
bricksrl record {env} --policy policy --out dataset
```
"""
