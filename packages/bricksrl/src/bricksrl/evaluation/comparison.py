"""Comparison of runs by agent, seed and environment, as a table and a plot."""

import dataclasses
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from brickhub.user_files import without_folder
from bricksrl.envs.reference_returns import reference_lines
from bricksrl.errors import RunError
from bricksrl.evaluation.statistics import (
    FEWEST_SEEDS,
    Interval,
    ends,
    interquartile_mean,
    probability_of_improvement,
    seeds_interval,
    stratified_bootstrap_interval,
)
from bricksrl.plotting import PALETTE, check_picture, finish, new_figure, save, style
from bricksrl.training.callbacks import WINDOW
from bricksrl.training.config import TrainConfig
from bricksrl.training.curve import moving_mean
from bricksrl.training.run_folder import RunFolder

_COLUMNS = 2
_NOT_COMPARED = ("seed", "episodes", "device", "log", "record", "name")
"""Names in a config in which runs of a group may differ."""


@dataclass(frozen=True)
class Group:
    """Runs of one agent in one environment that differ only in their seeds.

    Attributes:
        agent: name of the agent, with the settings in which its groups differ.
        seeds, scores, curves: seed, score, and moving mean of the episode returns of each run.
        steps: robot steps of the longest run.
        is_evaluated: whether the scores are evaluations, without exploration, rather than ends of
            the curves.
        score: interquartile mean of the scores.
        interval: its 95 % bootstrap interval; ``None`` for fewer than five runs.
    """

    env: str
    agent: str
    seeds: tuple[int, ...]
    scores: tuple[float, ...]
    curves: tuple[tuple[float, ...], ...]
    steps: int
    lines: Mapping[str, float]
    is_evaluated: bool = False

    @property
    def score(self) -> float:
        return float(interquartile_mean(np.array(self.scores)))

    @property
    def interval(self) -> Interval | None:
        return seeds_interval(self.scores)


@dataclass(frozen=True)
class Improvement:
    """Probability that a run of ``agent`` scores higher than one of ``other``, with its 95 %
    interval; of five runs or more."""

    env: str
    agent: str
    other: str
    probability: float
    interval: Interval


@dataclass(frozen=True)
class Comparison:
    """All groups, their pairwise probabilities of improvement, and the source of the scores:
    evaluations or last episodes."""

    groups: tuple[Group, ...]
    improvements: tuple[Improvement, ...]
    scored_by: str

    def to_json(self) -> str:
        """One JSON object."""
        groups = [
            {**dataclasses.asdict(group), "score": group.score, "interval": ends(group.interval)}
            for group in self.groups
        ]
        improvements = [
            {**vars(item), "interval": ends(item.interval)} for item in self.improvements
        ]
        return json.dumps(
            {"scored_by": self.scored_by, "groups": groups, "improvements": improvements}, indent=2
        )


def compare(paths: Sequence[Path | str] | Path | str) -> Comparison:
    """Compare runs, or look at one; a folder of several seeds stands for all its runs. Raises
    RunError if a folder holds no run or one without episodes, a run is named twice, or two runs of
    a group share a seed.

    Runs are scored by their evaluations if all have one, else by the mean of their last training
    episodes.
    """
    paths = [paths] if isinstance(paths, str | Path) else paths
    runs = [_Run.read(path) for path in _run_folders(paths)]
    # All runs are compared by one measure: an evaluation has no exploration, and so is higher than
    # the returns in training.
    is_evaluated = all(run.evaluation is not None for run in runs)
    by_config: dict[tuple[str, str], list[_Run]] = {}
    for run in runs:
        shared = json.dumps(run.compared, sort_keys=True, default=str)
        by_config.setdefault((run.config.env, shared), []).append(run)
    groups = []
    for env, shared in sorted(by_config):
        members = by_config[env, shared]
        _check_seeds(members)
        # Labels tell a group from the others, so one run of each group of this environment is
        # needed.
        in_env = [group[0] for (group_env, _), group in by_config.items() if group_env == env]
        group = Group(
            env=env,
            agent=_label(members[0], in_env),
            seeds=tuple(run.config.seed for run in members),
            scores=tuple(run.score(is_evaluated=is_evaluated) for run in members),
            curves=tuple(run.curve for run in members),
            steps=max(run.steps for run in members),
            lines=reference_lines(env, members[0].config.options),
            is_evaluated=is_evaluated,
        )
        groups.append(group)
    scored_by = "evaluation" if is_evaluated else f"mean of the last {WINDOW} episodes of training"
    return Comparison(tuple(groups), tuple(_improvements(groups)), scored_by)


def _improvements(groups: Sequence[Group]) -> Iterator[Improvement]:
    """Probabilities of improvement of all pairs in an environment that have enough runs."""
    for pair in itertools.combinations(groups, 2):
        if pair[0].env != pair[1].env:
            continue
        # The better one comes first, so that each pair reads as an improvement.
        better, other = sorted(pair, key=lambda group: group.score, reverse=True)
        probability, interval = probability_of_improvement(better.scores, other.scores)
        if interval is not None:
            yield Improvement(
                better.env,
                better.agent,
                other.agent,
                probability,
                interval,
            )


def _check_seeds(runs: "Sequence[_Run]") -> None:
    """Raise RunError if two runs of a group have the same seed."""
    by_seed: dict[int, _Run] = {}
    for run in runs:
        other = by_seed.setdefault(run.config.seed, run)
        if other is not run:
            about = (
                f"{other.path} and {run.path} have the same seed, {run.config.seed}, and the "
                "same settings"
            )
            raise RunError(
                f"{about}; omit one, as they would count twice, or list a class with --class FOLDER"
            )


