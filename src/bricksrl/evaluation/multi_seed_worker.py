"""Worker process that trains one seed: ``python -m bricksrl.evaluation.multi_seed_worker``, started by `multi_seed`.

It reads the order as a line of JSON, and writes a line of JSON for each episode and one for the evaluation or the error.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bricksrl.envs.user_files import failure_of_user
from bricksrl.errors import BricksError
from bricksrl.evaluation import evaluate
from bricksrl.training import Callback, Episode, Progress, TrainConfig, train

Send = Callable[[dict[str, Any]], None]
"""Called with a message about a run."""


class Reporter(Callback):
    """Callback that sends a message per episode."""

    def __init__(self, send: Send) -> None:
        self.send = send

    def on_episode(self, episode: Episode, progress: Progress) -> None:
        self.send({"episode": episode.episode, "return": episode.return_})


def train_and_evaluate(start: Callable[[Callback], object], run_dir: Path, reporter: Reporter) -> str | None:
    """Train by ``start``, evaluate, and report; returns the error, if any, also one of the user's code."""
    try:
        start(reporter)
        reporter.send({"evaluated": evaluate(run_dir).return_mean})
    except BricksError as error:
        return str(error)
    except Exception as error:
        message = failure_of_user(error)
        if message is None:
            raise
        return message
    return None


def main() -> int:
    """Train and evaluate; returns the exit code."""
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    order = json.loads(sys.stdin.readline())
    run_dir = Path(order["run_dir"])
    config = TrainConfig.from_dict(order["config"], run_dir=run_dir)

    def send(message: dict[str, Any]) -> None:
        out.write(json.dumps(message) + "\n")
        out.flush()

    error = train_and_evaluate(lambda callback: train(config, callback), run_dir, Reporter(send))
    if error is not None:
        send({"error": error})
    return 0 if error is None else 2


if __name__ == "__main__":
    sys.exit(main())
