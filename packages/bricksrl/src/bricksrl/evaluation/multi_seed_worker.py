"""Worker process that trains one seed: ``python -m bricksrl.evaluation.multi_seed_worker``, started by `multi_seed`."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from brickhub.user_files import failure_of_user
from bricksrl.child_process import END, Message, leave, parent_channel
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


def main() -> None:
    """Train and evaluate as ordered; sends a message for each episode, one for the evaluation, and one for an error. Ends after
    the present step if the parent asks for it or is gone."""
    orders: SimpleQueue[Message] = SimpleQueue()
    stop = threading.Event()

    def receive(message: Message | None) -> None:
        if message in (END, None):
            stop.set()
        orders.put(message or END)

    send = parent_channel(receive)
    code = 1
    try:
        _, order = orders.get()
        if order is not None:
            config, run_dir = order
            reporter = Reporter(partial(send, "report"))

            def start(callback: Callback) -> None:
                if train(TrainConfig.from_dict(config, run_dir=run_dir), callback, stop=stop).interrupted:
                    raise KeyboardInterrupt

            if (error := train_and_evaluate(start, run_dir, reporter)) is not None:
                reporter.send({"error": error})
        code = 0
    except (BrokenPipeError, KeyboardInterrupt):  # the parent is gone, or asked for the end
        pass
    except Exception:  # noqa: BLE001  an exit at once would not print it
        traceback.print_exc()
    leave(code)


if __name__ == "__main__":
    main()
