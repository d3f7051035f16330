"""Random faults, one after the other, on one hub. For more of them set ``BRICKSRL_FAULTS``, for example to 1000."""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable

from ble_world import World
from radio import ATT_NOTIFICATION, ATT_WRITE_REQUEST, ATT_WRITE_RESPONSE, Fault

from bricksrl.errors import HubError
from bricksrl.hub.link import HubLink, LinkState
from bricksrl.hub.pybricks_profile import Command, CommandError, Event

FAULTS = int(os.environ.get("BRICKSRL_FAULTS", "6"))
CALL_BOUND_S = 5.0
RECOVERY_BOUND_S = 15.0
_OUTPUT = (ATT_NOTIFICATION, Event.WRITE_STDOUT)


def some(rng: random.Random, kinds: tuple[int, ...], result: Callable[[bytes], int | bytes]) -> Fault:
    """A rule that treats a third of the packets of some kinds so."""
    return lambda opcode, data: result(data) if opcode in kinds and rng.random() < 1 / 3 else 1


def flip(rng: random.Random) -> Fault:
    """Flips one bit in a third of the program's output."""

    def rule(opcode: int, data: bytes) -> int | bytes:
        if (opcode, data[3] if len(data) > 3 else -1) != _OUTPUT or rng.random() > 1 / 3:
            return 1
        place = rng.randrange(4, len(data))
        return data[:place] + bytes((data[place] ^ 1 << rng.randrange(8),)) + data[place + 1 :]

    return rule


def drop_link(world: World, rng: random.Random) -> Fault:
    """Breaks the link at some packet from now on."""
    left = rng.randrange(1, 30)

    def rule(_opcode: int, _data: bytes) -> int:
        nonlocal left
        left -= 1
        if left == 0:
            world.radio.disconnect()
        return int(left > 0)

    return rule


def busy(world: World, rng: random.Random) -> None:
    code = rng.choice([CommandError.BUSY, CommandError.INVALID_COMMAND])
    world.hub.faults[rng.choice(list(Command))] = [code] * rng.choice([1, 3, 100])


def away(world: World) -> None:
    world.radio.leave()


def inflict(world: World, rng: random.Random) -> str:
    """One fault, of a random kind; its name."""
    kinds: dict[str, Callable[[], object]] = {
        "lost notifications": lambda: world.fault(some(rng, (ATT_NOTIFICATION,), lambda _: 0)),
        "duplicated notifications": lambda: world.fault(some(rng, (ATT_NOTIFICATION,), lambda _: 2)),
        "flipped bits": lambda: world.fault(flip(rng)),
        "lost acknowledgements": lambda: world.fault(some(rng, (ATT_WRITE_RESPONSE,), lambda _: 0)),
        "lost commands": lambda: world.fault(some(rng, (ATT_WRITE_REQUEST,), lambda _: 0)),
        "refusals": lambda: busy(world, rng),
        "disconnection": lambda: world.fault(drop_link(world, rng)),
        "out of reach": lambda: away(world),
        "reboot": world.hub.reboot,
        "button": world.hub.press_button,
    }
    name = rng.choice(list(kinds))
    kinds[name]()
    return name


def use(link: HubLink, rng: random.Random) -> None:
    """What an environment does: open, read, a few steps, perhaps close."""
    link.open()
    link.read()
    for _ in range(rng.randrange(5)):
        reading = link.act([rng.uniform(-3000, 3000)])
        assert reading.values[1] == 0, "a motor that nobody moves has moved: a frame was decoded wrongly"
    if rng.random() < 0.3:
        link.close()


def test_a_marathon_of_faults(world: World) -> None:
    rng = random.Random(5)
    link = world.link(timeout_s=4.0)
    link.open()
    for number in range(FAULTS):
        if rng.random() < 0.5:
            link.act([3000])
        start_s = time.monotonic()
        name = f"fault {number}, {inflict(world, rng)}"
        try:
            use(link, rng)
        except HubError:
            if link.state is not LinkState.DISCONNECTED:
                assert link.state is LinkState.FAULT, name
            world.hub.wait_until("is_driven", False, link.statistics.watchdog_s + 0.2)
        assert time.monotonic() - start_s < 2 * CALL_BOUND_S, name
        world.fault(None)
        world.hub.faults.clear()
        world.radio.come_back()
        start_s = time.monotonic()
        while True:  # what a training does: open it again after each failure
            try:
                link.open()
                link.act([100])
                break
            except HubError:
                link.close()
                assert time.monotonic() - start_s < RECOVERY_BOUND_S, name
        assert world.hub.is_running, name
