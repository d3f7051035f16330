"""``bricksrl train --seeds``: several seeds side by side, a line for each episode, and what they say together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bricksrl.cli.console import INTERRUPTED, print_interrupted, print_line

if TYPE_CHECKING:
    from bricksrl.training import TrainConfig


def train_seeds(config: TrainConfig, count: int) -> int:
    """Train them, and say where everything is."""
    from bricksrl.evaluation import seeds

    def tell(seed: int, message: dict[str, Any]) -> None:
        if "episode" in message:
            print_line(f"seed {seed}  episode {message['episode']}/{config.episodes}  return {message['return']:.4g}")
        elif "evaluated" in message:
            print_line(f"seed {seed}  trained and evaluated  return {message['evaluated']:.4g}")

    try:
        summary = seeds.train_seeds(config, count, on_line=tell)
    except KeyboardInterrupt:
        print_interrupted(
            f"what was trained is in {config.run_dir}; `bricksrl resume {config.run_dir}/seed-...` goes on with a seed"
        )
        return INTERRUPTED
    low, high = summary.return_interval.low, summary.return_interval.high
    print_line(f"return   {summary.return_iqm:.4g}  (interquartile mean of {count} seeds; 95 % in {low:.4g} to {high:.4g})")
    print_line(f"summary          {config.run_dir}/summary.json")
    print_line(f"learning curves  {config.run_dir}/learning_curves.png")
    return 0
