"""Table of a class: the runs of many computers in one folder, and what may be compared of them, in
words."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from brickhub.user_files import without_folder
from bricksrl.errors import BricksError, RunError, counted
from bricksrl.evaluation.statistics import FEWEST_SEEDS, interquartile_mean, seeds_interval
from bricksrl.plotting import number
from bricksrl.training.callbacks import WINDOW
from bricksrl.training.config import TrainConfig
from bricksrl.training.run_folder import RunFolder

_UNCOMPARED = (
    "seed",
    "device",
    "log",
    "record",
    "name",
    "patience_s",
    "env",
    "agent",
    "episodes",
    "settings",
)
"""Values of a config that change no result, or are compared by themselves."""
_MAX_SHOWN = 3


@dataclass(frozen=True)
class ClassRow:
    """A run of a class.

    Attributes:
        name: name that was given to the run, or else the folder in which it lies.
        episodes: episodes that were trained.
        score: mean return of its evaluation, or else of its last episodes.
        interval: 95 % interval of an evaluation of five episodes or more.
        differs: in what it differs from most runs of its task.
    """

    name: str
    folder: str
    env: str
    agent: str
    seed: int
    episodes: int
    score: float
    is_evaluated: bool
    interval: tuple[float, float] | None
    differs: tuple[str, ...] = ()


@dataclass(frozen=True)
class ClassTable:
    """Rows by task, the best first, and sentences on what may be compared, and what was not
    read."""

    rows: tuple[ClassRow, ...]
    sentences: tuple[str, ...]

    def to_json(self) -> str:
        """One JSON object."""
        runs = [vars(row) for row in self.rows]
        return json.dumps({"runs": runs, "sentences": self.sentences}, indent=2)


@dataclass(frozen=True)
class _Run:
    row: ClassRow
    curve: tuple[float, ...]
    is_repeatable: bool
    values: dict[str, Any] = field(hash=False)
    """What a fair comparison needs to be equal, beside the seed."""


def class_table(folder: Path | str) -> ClassTable:
    """The table of all runs below a folder, at any depth. Raises RunError if there is none that can
    be read."""
    folder = Path(folder)
    runs = list[_Run]()
    unread = list[str]()
    for path in sorted(config.parent for config in folder.rglob("config.json")):
        # One damaged run, for example from a memory stick, must not hide the others.
        try:
            if (path / "metrics.csv").exists():
                runs.append(_read(path, folder))
        except BricksError as error:
            unread.append(f"{path.relative_to(folder)} is left out: {error}.")
    if not runs:
        why = unread[0] if unread else "put the folders of the runs into it"
        raise RunError(f"there is no run in {folder} that can be compared; {why}")
    rows = list[ClassRow]()
    sentences = list[str]()
    for env in dict.fromkeys(run.row.env for run in runs):
        members = [run for run in runs if run.row.env == env]
        members.sort(key=lambda run: run.row.score, reverse=True)
        usual = _usual(members)
        for run in members:
            rows.append(replace(run.row, differs=_differences(run.values, usual)))
        sentences += [f"{without_folder(env)}: {text}" for text in _sentences(members, usual)]
    if len({row.env for row in rows}) > 1:
        sentences.append(
            "Returns of different tasks are not comparable: each task counts its rewards in its "
            "own way."
        )
    return ClassTable(tuple(rows), (*sentences, *unread))


def _read(path: Path, folder: Path) -> _Run:
    run = RunFolder(path)
    config = run.read_config()
    episodes = run.read_episodes()
    if not episodes:
        raise RunError("it has no episode yet")
    returns = tuple(episode.return_ for episode in episodes)
    last = returns[-WINDOW:]
    score = sum(last) / len(last)
    interval = None
    evaluation = run.own_evaluation(len(episodes))
    if evaluation is not None:
        score = float(evaluation["return_mean"])
        interval = _interval(evaluation.get("return_interval"))
    row = ClassRow(
        name=config.name or _owner(path.relative_to(folder)),
        folder=str(path.relative_to(folder)),
        env=config.env,
        agent=without_folder(config.agent),
        seed=config.seed,
        episodes=len(episodes),
        score=score,
        is_evaluated=evaluation is not None,
        interval=interval,
    )
    # The curve of a run can be compared only if its seed repeats it, which a learner beside the
    # robot and a real robot do not allow.
    is_repeatable = not config.asynchronous and config.hub == "virtual"
    return _Run(
        row,
        returns,
        is_repeatable,
        _values(config, len(episodes)),
    )


def _owner(path: Path) -> str:
    """The uppermost folder that is not the usual one of runs."""
    return next((part for part in path.parts if part != "runs"), path.name)


def _interval(value: Any) -> tuple[float, float] | None:
    match value:
        case {"low": float() | int() as low, "high": float() | int() as high}:
            return float(low), float(high)
        case [float() | int() as low, float() | int() as high]:
            return float(low), float(high)
    return None


def _values(config: TrainConfig, episodes: int) -> dict[str, Any]:
    data = config.to_dict()
    shared = {**data, **dict(data["settings"])}
    values = {name: value for name, value in shared.items() if name not in _UNCOMPARED}
    return {"episodes": episodes, "agent": without_folder(config.agent), **values}


def _usual(runs: Sequence[_Run]) -> dict[str, Any]:
    """The values of most runs."""
    counts = Counter(_key(run) for run in runs)
    most = counts.most_common(1)[0][0]
    return next(run.values for run in runs if _key(run) == most)


def _key(run: _Run) -> str:
    return json.dumps(run.values, sort_keys=True, default=str)


def _differences(values: dict[str, Any], usual: dict[str, Any]) -> tuple[str, ...]:
    if values["agent"] != usual["agent"]:
        return (f"agent {values['agent']} instead of {usual['agent']}",)
    names = [name for name in values if values[name] != usual.get(name)]
    texts = [f"{name} {values[name]} instead of {usual.get(name)}" for name in names[:_MAX_SHOWN]]
    if len(names) > _MAX_SHOWN:
        texts.append(f"{len(names) - _MAX_SHOWN} more")
    return tuple(texts)


def _sentences(runs: Sequence[_Run], usual: dict[str, Any]) -> Iterator[str]:
    by_key: dict[str, list[_Run]] = {}
    for run in runs:
        by_key.setdefault(_key(run), []).append(run)
    for members in sorted(by_key.values(), key=len, reverse=True):
        different = list(_different(members))
        for same in _same(members):
            names = ", ".join(f"{run.row.name} ({run.row.folder})" for run in same)
            # A copied folder has the same curve to the last digit, but a repetition on another
            # processor differs there.
            is_copy = len({run.curve for run in same}) == 1
            what = "the same run" if is_copy else "runs of the same seed"
            yield (
                f"{names} are {what}, seed {same[0].row.seed} with the same settings: they "
                "count once."
            )
        if len(members) < 2:
            continue
        if members[0].values == usual:
            which = "the same settings and length"
        else:
            which = "other settings, equal among themselves"
        yield f"{counted(len(members), 'run')} of {which}: {_score(different)}."
    if len(by_key) > 1:
        lengths = sorted({run.row.episodes for run in runs})
        text = "runs that differ in settings are compared as groups of five seeds, not one by one"
        if len(lengths) > 1:
            span = f"{lengths[0]} to {lengths[-1]} episodes"
            text += f"; runs of {span} by their curves, up to the shorter one's end"
        yield f"{text}."


def _different(members: Sequence[_Run]) -> Iterator[_Run]:
    """The runs that tell something of their own: one of each seed where a seed says all."""
    seen = set[int]()
    for run in members:
        if run.is_repeatable and run.row.seed in seen:
            continue
        seen.add(run.row.seed)
        yield run


def _same(members: Sequence[_Run]) -> Iterator[list[_Run]]:
    """Repeatable runs that share a seed."""
    by_seed: dict[int, list[_Run]] = {}
    for run in members:
        if run.is_repeatable:
            by_seed.setdefault(run.row.seed, []).append(run)
    yield from (same for same in by_seed.values() if len(same) > 1)


def _score(different: Sequence[_Run]) -> str:
    scores = [run.row.score for run in different]
    if len({run.row.is_evaluated for run in different}) > 1:
        return (
            "some were evaluated and some were not; `bricksrl evaluate RUN` makes them comparable"
        )
    if len(scores) == 1:
        return (
            "together they tell what one run tells; train with `--seed 1`, `--seed 2`, ... for more"
        )
    middle = number(float(interquartile_mean(np.array(scores))))
    interval = seeds_interval(scores)
    if interval is None:
        return (
            f"{len(scores)} different seeds, interquartile mean {middle}; an interval needs "
            f"{FEWEST_SEEDS} seeds"
        )
    bounds = f"95 % interval {number(interval.low)} to {number(interval.high)}"
    return f"{len(scores)} different seeds, interquartile mean {middle} ({bounds})"
