"""Hyperparameter tuning with Optuna: each proposed set is trained with a few seeds for a number of
steps, and evaluated.

The study is an SQLite file in a folder, so that it can be resumed, and several commands may work on
it at a time.
"""

from __future__ import annotations

import dataclasses
import json
import logging
import math
import tempfile
import threading
import typing
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, replace
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional

from brickhub.fields import Count, check_fields
from brickhub.files import serialized, write_durably
from brickhub.options import Existing, option
from brickhub.seed import LARGEST_SEED, check_seed
from brickhub.user_files import check_there
from bricksrl.agents import make_learner
from bricksrl.agents.settings import Range
from bricksrl.envs import make
from bricksrl.envs.registry import get_task
from bricksrl.errors import DivergedError, RunError, installed, message_of
from bricksrl.evaluation.multi_seed import connected, map_on_cluster, parse_on
from bricksrl.training.callbacks import Callback, Episode, Progress
from bricksrl.training.config import TrainConfig, settings_for
from bricksrl.training.trust import remember

if TYPE_CHECKING:
    import optuna

STUDY = "study.db"
BEST = "best.json"

_Space = dict[str, tuple[float, float, bool] | list[Any]]
"""Settings to tune: least and greatest value, and whether the scale is logarithmic; or choices."""

_SPACE: _Space = {
    "learning_rate": (1e-4, 3e-3, True),
    "gamma": (0.9, 0.995, False),
    "tau": (2e-3, 5e-2, True),
    "alpha_init": (0.02, 1.0, True),
    "target_entropy": (-2.0, 0.0, False),
    "min_scale": (0.01, 0.3, True),
    "momentum": (3e-3, 0.1, True),
    "dropout": (0.0, 0.1, False),
    "exploration_noise": (0.05, 0.5, False),
    "target_noise": (0.05, 0.4, False),
    "hindsight": (0.0, 0.5, False),
    "new_goals": (0.0, 0.5, False),
    "hidden": ["64,64", "128,128", "256,256"],
    "batch_size": [64, 128, 256, 512],
    "updates_per_step": [1.0, 2.0, 4.0, 8.0, 20.0],
    "actor_delay": [1, 2, 3],
    "prefill_episodes": [1, 2, 3],
    "adam_beta": [0.5, 0.9],
    "critic_norm": ["layer", "none"],
    "n_step": [1, 3],
}
"""A user's other floats are tuned around their default."""
_ONLY_WITH_GOALS = ("hindsight", "new_goals")


@dataclass(frozen=True)
class Tuning:
    """Definition of a tuning study."""

    env: Annotated[Positional[str], option(metavar="ENV"), Existing(check_there)]
    """Environment; `bricksrl list` shows them. Kinematic simulations are the fastest."""
    agent: Annotated[str, option(metavar="NAME"), Existing(check_there)] = "sac"
    """Agent; `bricksrl list` shows them."""
    steps: Annotated[Count, option(metavar="N")] = 2000
    """Robot steps of each training, which ends with the episode that reaches them."""
    seeds: Annotated[Count, option(metavar="N")] = 2
    """Trainings per trial, the mean of whose evaluations is its value; bad trials are pruned
    early."""
    episodes: Annotated[Count, option(metavar="N")] = 10
    """Episodes of each evaluation."""

    def __post_init__(self) -> None:
        check_fields(Tuning, vars(self))


@dataclass(frozen=True)
class Best:
    """Best settings so far, the mean return of their evaluations, and the number of finished
    trials."""

    settings: Any
    value: float
    trials: int


OnTrial = Callable[[int, float | None, float | None], None]
"""A function that is called with a trial's number, its value (``None`` if it was pruned), and the
best value so far."""


def propose(
    trial: optuna.trial.BaseTrial,
    start: Any,
    *,
    goals: bool,
) -> Any:
    """Settings ``start`` with the values that the trial proposes."""
    values: dict[str, Any] = {}
    for name, limits in _space(start, goals=goals).items():
        if isinstance(limits, list):
            values[name] = trial.suggest_categorical(name, limits)
        else:
            low, high, log = limits
            values[name] = trial.suggest_float(
                name,
                low,
                high,
                log=log,
            )
    if "hidden" in values:
        values["hidden"] = tuple(int(part) for part in values["hidden"].split(","))
    proposed: Any = replace(start, **values)
    return proposed


