"""A button of the hub by which a person tells this computer something while the robot plays."""

from __future__ import annotations

import pytest
import torch

from brickhub.virtual.panel import Press
from bricksrl.envs import make
from bricksrl.errors import DescriptionError


def test_pressed_button_calls_once_and_is_not_observed() -> None:
    env = make("RunAway-v0", seed=3, watched_button="left")
    plain = make("RunAway-v0", seed=3)
    assert env.observation_spec == plain.observation_spec
    presses: list[int] = []
    env.on_button = lambda: presses.append(step)
    state = env.reset()
    panel = env.twin.machine.panel
    for step in range(6):
        # Held for three steps, and pressed again in the last one.
        if step in (1, 5):
            panel.hold("left")
        if step == 4:
            panel.release("left")
        state = env.step(state.set("action", torch.zeros(1)))["next"]
    assert (
        presses == [1, 5]
        and state["observation"].shape == plain.observation_spec["observation"].shape
    )
    # Held beyond the start of the next episode, it means the one before.
    state = env.reset()
    step = 6
    env.step(state.set("action", torch.zeros(1)))
    assert presses == [1, 5]
    for each in (env, plain):
        each.close()


def test_button_of_a_remote_is_watched() -> None:
    env = make("RunAway-v0", seed=3, watched_button="remote.left_plus")
    assert "Button.LEFT_PLUS in remote.buttons.pressed()" in env.task.hub_program.source
    env.close()


@pytest.mark.parametrize(
    ("env_id", "options", "says"),
    [
        ("RunAway-v0", {"watched_button": "center"}, "choose left, right, bluetooth"),
        ("RunAway-v0", {"watched_button": "remote.up"}, "the remote has no such button"),
        ("WalkerSim-v0", {"watched_button": "left"}, "is simulated without a hub; omit its button"),
        ("RunAway-v0", {"watched_button": "left", "copies": 2}, "copies have no buttons"),
        ("RunAway-v0", {"watched_button": "left", "arrays": True}, "omit arrays, or the rest"),
    ],
)
def test_buttons_that_nobody_can_watch_are_refused(
    env_id: str, options: dict[str, object], says: str
) -> None:
    with pytest.raises(DescriptionError, match=says):
        make(env_id, **options)  # type: ignore[call-overload]


def test_press_of_a_person_lasts_longer_than_a_step() -> None:
    """What the documentation asks for: one that is held for a step is always seen."""
    env = make("RunAway-v0", seed=3, watched_button="left")
    presses: list[int] = []
    env.on_button = lambda: presses.append(1)
    state = env.reset()
    machine = env.twin.machine
    step_s = 1.5 * env.task.interface.settle.longest_ms / 1000
    machine.panel.press(Press("left", machine.time_ms / 1000 + 0.05, step_s))
    for _ in range(4):
        state = env.step(state.set("action", torch.zeros(1)))["next"]
    assert presses == [1]
    env.close()
