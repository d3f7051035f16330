"""Checker of algorithms, built-in or the user's, in a small simulation."""

import dataclasses
import inspect
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from brickhub.finding import Finding
from brickhub.user_files import load_object
from bricksrl.agents import AGENTS, Algorithm, algorithm, is_reference, make_learner, preset
from bricksrl.agents.gradient_descent import GradientLearner
from bricksrl.agents.learner import Learner
from bricksrl.agents.offline.imitation import ImitationLearner
from bricksrl.agents.on_policy import OnPolicyLearner
from bricksrl.agents.replay.replay_learner import ReplayLearner
from bricksrl.envs import make
from bricksrl.envs.env_checker import Broken, Skip, run_checks
from bricksrl.errors import BricksError, counted
from bricksrl.evaluation.settings_text import with_changes
from bricksrl.training.config import settings_from
from bricksrl.training.reproducible import reproducible

ENV = "RoboArmSim-v0"
"""A small environment with goals."""
_SEED = 7
_STEPS = 40
_COPIES = 3
_CHECKS = ("settings", "build", "acting", "memory", "learning", "saving", "copies")


def is_agent(name: str) -> bool:
    """Whether this names an algorithm rather than an environment: a built-in one, or a ``build``
    function in the user's code."""
    if not is_reference(name):
        return name in AGENTS
    try:
        build = load_object(name, "build")
    except BricksError:
        return False
    if not callable(build):
        return False
    # Any module may have a function `build`, but only that of an algorithm takes settings.
    return name.endswith(".py") or "settings" in inspect.signature(build).parameters


def check_agent(agent: str) -> Iterator[Finding]:
    """Check an algorithm. Raises UnknownNameError or DescriptionError if there is no such
    algorithm."""
    checked = _Checked(algorithm(agent))
    with reproducible(_SEED):
        yield from run_checks({name: getattr(checked, name) for name in _CHECKS})


