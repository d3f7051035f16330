"""Emergency stop from another thread, over the simulated radio and on the virtual hub."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest
from ble_world import BOUND_S, World, bounded
from described import SPINNING, TWO_WHEELER
from radio import ATT_WRITE_REQUEST, ATT_WRITE_RESPONSE
from stopping import SLOW_STEP, Act, eventually, held, patient_link

from brickhub.errors import HubDisconnectedError, StoppedError
from brickhub.hub.link.lockstep import HubLink
from brickhub.hub.link.states import LinkState
from brickhub.hub.link.streaming import StreamingLink
from brickhub.hub.transports.profile import PybricksCommand
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.virtual_transport import VirtualHub

pytestmark = pytest.mark.realtime


def test_motors_stop_with_the_next_connection_event(world: World) -> None:
    link = patient_link(world, SLOW_STEP)
    step = Act(link)
    world.hub.wait_until("is_driven", True)
    time.sleep(0.1)  # its write has been acknowledged: the step waits for the answer
    with held(world) as connection_event:
        stopper = threading.Thread(target=link.emergency_stop)
        stopper.start()
        eventually(world, ATT_WRITE_REQUEST, PybricksCommand.STOP_USER_PROGRAM)
        assert world.hub.is_driven
        connection_event()
        world.hub.wait_until("is_driven", False)
    for thread in (step, stopper):
        thread.join(BOUND_S)
        assert not thread.is_alive()
    assert isinstance(step.error, StoppedError) and not world.hub.is_running
    assert world.hub.commands.count(PybricksCommand.STOP_USER_PROGRAM) == 1


def test_stop_follows_pending_write(world: World) -> None:
    """Bluetooth allows one pending write: the stop follows its acknowledgement."""
    link = patient_link(world, SLOW_STEP)
    with held(world) as connection_event:
        step = Act(link)
        eventually(world, ATT_WRITE_REQUEST, PybricksCommand.WRITE_STDIN)
        stopper = threading.Thread(target=link.emergency_stop)
        stopper.start()
        time.sleep(0.05)
        connection_event()
        world.hub.wait_until("is_driven", True)
        eventually(world, ATT_WRITE_RESPONSE)
        assert not world.radio.link.waits(ATT_WRITE_REQUEST, PybricksCommand.STOP_USER_PROGRAM)
        connection_event()
        eventually(world, ATT_WRITE_REQUEST, PybricksCommand.STOP_USER_PROGRAM)
        assert world.hub.is_driven
        connection_event()
        world.hub.wait_until("is_driven", False)
    for thread in (step, stopper):
        thread.join(BOUND_S)
        assert not thread.is_alive()
    assert isinstance(step.error, StoppedError)


def test_nothing_moves_until_release(world: World) -> None:
    link = world.link()
    link.open()
    link.act([1000])
    link.emergency_stop()
    assert not world.hub.is_running
    for call in (link.open, link.read, link.rest, lambda: link.act([100])):
        with pytest.raises(StoppedError, match="by hand; release it"):
            call()
    assert not world.hub.is_running and not world.hub.is_driven
    link.release()
    link.open()
    link.act([100])
    assert world.hub.is_running


def test_stop_during_program_start(world: World) -> None:
    """The program may start after the stop: it is stopped again."""
    link = world.link(SLOW_STEP)
    start, stopped = link._transport.start, threading.Event()

    def start_and_be_stopped(program: object) -> None:
        threading.Thread(target=lambda: [link.emergency_stop(), stopped.set()]).start()
        assert stopped.wait(BOUND_S)
        start(program)

    link._transport.start = start_and_be_stopped
    with pytest.raises(StoppedError):
        link.open()
    world.hub.wait_until("is_running", False)
    assert link.state is LinkState.FAULT


def test_stop_out_of_reach_relies_on_watchdog(world: World) -> None:
    link = world.link()
    link.open()
    link.act([3000])
    world.radio.leave()
    bounded(link.emergency_stop, HubDisconnectedError)
    world.hub.wait_until("is_driven", False, 1.0)
    with pytest.raises(StoppedError):
        link.open()


@pytest.fixture
def virtual() -> Iterator[HubLink]:
    with HubLink(VirtualHub(BenchBody(TWO_WHEELER)), TWO_WHEELER, SPINNING) as link:
        yield link


def test_virtual_hub_stops_from_other_thread(virtual: HubLink) -> None:
    hub = virtual._transport
    virtual.act([100, 100])
    moving = [servo for servo in hub.machine.servos.values() if servo.control.is_active]
    assert len(moving) == 2
    thread = threading.Thread(target=virtual.emergency_stop)
    thread.start()
    thread.join(BOUND_S)
    with pytest.raises(StoppedError):
        virtual.act([100, 100])
    virtual.release()
    virtual.open()
    virtual.act([100, 100])


def test_streaming_link_stops_and_rests() -> None:
    hub = VirtualHub(BenchBody(TWO_WHEELER))
    with StreamingLink(hub, TWO_WHEELER, SPINNING) as link:
        link.act([100, 100])
        link.rest()
        assert not any(servo.control.is_active for servo in hub.machine.servos.values())
        link.act([100, 100])
        thread = threading.Thread(target=link.emergency_stop)
        thread.start()
        thread.join(BOUND_S)
        with pytest.raises(StoppedError):
            link.act([100, 100])
        link.release()
        link.open()
        link.act([100, 100])


def test_stop_during_answer(virtual: HubLink) -> None:
    hub = virtual._transport
    write = hub.write

    def write_and_stop(data: bytes) -> None:
        write(data)
        thread = threading.Thread(target=virtual.emergency_stop)
        thread.start()
        thread.join(BOUND_S)

    hub.write = write_and_stop
    with pytest.raises(StoppedError):
        virtual.act([100, 100])
    assert not any(servo.is_open for servo in hub.machine.servos.values()), (
        "the program has ended, the motors coast"
    )


def test_rest_stops_motors_not_program(virtual: HubLink) -> None:
    hub = virtual._transport
    virtual.act([100, 100])
    assert virtual.state is LinkState.ARMED
    virtual.rest()
    assert virtual.state is LinkState.READY
    assert not any(servo.control.is_active for servo in hub.machine.servos.values())
    still = virtual.read().values[:2]
    for _ in range(5):
        hub.machine.advance(100)
        again = virtual.read().values[:2]
    assert again == pytest.approx(still, abs=5)
    virtual.act([50, 50])
    assert virtual.state is LinkState.ARMED


def test_release_without_a_stop_changes_nothing(virtual: HubLink) -> None:
    virtual.act([10, 10])
    virtual.release()
    assert virtual.state is LinkState.ARMED
    virtual.act([10, 10])
