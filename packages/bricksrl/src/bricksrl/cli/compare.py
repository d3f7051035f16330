"""``bricksrl compare`` and ``bricksrl plot``: several runs in one table or plot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional

from brickhub.cli.options import JsonFlag, option
from brickhub.cli.terminal import print_line
from bricksrl.errors import percent

if TYPE_CHECKING:
    from bricksrl.evaluation.comparison import Comparison, Group


@dataclass(frozen=True)
class Compare:
    """Compare runs: agents, seeds and environments in one table, with the probability that one agent beats the other.

    Runs that differ only in their seed form a group; the folder of `bricksrl train --seeds` stands for all its runs. Groups of
    five or more seeds have 95 % intervals. Runs are scored by their evaluations if all have one of the last checkpoint in the
    environment and physics of the training; else by their last episodes.

    Examples:
      bricksrl compare runs/sac runs/td3
      bricksrl compare runs/sac runs/td3 --out comparison.png
      bricksrl compare runs/* --json
    """

    runs: Annotated[Positional[tuple[Path, ...]], option(metavar="RUN")]
    """Folders of runs."""
    out: Annotated[Path | None, option(metavar="FILE")] = None
    """PNG file for the learning curves."""
    json: JsonFlag = False

    def execute(self) -> None:
        from bricksrl.evaluation.comparison import compare, draw
        from bricksrl.plotting import check_picture

        if self.out is not None:
            check_picture(self.out)
        comparison = compare(self.runs)
        if self.json:
            print_line(comparison.to_json())
        else:
            _print(comparison)
        if self.out is not None:
            draw(self.out, comparison.groups)
            if not self.json:
                print_line(f"picture  {self.out}")


@dataclass(frozen=True)
class Plot:
    """Plot the learning curves of runs, with reference lines: random actions, a scripted controller, the BricksRL paper.

    Examples:
      bricksrl plot runs/spin --out spin.png
      bricksrl plot runs/sac runs/td3 --out curves.png
    """

    runs: Annotated[Positional[tuple[Path, ...]], option(metavar="RUN")]
    """Folders of runs; the folder of `bricksrl train --seeds` stands for all its runs."""
    out: Annotated[Path, option(metavar="FILE")]
    """PNG file to write."""

    def execute(self) -> None:
        from bricksrl.evaluation.comparison import compare, draw
        from bricksrl.plotting import check_picture

        check_picture(self.out)
        draw(self.out, compare(self.runs).groups)
        print_line(f"picture  {self.out}")


def _print(comparison: Comparison) -> None:
    from rich.console import Console
    from rich.table import Table

    from brickhub.user_files import without_folder
    from bricksrl.plotting import number

    table = Table("environment", "agent", "seeds", "episodes", "robot steps", "score", "95 % interval", box=None, pad_edge=False)
    for group in comparison.groups:
        episodes = max(map(len, group.curves))
        cells = (str(len(group.seeds)), str(episodes), f"{group.steps:,}", number(group.score), _interval(group))
        table.add_row(without_folder(group.env), group.agent, *cells)
    console = Console()
    console.print(table)
    console.print(f"\nscore: return, interquartile mean over the seeds; of each run its {comparison.scored_by}", highlight=False)
    for pair in comparison.improvements:
        ends = pair.interval
        bounds = "" if ends is None else f" (95 % interval: {percent(ends.low)} to {percent(ends.high)})"
        line = f"{without_folder(pair.env)}: {pair.agent} beats {pair.other} with probability {percent(pair.probability)}{bounds}"
        console.print(line, highlight=False)


def _interval(group: Group) -> str:
    from bricksrl.plotting import number

    interval = group.interval
    return "needs 5 seeds" if interval is None else f"{number(interval.low)} to {number(interval.high)}"
