"""Figures of the paper, drawn from the results of the studies.

    python -m benchmarks figures            # docs/images/paper_*.png; PDF, SVG in studies/figures
    python -m benchmarks figures --quick    # from the quick form of the study `paper`, run first

The six of the paper: learning curves of the 2Wheeler, of the Walker and of the RoboArm, the camera
task, DroQ at 11 and 2 Hz, strategies on RunAway-v0; and one of simulation to robot. A line is the
mean of the seeds over five episodes, its band the 95 % bootstrap interval. A figure without results
is left out, and said.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import paper
from benchmarks.session import RESULTS, Session
from bricksrl.evaluation.statistics import ends, seeds_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Cells = Sequence[dict[str, Any]]
ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images"
WINDOW = 5
"""Episodes whose mean is a point of a curve."""
AGENTS = {"td3": "TD3", "sac": "SAC", "droq": "DroQ", "random": "random"}
COLORS = {"td3": "#c44e52", "sac": "#4c72b0", "droq": "#55a868", "random": "#8c8c8c"}
_NAMES = {
    "return": "return",
    "episode_steps": "steps of an episode",
    "error_sum_deg": "final error in degrees",
}


@dataclass(frozen=True)
class Figure:
    """A figure: a row of panels, each drawn by a function of its axes and the cells of a study; it
    returns False without any.

    Attributes:
        study: name of the study that it is drawn from.
    """

    name: str
    title: str
    panels: tuple[Callable[[Axes, Cells], bool], ...]
    study: str = "paper"


def smoothed(values: Sequence[float]) -> np.ndarray:
    """Running mean over the last ``WINDOW`` values, fewer at the start; of the same length."""
    sums = np.cumsum(np.insert(np.asarray(values, float), 0, 0.0))
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(0, ends - WINDOW)
    return np.asarray((sums[ends] - sums[starts]) / (ends - starts))


def curve(
    column: str, measure: str = "return", rows: Sequence[str] = tuple(AGENTS)
) -> Callable[[Axes, Cells], bool]:
    """A panel with a measure over the training episodes in an environment, a line for each
    agent."""

    def draw(axes: Axes, cells: Cells) -> bool:
        found = {
            cell["row"]: cell["curves"]
            for cell in cells
            if cell["column"] == column and cell["row"] in rows
        }
        for row, curves in found.items():
            seeds = [smoothed(one[measure]) for one in curves if one.get(measure)]
            if seeds:
                _line(axes, seeds, AGENTS[row], COLORS[row])
        reference = paper.RETURNS.get(column, {}).get("random")
        if measure == "return" and reference is not None:
            axes.axhline(
                reference[0],
                color=COLORS["random"],
                linestyle=":",
                linewidth=1,
                label="random, in the paper",
            )
        axes.set(title=column.rpartition(" from ")[2], xlabel="episode", ylabel=_NAMES[measure])
        return bool(found)

    return draw


def rates(columns: Mapping[str, str], row: str) -> Callable[[Axes, Cells], bool]:
    """A panel with the returns of one agent in several environments."""

    def draw(axes: Axes, cells: Cells) -> bool:
        found = {
            cell["column"]: cell["curves"]
            for cell in cells
            if cell["row"] == row and cell["column"] in columns
        }
        for column, color in zip(found, ("#4c72b0", "#c44e52", "#55a868"), strict=False):
            _line(axes, [smoothed(one["return"]) for one in found[column]], columns[column], color)
        axes.set(title=AGENTS[row], xlabel="episode", ylabel="return")
        return bool(found)

    return draw


def bars(column: str, metric: str, label: str) -> Callable[[Axes, Cells], bool]:
    """A panel with a metric of the evaluated episodes, a bar for each agent."""

    def draw(axes: Axes, cells: Cells) -> bool:
        found = [cell for cell in cells if cell["column"] == column and cell["row"] in AGENTS]
        last = [
            list(cell["conditions"].values())[-1]["metrics"].get(metric, float("nan"))
            for cell in found
        ]
        axes.bar(
            [AGENTS[cell["row"]] for cell in found],
            last,
            color=[COLORS[cell["row"]] for cell in found],
            width=0.6,
        )
        axes.set(title=column, ylabel=label)
        return bool(found)

    return draw


def transfer(columns: Mapping[str, str]) -> Callable[[Axes, Cells], bool]:
    """A panel with the returns on the robot of agents that were trained in its simulation, beside
    the paper's."""

    def draw(axes: Axes, cells: Cells) -> bool:
        labels = list[str]()
        for cell in cells:
            if cell["column"] in columns and cell["row"] in AGENTS:
                last, x = list(cell["conditions"].values())[-1], len(labels)
                axes.plot(
                    [x] * len(last["returns"]),
                    last["returns"],
                    "o",
                    color=COLORS[cell["row"]],
                    markersize=4,
                )
                mean, deviation = cell["paper"]["return"]
                axes.errorbar(x + 0.2, mean, deviation, color="black", marker="_", capsize=3)
                labels.append(f"{AGENTS[cell['row']]}\n{columns[cell['column']]}")
        axes.set_xticks(range(len(labels)), labels, fontsize=7)
        axes.set(ylabel="return on the robot", title="dots: seeds; bars: the paper")
        return bool(labels)

    return draw


