"""A button of the hub, or of a remote, by which a person tells this computer something while the
robot plays: the hub answers it with its channels, and it is in no observation."""

from __future__ import annotations

from dataclasses import replace

from brickhub.hub.interface import WatchedButton, WatchedRemoteButton
from bricksrl.envs.task import Task
from bricksrl.errors import DescriptionError

_OF_REMOTE = "remote."


def watching(task: Task, button: str) -> Task:
    """The task, whose hub answers a button too: ``left``, or ``remote.left_plus``. Raises
    DescriptionError if the robot has no such button that a program may read."""
    if task.client is not None:
        raise DescriptionError(
            f"the robot of {task.id} runs a program of your own, which answers no button; omit it"
        )
    channel: WatchedButton | WatchedRemoteButton = WatchedButton(button)
    if button.startswith(_OF_REMOTE):
        channel = WatchedRemoteButton(button.removeprefix(_OF_REMOTE))
    channel.check(task.robot)
    channels = (*task.interface.channels, channel)
    return replace(task, interface=replace(task.interface, channels=channels))
