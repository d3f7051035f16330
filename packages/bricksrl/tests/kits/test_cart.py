"""Tasks on the cart of LEGO's kits, through LEGO's package."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

import bricksrl
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.registry import get_task
from bricksrl.errors import DescriptionError, UnknownNameError
from bricksrl.teleoperation import DRIVERS, ControllerPad
from bricktwin.robots import CART
from bricktwin.twin.make_body import make_body

TASKS = ("LineFollow-v0", "Park-v0", "Spinning-v0")


@pytest.mark.parametrize("env_id", TASKS)
def test_task_is_the_same_on_the_cart(env_id: str) -> None:
    own, cart = get_task(env_id), get_task(env_id, robot="cart")
    assert cart.robot is CART
    assert (cart.interface, cart.entries, cart.max_steps) == (
        own.interface,
        own.entries,
        own.max_steps,
    )


def test_other_robot_is_refused() -> None:
    with pytest.raises(DescriptionError, match="choose scout or cart"):
        get_task("LineFollow-v0", robot="walker")


@pytest.fixture(params=TASKS)
def cart(request: pytest.FixtureRequest) -> Iterator[torch.nn.Module]:
    """A task on the virtual cart."""
    pytest.importorskip("legoeducation")
    env = bricksrl.make(request.param, seed=0, robot="cart")
    yield env
    env.close()


def test_episodes_are_reproducible(cart: torch.nn.Module) -> None:
    runs = []
    for _ in range(2):
        cart.set_seed(1)
        torch.manual_seed(1)
        runs.append(cart.rollout(10)["next", "observation"])
    assert torch.equal(*runs)
    assert not torch.equal(runs[0][0], runs[0][-1])


def test_lost_step_is_data_and_the_run_goes_on(cart: torch.nn.Module) -> None:
    lost = [False]
    interface_of(cart).in_reach = lambda: not lost[0]
    frame = cart.rollout(5)[-1]["next"]
    lost[0] = True
    steps = 0
    while not frame["link_lost"]:
        frame = cart.step(cart.rand_action(frame.select("observation")))["next"]
        steps += 1
    assert frame["truncated"] and not frame["terminated"]
    assert steps * 0.05 < 1.5
    lost[0] = False
    assert not cart.rollout(5)["next", "link_lost"].any()


@pytest.mark.parametrize("options", [{"streaming": True}, {"app_data": True}])
def test_options_of_a_hub_are_refused(options: dict[str, bool]) -> None:
    with pytest.raises(DescriptionError, match="always stream"):
        bricksrl.make("Spinning-v0", robot="cart", **options).reset()


@pytest.mark.parametrize("hub", ["usb", "ble:pink-1", "ble:azure"])
def test_address_of_a_kit(hub: str) -> None:
    pytest.importorskip("legoeducation")
    with pytest.raises(UnknownNameError):
        bricksrl.make("Spinning-v0", robot="cart", hub=hub, place=lambda _: None).reset()


def test_controller_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("legoeducation")
    from brickhub.kits.lego_transport import VirtualTransport
    from brickhub.kits.virtual_devices import Controller
    from brickhub.kits.virtual_kit import VirtualKit

    kit = VirtualKit(make_body(CART))
    kit.attach()
    monkeypatch.setattr(VirtualTransport, "in_reach", [kit])
    controller = next(peer.device for peer in kit.peers if isinstance(peer.device, Controller))
    commands = [command.entry for command in get_task("LineFollow-v0").interface.commands]
    driver = kit.run(lambda: DRIVERS["controller"](commands))
    controller.levers_pct = (100, -50)
    kit.sleep(0.1)
    with driver:
        assert driver(torch.zeros(2)).tolist() == pytest.approx([1.0, -0.5], abs=0.01)


def test_controller_out_of_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("legoeducation")
    from brickhub.kits.lego_transport import VirtualTransport
    from brickhub.kits.virtual_kit import VirtualKit

    kit = VirtualKit(make_body(CART))
    kit.attach()
    kit.in_reach = lambda: False
    monkeypatch.setattr(VirtualTransport, "in_reach", [kit])
    with pytest.raises(bricksrl.errors.DataError, match="no Controller"):
        ControllerPad()