@dataclass
class _Checked:
    """Checks of one algorithm, and the learner that the ``build`` check makes of it for the later
    ones."""

    algorithm: Algorithm
    learner: Learner | None = None

    def settings(self) -> str:
        settings_type = self.algorithm.settings
        if not settings_type.__dataclass_params__.frozen:
            raise Broken(f"{settings_type.__name__} can be changed; write @dataclass(frozen=True)")
        none = dataclasses.MISSING
        missing = []
        for field in dataclasses.fields(settings_type):
            if field.default is none and field.default_factory is none:
                missing.append(field.name)
        if missing:
            raise Broken(f"{', '.join(missing)} has no default; give it one")
        settings = preset("default", self.algorithm.name)
        values = dataclasses.asdict(settings)
        # Settings are compared as config.json keeps them: one that does not survive it would be
        # another one after a resume.
        written = json.loads(json.dumps(values))
        read = settings_from(self.algorithm.name, written)
        if dataclasses.asdict(read) != values:
            raise Broken(
                "settings that are written down and read again are others; use numbers, texts "
                "and tuples"
            )
        texts = []
        for name, value in values.items():
            text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
            texts.append(f"{name}={text}")
        if with_changes(settings, texts) != settings:
            raise Broken(
                "settings that are given as --set NAME=VALUE are others; use numbers, texts "
                "and tuples"
            )
        return f"{counted(len(values), 'setting')}, which can be written down and read"

    def build(self) -> str:
        self.learner = make_learner(self.algorithm.name, make(ENV, seed=_SEED))
        if not isinstance(self.learner, GradientLearner):
            return "no loss, 0 numbers to learn"
        learned = sum(parameter.numel() for parameter in self.learner.descent.parameters())
        if not learned:
            raise Broken(
                "there is a loss and nothing that an optimiser moves; give the optimizer the "
                "loss's parameters"
            )
        return f"{type(self.learner.loss).__name__}, {learned} numbers to learn"

    def acting(self) -> str:
        learner = self._learner()
        env = make(ENV, seed=_SEED)
        for act in (learner.explore, learner.exploit):
            learner.reset_policy()
            action = act(env.reset().select(*learner.policy.in_keys))["action"]
            if action.shape != env.action_spec.shape:
                raise Broken(
                    f"an action has the shape {list(action.shape)}; give "
                    f"{list(env.action_spec.shape)}"
                )
            if not bool((action.abs() <= 1.0 + 1e-6).all()):
                raise Broken(f"an action is {action.tolist()}; give numbers in -1..1")
        return f"actions of {counted(action.numel(), 'number')} in -1..1, exploring and not"

    def memory(self) -> str:
        learner = self._learner()
        if isinstance(learner, ImitationLearner):
            learner.use_dataset(_frames(learner, make(ENV, seed=_SEED)))
            return f"{counted(len(learner.dataset or ()), 'transition')} of a dataset"
        if not isinstance(learner, ReplayLearner | OnPolicyLearner):
            raise Skip("it remembers nothing")
        learner.remember(_frames(learner, make(ENV, seed=_SEED)))
        if not len(learner.memory):
            raise Broken("the memory is empty after transitions were remembered")
        return f"{counted(len(learner.memory), 'row')} of {_STEPS} steps or more"

    def learning(self) -> str:
        learner = self._learner()
        if not isinstance(learner, GradientLearner):
            raise Skip("it learns nothing")
        # Work before the first update, such as choosing first values, is no learning.
        learner.make_updates(0)
        parameters = learner.descent.parameters()
        before = [parameter.detach().clone() for parameter in parameters]
        steps = _STEPS
        if not learner.on_policy:
            # There are as many steps as four updates need, because some algorithms make less than
            # one update a step.
            steps = min(1000, max(2, round(4 / max(learner.updates_per_step, 1e-9))))
        losses = learner.learn(steps)
        if not losses:
            raise Broken("nothing was learned; fill the memory, and give updates_per_step")
        wrong = [name for name, value in losses.items() if not bool(torch.isfinite(value))]
        if wrong:
            raise Broken(
                f"{', '.join(wrong)} is not a number after {counted(learner.updates, 'update')}"
            )
        pairs = zip(before, parameters, strict=True)
        if all(torch.equal(old, new) for old, new in pairs):
            raise Broken(
                f"{counted(learner.updates, 'update')} changed nothing; let the optimizer have "
                "the loss's parameters"
            )
        texts = [f"{name} {float(value):.3g}" for name, value in losses.items()]
        return f"{counted(learner.updates, 'update')}: {', '.join(texts)}"

    def saving(self) -> str:
        learner = self._learner()
        env = make(ENV, seed=_SEED)
        file = io.BytesIO()
        torch.save(learner.state_dict(), file)
        file.seek(0)
        restored = make_learner(self.algorithm.name, env)
        restored.load_state_dict(torch.load(file, weights_only=True))
        state = env.reset()
        actions = []
        # Both get the same seed, because an agent may draw even at its best.
        for actor in (learner, restored):
            actor.reset_policy()
            torch.manual_seed(_SEED)
            actions.append(actor.exploit(state)["action"])
        if not torch.equal(*actions):
            raise Broken(
                "a learner that is saved and restored acts otherwise; register what the policy "
                "depends on"
            )
        return f"{len(file.getvalue())} bytes, and the same actions from them"

    def copies(self) -> str:
        env = make(ENV, batch_size=_COPIES, seed=_SEED)
        learner = make_learner(self.algorithm.name, env)
        if learner.needs_dataset or not learner.updates_per_step:
            raise Skip("it does not learn from a robot")
        learner.remember(_frames(learner, env))
        losses = learner.learn(_STEPS)
        if not losses or not all(bool(torch.isfinite(value)) for value in losses.values()):
            raise Broken(f"what it learns from {_COPIES} copies is {losses or 'nothing'}")
        return f"{counted(learner.updates, 'update')} from {_COPIES} copies side by side"

    def _learner(self) -> Learner:
        if self.learner is None:
            raise Skip("there is no learner")
        return self.learner


def _frames(learner: Learner, env: EnvBase) -> TensorDictBase:
    """Consecutive episodes of the exploring policy."""
    steps = max(_STEPS, learner.frames_per_batch)
    with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
        frames: TensorDictBase = env.rollout(steps, learner.policy, break_when_any_done=False)
    return frames