def _line(axes: Axes, seeds: Sequence[np.ndarray], label: str, color: str) -> None:
    shortest = min(map(len, seeds))
    values = np.stack([one[:shortest] for one in seeds])
    episodes = np.arange(1, shortest + 1)
    axes.plot(episodes, values.mean(0), color=color, label=label)
    intervals = [
        interval for column in values.T if (interval := seeds_interval(column)) is not None
    ]
    if len(intervals) == shortest:
        low, high = np.array([ends(interval) for interval in intervals]).T
        axes.fill_between(episodes, low, high, color=color, alpha=0.2, linewidth=0)


_SIM = {"Walker-v0 from WalkerSim-v0": "Walker", "RoboArm-v0 from RoboArmSim-v0": "RoboArm"}
FIGURES = (
    Figure("2wheeler", "2Wheeler", (curve("RunAway-v0"), curve("Spinning-v0"))),
    Figure("walker", "Walker", (curve("Walker-v0"), curve("Walker-v0 from WalkerSim-v0"))),
    Figure(
        "robo_arm",
        "RoboArm",
        tuple(
            curve(column, measure)
            for column in ("RoboArm-v0", "RoboArm-v0 from RoboArmSim-v0")
            for measure in ("return", "error_sum_deg", "episode_steps")
        ),
    ),
    Figure(
        "camera",
        "RoboArm with a camera",
        (curve("RoboArm_mixed-v0"), curve("RoboArm_mixed-v0", "episode_steps")),
    ),
    Figure(
        "rates",
        "Steps a second",
        (
            rates(
                {"Walker-v0, 11 Hz": "11 Hz", "Walker-v0, 2 Hz": "2 Hz", "Walker-v0": "4 Hz"},
                "droq",
            ),
        ),
    ),
    Figure(
        "strategies",
        "Strategies on RunAway-v0",
        (
            bars("RunAway-v0", "final_distance_mm", "final distance in mm"),
            bars("RunAway-v0", "action_size", "mean size of an action"),
        ),
    ),
    Figure("sim_to_robot", "Simulation to robot", (transfer(_SIM),)),
)


def draw(figure: Figure, cells: Cells, place: Path, forms: Sequence[str]) -> list[Path]:
    """Draw a figure from the cells of its study, a file for each form; none without results."""
    from matplotlib.figure import Figure as Canvas

    columns = min(3, len(figure.panels))
    rows = -(-len(figure.panels) // columns)
    canvas = Canvas(figsize=(4.2 * columns, 3.2 * rows), layout="constrained")
    drawn = [
        panel(canvas.add_subplot(rows, columns, i + 1), cells)
        for i, panel in enumerate(figure.panels)
    ]
    if not any(drawn):
        return []
    labels = {
        label: handle
        for axes in canvas.axes
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if labels:
        canvas.legend(
            labels.values(),
            labels.keys(),
            loc="outside lower center",
            ncols=len(labels),
            frameon=False,
        )
    canvas.suptitle(figure.title)
    paths = [place / f"paper_{figure.name}.{form}" for form in forms]
    for path in paths:
        canvas.savefig(path, dpi=110, metadata={"Date": None} if path.suffix == ".svg" else None)
    return paths


def main(session: Session) -> None:
    """Draw all figures of which there are results."""
    session.parse()
    results = RESULTS
    if session.is_quick:
        from benchmarks.study import run_study
        from benchmarks.study_tables import STUDIES

        study = next(study for study in STUDIES if study.name == "paper")
        run_study(study, session.folder / "paper", quick=True, seeds=1, jobs=session.jobs)
        results = session.folder
    vectors = session.place_of(Path("studies") / "figures")
    images = vectors if session.is_apart else IMAGES
    for figure in FIGURES:
        path = results / (
            f"{figure.study}/study.json" if session.is_quick else f"study_{figure.study}.json"
        )
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"] if path.exists() else []
        paths = [
            *draw(figure, cells, images, ("png",)),
            *draw(figure, cells, vectors, ("pdf", "svg")),
        ]
        print(f"{figure.name}: {', '.join(map(str, paths)) or 'no results yet'}", flush=True)
