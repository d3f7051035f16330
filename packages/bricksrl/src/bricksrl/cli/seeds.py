"""``bricksrl train --seeds``: progress of parallel seeds, as a table or as lines, and their summary."""

from __future__ import annotations

import sys
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from brickhub.cli.terminal import Interrupted, print_line
from brickhub.files import quoted
from bricksrl.errors import counted

if TYPE_CHECKING:
    from rich.table import Table

    from bricksrl.training import TrainConfig


@dataclass
class _Row:
    """State of one seed: computer, episode, last return."""

    state: str = "waiting"
    episode: int = 0
    return_: float | None = None
    node: str = ""


class SeedsProgress:
    """Progress of all seeds: a live table on a terminal, a line per event elsewhere."""

    def __init__(self, seeds: range, episodes: int, *, live: bool | None = None) -> None:
        self._rows = {seed: _Row() for seed in seeds}
        self._episodes = episodes
        self._lock = threading.Lock()
        self._live: Any = None
        if sys.stdout.isatty() if live is None else live:
            from rich.live import Live

            self._live = Live(self.table(), refresh_per_second=4)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, seed: int, message: dict[str, Any]) -> None:
        """Update the row of a seed from a message of its run; may be called from several threads."""
        with self._lock:
            row, line = self._rows[seed], ""
            if "started" in message:
                is_restart = row.state != "waiting"
                row.state, row.node = "training", message.get("node", "")
                line = f"seed {seed}  its worker was lost; resumed after episode {message['started']}" if is_restart else ""
            elif "episode" in message:
                row.state, row.episode, row.return_ = "training", message["episode"], message["return"]
                line = f"seed {seed}  episode {row.episode}/{self._episodes}  return {row.return_:.4g}"
            elif "evaluated" in message:
                row.state, row.return_ = "evaluated", message["evaluated"]
                line = f"seed {seed}  trained and evaluated  return {row.return_:.4g}"
            elif "error" in message:
                row.state = "failed"
            if self._live is not None:
                self._live.update(self.table())
            elif line:
                print_line(line)

    def table(self) -> Table:
        """Table of all seeds."""
        from rich.table import Table

        table = Table("seed", "episode", "return", "state", "computer", box=None)
        for seed, row in self._rows.items():
            return_ = "" if row.return_ is None else f"{row.return_:.4g}"
            table.add_row(str(seed), f"{row.episode}/{self._episodes}", return_, row.state, row.node)
        return table


def train_seeds(config: TrainConfig, count: int, on: str | None = None) -> None:
    """Train ``count`` seeds and print their summary."""
    from bricksrl.evaluation import multi_seed

    multi_seed.check_count(count)
    try:
        with SeedsProgress(range(config.seed, config.seed + count), config.episodes) as progress:
            group = multi_seed.train_seeds(config, count, on=on, on_line=progress.update)
    except KeyboardInterrupt:
        folder = config.run_dir
        if folder is None or not folder.exists():
            raise Interrupted("no seed had started, so nothing was saved") from None
        resumes = f"`bricksrl resume {quoted(folder)}/seed-...` resumes a seed"
        raise Interrupted(f"what was trained is in {folder}; {resumes}") from None
    interval = group.interval
    spread = (
        f"from {min(group.scores):.4g} to {max(group.scores):.4g}; 5 seeds or more give an interval"
        if interval is None
        else f"95 % interval: {interval.low:.4g} to {interval.high:.4g}"
    )
    print_line(f"return   {group.score:.4g}  (interquartile mean of {counted(count, 'seed')}; {spread})")
    print_line(f"summary          {config.run_dir}/summary.json")
    print_line(f"learning curves  {config.run_dir}/learning_curves.png")