@dataclass(frozen=True)
class _Run:
    path: Path
    config: TrainConfig
    curve: tuple[float, ...]
    steps: int
    evaluation: float | None

    @classmethod
    def read(cls, path: Path) -> "_Run":
        folder = RunFolder(path)
        config = folder.read_config()
        episodes = folder.read_episodes()
        if not episodes:
            raise RunError(f"the run in {path} has no episode yet; omit it")
        curve = tuple(moving_mean([episode.return_ for episode in episodes], WINDOW))
        evaluation = folder.own_evaluation(len(episodes))
        score = None if evaluation is None else float(evaluation["return_mean"])
        return cls(
            path,
            config,
            curve,
            episodes[-1].steps,
            score,
        )

    def score(self, *, is_evaluated: bool) -> float:
        """Mean return of the evaluation, or of the last episodes of the training."""
        if is_evaluated and self.evaluation is not None:
            return self.evaluation
        return self.curve[-1]

    @property
    def compared(self) -> dict[str, Any]:
        """Values of the config and of its settings that are equal for all runs of a group."""
        values = self.config.to_dict()
        values |= values.pop("settings")
        return {name: value for name, value in values.items() if name not in _NOT_COMPARED}


def _run_folders(paths: Sequence[Path | str]) -> Iterator[Path]:
    """Folders of the runs, with a folder of several seeds replaced by those of its runs."""
    seen: set[Path] = set()
    for path in map(Path, paths):
        seeds = sorted(config.parent for config in path.glob("seed-*/config.json"))
        # A user may call a copy by this name, so a run may contain such folders.
        is_run = RunFolder(path).config_path.exists()
        for run in seeds if seeds and not is_run else [path]:
            # A link to a folder names the same run a second time, which must not count twice.
            if run.resolve() in seen:
                raise RunError(f"{run} is named twice; name it once")
            seen.add(run.resolve())
            yield run
    if not seen:
        raise RunError("no run is named; give the folders of runs")


def _label(run: _Run, runs: Sequence[_Run]) -> str:
    """Name of the agent, and the settings in which it differs from others of that name in the
    environment."""
    agent = without_folder(run.config.agent)
    same = [other for other in runs if without_folder(other.config.agent) == agent]
    if len(same) == 1:
        return agent
    words = [agent]
    for name, value in run.compared.items():
        if any(other.compared.get(name) != value for other in same):
            words.append(f"{name}={value}")
    return ", ".join(words)


def draw(path: Path | str, groups: Sequence[Group]) -> None:
    """Plot the learning curves into an image file, with one panel per environment. Raises
    DescriptionError if the file name is not that of an image.

    A group of five or more runs is shown by its interquartile mean and 95 % interval, a smaller one
    by its runs and their mean.
    """
    path = check_picture(path)
    envs = list(dict.fromkeys(group.env for group in groups))
    columns = min(_COLUMNS, len(envs))
    rows = math.ceil(len(envs) / columns)
    agents = list(dict.fromkeys(group.agent for group in groups))
    # Colours are given to agents and not to lines, so that the legend can be shared by all panels.
    colours = dict(zip(agents, itertools.cycle(PALETTE)))
    figure = new_figure(7.0 * columns + 1.0, 3.8 * rows + 0.5)
    panels = figure.subplots(rows, columns, squeeze=False).flatten()
    drawn: set[str] = set()
    for axes, env in zip(panels, envs, strict=False):
        in_env = [group for group in groups if group.env == env]
        for group in in_env:
            label = None if group.agent in drawn else _legend(group.agent, groups)
            _draw_group(
                axes,
                group,
                colours[group.agent],
                label,
            )
            drawn.add(group.agent)
        is_evaluated = any(group.is_evaluated for group in in_env)
        mark = "; \N{BLACK DIAMOND} evaluation" if is_evaluated else ""
        style(
            axes,
            without_folder(env),
            "episode",
            f"return (mean of {WINDOW} episodes{mark})",
        )
        finish(axes, in_env[0].lines, legend=False)
    for unused in panels[len(envs) :]:
        unused.set_visible(False)
    figure.legend(
        loc="outside lower left",
        ncols=min(4, len(agents)),
        frameon=False,
        fontsize=9,
    )
    save(figure, path)


def _legend(agent: str, groups: Sequence[Group]) -> str:
    """Name of an agent, and how many seeds it has, over all panels."""
    counts = sorted({len(group.seeds) for group in groups if group.agent == agent})
    seeds = "seed" if counts == [1] else "seeds"
    return f"{agent} ({' or '.join(map(str, counts))} {seeds})"


def _draw_group(
    axes: Any,
    group: Group,
    colour: str,
    label: str | None,
) -> None:
    # The curve ends with the shortest run, because a mean of fewer runs would be another one.
    points = [list(values) for values in zip(*group.curves, strict=False)]
    episodes = range(1, len(points) + 1)
    means = [float(interquartile_mean(np.array(values))) for values in points]
    if len(group.curves) >= FEWEST_SEEDS:
        bounds = [stratified_bootstrap_interval([values], resamples=500) for values in points]
        axes.fill_between(
            episodes,
            [b.low for b in bounds],
            [b.high for b in bounds],
            color=colour,
            alpha=0.2,
            linewidth=0,
        )
    elif len(group.curves) > 1:
        for curve in group.curves:
            axes.plot(
                range(1, len(curve) + 1),
                curve,
                color=colour,
                linewidth=0.8,
                alpha=0.5,
            )
    axes.plot(
        episodes,
        means,
        color=colour,
        linewidth=2.2,
        label=label,
        zorder=3,
    )
    if group.is_evaluated:
        axes.plot(
            len(points),
            group.score,
            "D",
            color=colour,
            markersize=8,
            markeredgecolor="white",
            zorder=4,
        )
