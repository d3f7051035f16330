"""The process that learns beside a robot: ``python -m bricksrl.training.learning_process``, started by `beside`, never by hand.

It listens from its first moment, while torch is being loaded, so that the robot's side can send without waiting. It ends by
itself when the robot's side has gone, after writing what it was told to.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from bricksrl.training.channel import Channel, unpack

if TYPE_CHECKING:
    from bricksrl.agents.agent import Agent

Inbox = SimpleQueue[bytes | None]


def main() -> None:
    """Take part in one run."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    incoming, outgoing = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints does not end up among the messages
    inbox: Inbox = SimpleQueue()
    channel = Channel(incoming, outgoing, inbox.put)
    with contextlib.suppress(BrokenPipeError):
        try:
            first = inbox.get()
            if first is not None:
                serve(unpack(first)[1], inbox, channel)
        except BrokenPipeError:
            raise
        except Exception as error:  # noqa: BLE001  the robot's side tells the user
            channel.send(("failed", f"{type(error).__name__}: {' '.join(str(error).split())}"))
    sys.stderr.flush()
    os._exit(0)  # the thread that listens holds its pipe, which an orderly exit would wait for


def make_learning_agent(begin: dict[str, Any]) -> Agent:
    """The agent that ``begin`` describes, with its state."""
    from bricksrl.agents import make_agent
    from bricksrl.agents.layout import ObservationLayout
    from bricksrl.envs.registry import get_task
    from bricksrl.training.config import TrainConfig
    from bricksrl.training.offline import study

    config = TrainConfig.from_dict(begin["config"])
    task = get_task(config.env, **config.options) if begin["has_task"] else None
    layout = ObservationLayout.from_dict(begin["layout"])
    agent = make_agent(config.agent, layout, begin["action_size"], config.settings, task)
    agent.load_state_dict(begin["state"])
    study(config, agent)
    return agent


def serve(begin: dict[str, Any], inbox: Inbox, channel: Channel) -> None:
    """Learn until the robot's side says that it is over, or has gone."""
    import torch

    from bricksrl.training.checkpoint import save_checkpoint

    torch.set_num_threads(1)  # the robot has the other cores
    torch.manual_seed(begin["seed"])
    agent = make_learning_agent(begin)
    asked, done = begin["pace"]["asked"], begin["pace"]["done"]
    del begin
    saves = 0
    channel.send(("ready", agent.policy_state()))
    while True:
        while (message := _next(inbox, wait=done >= asked)) is not None:
            kind, content = message
            match kind:
                case "remember":
                    agent.remember(content)
                case "end_episode":
                    agent.end_episode()
                case "update":
                    asked += 1
                case "save":
                    path, state = content
                    pace = {"asked": asked, "done": done}
                    save_checkpoint(Path(path), {**state, "agent": agent.state_dict(), "pace": pace})
                    saves += 1
                    channel.send(("saved", saves))
                case "end":
                    return
        losses = agent.update()
        done += 1
        channel.send(("learned", (done, losses, agent.policy_state())))


def _next(inbox: Inbox, *, wait: bool) -> tuple[str, Any] | None:
    """The next message; ``None`` where there is none and it is not worth waiting for one."""
    try:
        data = inbox.get(block=wait)
    except Empty:
        return None
    return ("end", None) if data is None else unpack(data)


if __name__ == "__main__":
    main()