def _space(start: Any, *, goals: bool) -> _Space:
    """Search space of settings: the table above, and other floats of a user's algorithm, within
    their `Range`."""
    space = {}
    for name, limits in _SPACE.items():
        if name in vars(start) and (goals or name not in _ONLY_WITH_GOALS):
            space[name] = limits
    if type(start).__module__.startswith("bricksrl."):
        return space
    hints = typing.get_type_hints(type(start), include_extras=True)
    for name, value in vars(start).items():
        if name not in _SPACE and isinstance(value, float):
            # The range is a decade to both sides, because good values differ by factors. A value of
            # 0 has no decade, so its range is what most factors are.
            low, high = sorted((value / 10.0, value * 10.0)) if value else (0.0, 1.0)
            for limits in getattr(hints.get(name), "__metadata__", ()):
                if isinstance(limits, Range):
                    low = max(low, limits.low)
                    high = min(high, limits.high)
            space[name] = (low, high, low > 0)
    return space


def tune(
    tuning: Tuning,
    folder: Path,
    trials: int,
    *,
    seed: int = 0,
    on: str | None = None,
    on_trial: OnTrial = lambda *_: None,
) -> Best:
    """Run ``trials`` more trials, and write the best settings so far to ``best.json``.

    Args:
        on: "ray", or "ray:ADDRESS" for a cluster, to train the seeds of a trial in parallel; the
            results are the same.

    Raises:
        RunError: Optuna is not installed, there is no such cluster, the folder holds a study of
            another definition, or no trial was finished.
        DescriptionError: the seed is invalid.
        UnknownNameError: there is no such environment or agent.
    """
    with installed("Optuna", RunError, '"bricksrl[tune]"'):
        import optuna
    check_seed(seed)
    if on is not None:
        parse_on(on)
    start = settings_for(tuning.env, "default", tuning.agent)
    goals = any(entry.name.endswith("_goal") for entry in get_task(tuning.env).entries)
    # A failed trial raises an error, and that one message is enough.
    optuna.logging.set_verbosity(logging.ERROR)
    with closing(make(tuning.env)) as env:
        learner = make_learner(tuning.agent, env)
    if learner.needs_dataset or not learner.updates_per_step:
        raise RunError(
            f"{tuning.agent} does not learn from a robot, and tuning gives it nothing else; "
            "choose another agent"
        )
    name = f"{tuning.env} {tuning.agent}"
    storage = f"sqlite:///{(folder / STUDY).absolute()}"
    # Several commands may begin the same study at once, but only one may make it.
    with _storage(folder / STUDY), serialized(folder):
        for other in set(optuna.get_all_study_names(storage)) - {name}:
            raise RunError(f"{folder} holds a study of {other}; choose another folder")
        study = optuna.create_study(
            study_name=name,
            storage=storage,
            direction="maximize",
            load_if_exists=True,
            pruner=optuna.pruners.MedianPruner(n_startup_trials=5),
        )
        about = dataclasses.asdict(tuning)
        known = study.user_attrs.get("tuning", about)
        if known != about:
            others = [name for name, value in about.items() if known.get(name) != value]
            values = ", ".join(f"{name} {known.get(name)}" for name in others)
            raise RunError(f"{folder} holds a study of {values}; give the same, or another folder")
        study.set_user_attr("tuning", about)
        # A command that goes on proposes other values than the one before did.
        sampler_seed = (seed + len(study.trials)) % (LARGEST_SEED + 1)
        study.sampler = optuna.samplers.TPESampler(seed=sampler_seed)
        if not study.trials:
            # The defaults are the first trial, so that the best one is never worse than they are.
            study.enqueue_trial(_as_proposed(start, goals=goals))

    def objective(trial: optuna.Trial) -> float:
        settings = propose(trial, start, goals=goals)
        orders = [(tuning, settings, seed) for seed in range(tuning.seeds)]
        values: list[float] = []
        found: Iterable[float]
        if ray is None:
            # Seeds are trained one by one, so that those of a hopeless trial are left out.
            found = starmap(_train_and_evaluate, orders)
        else:
            found = list(map_on_cluster(ray, _train_and_evaluate, orders))
        for index, value in enumerate(found):
            if math.isnan(value):
                raise optuna.TrialPruned
            values.append(value)
            mean = sum(values) / len(values)
            trial.report(mean, index)
            if index + 1 < tuning.seeds and trial.should_prune():
                raise optuna.TrialPruned
        return mean

    def after_trial(study: optuna.Study, trial: optuna.trial.FrozenTrial) -> None:
        done = trial.state == optuna.trial.TrialState.COMPLETE
        best = _write_best(
            study,
            tuning,
            start,
            folder,
            goals=goals,
        )
        on_trial(trial.number, trial.value if done else None, None if best is None else best.value)

    with _storage(folder / STUDY), nullcontext() if on is None else connected(parse_on(on)) as ray:
        study.optimize(objective, n_trials=trials, callbacks=[after_trial])
    best = _write_best(
        study,
        tuning,
        start,
        folder,
        goals=goals,
    )
    if best is None:
        raise RunError(f"no trial of {folder} was finished; give more --trials")
    return best


