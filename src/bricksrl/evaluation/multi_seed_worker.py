"""Worker process that trains one seed: ``python -m bricksrl.evaluation.multi_seed_worker``, started by `multi_seed`.

It reads the order as a line of JSON, and writes a line of JSON for each episode and one for the evaluation or the error.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any, TextIO

from bricksrl.envs.user_files import failure_of_user
from bricksrl.errors import BricksError
from bricksrl.evaluation import evaluate
from bricksrl.training import Callback, Episode, Progress, TrainConfig, train


class Reporter(Callback):
    """Callback that writes a line per episode."""

    def __init__(self, out: TextIO) -> None:
        self._out = out

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        send(self._out, {"episode": episode.episode, "return": episode.return_})


def send(out: TextIO, message: dict[str, Any]) -> None:
    """Write a message as a line, and flush."""
    out.write(json.dumps(message) + "\n")
    out.flush()


def main() -> int:
    """Train and evaluate; returns the exit code."""
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    order = json.loads(sys.stdin.readline())
    config = TrainConfig.from_dict(order["config"], run_dir=Path(order["run_dir"]))
    try:
        train(config, Reporter(out))
        send(out, {"evaluated": evaluate(Path(order["run_dir"]), episodes=order["evaluated_episodes"]).return_mean})
    except BricksError as error:
        send(out, {"error": str(error)})
        return 2
    except Exception as error:
        message = failure_of_user(error)
        if message is None:
            raise
        send(out, {"error": message})
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