@contextmanager
def _storage(path: Path) -> Iterator[None]:
    """Raise RunError where Optuna cannot use its file inside this context, as when it is damaged or
    the disk is full."""
    from optuna.exceptions import StorageInternalError
    from sqlalchemy.exc import SQLAlchemyError

    try:
        yield
    except (SQLAlchemyError, StorageInternalError) as error:
        reason = message_of(getattr(error, "orig", None) or error)
        remedy = "make room on the disk" if "full" in reason else "restore that file"
        raise RunError(
            f"cannot use the study {path} ({reason}); {remedy}, or choose another folder"
        ) from None


def _train_and_evaluate(
    tuning: Tuning,
    settings: Any,
    seed: int,
) -> float:
    """Mean return of a trained agent; not a number if it diverged."""
    from bricksrl.evaluation.evaluator import evaluate
    from bricksrl.training.run import train

    stop = threading.Event()

    class StopAtSteps(Callback):
        def on_episode(
            self,
            episode: Episode,
            progress: Progress,
        ) -> None:
            if episode.steps >= tuning.steps:
                stop.set()

    with tempfile.TemporaryDirectory() as folder:
        run_dir = Path(folder) / "run"
        config = TrainConfig(
            tuning.env,
            tuning.agent,
            episodes=tuning.steps,
            seed=seed,
            settings=settings,
            run_dir=run_dir,
            asynchronous=False,
        )
        try:
            result = train(config, StopAtSteps(), stop=stop)
            is_complete = result.episodes and result.episodes[-1].steps >= tuning.steps
            # Our own stop at the last step looks like a user's stop, which would end the study.
            if result.interrupted and not is_complete:
                raise KeyboardInterrupt
            # The episodes of the final evaluation are not used, because what chooses must not also
            # judge.
            found = evaluate(
                run_dir,
                episodes=tuning.episodes,
                kind="selection",
                save=False,
            )
        except DivergedError:
            return math.nan
        return found.return_mean


def _as_proposed(settings: Any, *, goals: bool) -> dict[str, Any]:
    """Trial parameters that propose these settings, as far as they lie in the search space."""
    parameters: dict[str, Any] = {}
    for name, limits in _space(settings, goals=goals).items():
        value: Any = getattr(settings, name)
        if isinstance(value, tuple):
            value = ",".join(map(str, value))
        if isinstance(limits, list):
            is_within = value in limits
        else:
            low, high, _ = limits
            is_within = value is not None and low <= value <= high
        if is_within:
            parameters[name] = value
    return parameters


def _write_best(
    study: optuna.Study,
    tuning: Tuning,
    start: Any,
    folder: Path,
    *,
    goals: bool,
) -> Best | None:
    """Write the best settings so far; ``None`` while no trial is finished."""
    import optuna

    finished = [trial for trial in study.trials if trial.state == optuna.trial.TrialState.COMPLETE]
    if not finished:
        return None
    best = study.best_trial
    settings = propose(optuna.trial.FixedTrial(best.params), start, goals=goals)
    result = Best(settings, float(study.best_value), len(finished))
    data = {
        "settings": dataclasses.asdict(settings),
        "provenance": {
            "found_by": f"bricksrl tune {tuning.env} --agent {tuning.agent}",
            **dataclasses.asdict(tuning),
            "trials": len(study.trials),
            "trial": best.number,
            "return_mean": result.value,
        },
    }
    text = (json.dumps(data, indent=2) + "\n").encode()
    remember(text)
    write_durably(folder / BEST, text)
    return result
