"""Virtual robot of LEGO's kits: its devices behind LEGO's own package, in simulated or real time.

Three threads take turns. The package runs Bluetooth in a thread of its own, and so may the program
that uses it; the world runs in the thread that calls :meth:`VirtualKit.run` or
:meth:`VirtualKit.sleep`. Simulated time passes only while the program waits: for a command or in a
sleep. So a run is reproducible; a program that does neither for a while sees time pass as in
reality.
"""

import asyncio
import concurrent.futures
import math
import threading
from collections import deque
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from brickhub.errors import HubNotFoundError, HubTimeoutError
from brickhub.futures import settle
from brickhub.hub.link.profiles import LinkProfile
from brickhub.kits.kit_protocol import SUPERVISION_S
from brickhub.kits.radio import KitPart, lego_package, parts
from brickhub.kits.virtual_devices import KitDevice, devices_of
from brickhub.virtual.body import Body, Rng
from brickhub.virtual.faults import BreakingLink, FaultyBody
from brickhub.virtual.link_radio import PLACEMENT_MS, Radio
from brickhub.virtual.machine import CONTROL_LOOP_MS, Machine, Pace

if TYPE_CHECKING:
    from brickhub.virtual.virtual_transport import VirtualHub

_T = TypeVar("_T")
Delivery = tuple[Callable[[Any, bytes], Any], bytes]
"""A packet, and the function of LEGO's package that is given it."""
_IDLE_S = 1.0
"""Time without a call after which a program is taken to poll: long, as another program may have the
processor."""
_TURNS = 6
"""Turns of the package's loop in which a call that has its answer ends."""


class Peer:
    """Device as LEGO's package sees it: its name and address, and the packets on their way to it
    and back.

    They travel at connection events. ``lost_ms``: simulated time since which nothing gets through.
    ``seed``: of their delays.
    """

    def __init__(
        self,
        kit: "VirtualKit",
        device: KitDevice,
        seed: int,
    ) -> None:
        self.device = device
        self.name = device.name
        self.address = device.address
        self._kit = kit
        self._radio = Radio(seed)
        self._down: deque[tuple[float, bytes]] = deque()
        self._up: deque[tuple[float, bytes]] = deque()
        self._notify: Callable[[Any, bytes], Any] | None = None
        self._gone: Callable[[], None] = lambda: None
        self._lost_ms: int | None = None

    def __repr__(self) -> str:
        return f"{self.address}: {self.name}"

    # The methods from here on run in the thread of LEGO's package.

    def connect(
        self,
        notify: Callable[[Any, bytes], Any],
        gone: Callable[[], None],
    ) -> bool:
        """Connect; returns whether the device is in reach."""
        kit = self._kit
        with kit.awake:
            if not kit.in_reach():
                return False
            kit.loop = asyncio.get_running_loop()
            kit.package_thread = threading.get_ident()
            # What was on its way over an earlier link is lost with that link.
            self._down.clear()
            self._up.clear()
            self.device.connect()
            self._notify = notify
            self._gone = gone
            self._lost_ms = None
            kit.wake()
            return True

    def send(self, packet: bytes) -> None:
        """Send a packet, if the link is up."""
        kit = self._kit
        with kit.awake:
            kit.check_stopped()
            # The radio accepts a packet into a broken link and loses it silently.
            if kit.in_reach():
                due_ms = self._radio.to_hub_ms(kit.machine.time_ms, kit.link)
                self._down.append((due_ms, packet))
            kit.wake()

    def disconnect(self) -> None:
        """End the link from this side."""
        with self._kit.awake:
            notify = self._notify
            self._notify = None
            if self._kit.in_reach():
                self.device.disconnect()
        # The package's function is called outside of the lock, because nobody knows what it needs,
        # and only once for each connection.
        if notify is not None:
            self._gone()

    # The methods from here on run in the thread of the world.

    def exchange(self, now_ms: int) -> list[Delivery]:
        """Hand the device what has arrived, take what it sends, and return what has arrived at this
        computer."""
        device = self.device
        # A broken link stays lost, even if the device is in reach again.
        if not self._kit.in_reach() and self._lost_ms is None:
            self._lost_ms = now_ms
        is_lost = self._lost_ms is not None
        if self._lost_ms is not None and device.is_connected:
            # The device notices the loss only after this time, and goes on with its last command
            # until then.
            silent_ms = now_ms - self._lost_ms
            if silent_ms >= SUPERVISION_S * 1000:
                device.disconnect()
        # This is written out twice, because it runs for each device in each control step.
        while self._down and self._down[0][0] <= now_ms:
            _, packet = self._down.popleft()
            if device.is_connected and not is_lost:
                device.receive(packet)
        if device.is_connected:
            device.update()
        # All messages of a device share one connection event, and so one random delay.
        if device.outbox and not is_lost:
            due_ms = self._radio.to_computer_ms(now_ms, self._kit.link)
            for packet in device.outbox:
                self._up.append((due_ms, packet))
        device.outbox.clear()
        arrived: list[Delivery] = []
        notify = self._notify
        while self._up and self._up[0][0] <= now_ms:
            _, packet = self._up.popleft()
            if notify is not None and not is_lost:
                arrived.append((notify, packet))
        return arrived


class VirtualKit:
    """A virtual robot of LEGO's kits and its time.

    Args:
        body: a bench, or a twin of ``bricktwin.twin``.
        realtime: run in real time.
        sensor_ports: ports of its color sensors, if its description does not say so.
        link: delays and losses of its links; ``None`` for those of the body.
        seed: their seed.

    Attributes:
        peers: its devices.
        in_reach: set to False to break the link to all of them.
        awake: condition of what the threads share.
        loop, package_thread: event loop of LEGO's package, and its thread, since the first
            connection.
    """

    def __init__(
        self,
        body: Body,
        *,
        realtime: bool = False,
        sensor_ports: Iterable[str] | None = None,
        link: LinkProfile | None = None,
        seed: int = 0,
    ) -> None:
        self.robot = body.robot
        self.body = body
        self.machine = Machine(body)
        if sensor_ports is None:
            sensor_ports = [sensor.port for sensor in body.robot.sensors]
        kit_parts = parts(body.robot.hub, self.machine.servos, sensor_ports)
        devices = devices_of(self.machine, kit_parts)
        # Each device has its own link and seed, and no other seed may lead to the same ones.
        first_seed = seed * len(devices)
        self.peers = [
            Peer(self, device, first_seed + number) for number, device in enumerate(devices)
        ]
        self.in_reach: Callable[[], bool] = lambda: True
        self._link = link
        self.awake = threading.Condition()
        self.loop: asyncio.AbstractEventLoop | None = None
        self.package_thread: int | None = None
        self.is_realtime = realtime
        self._pace = Pace() if realtime else None
        self._sleepers: list[float] = []
        """Times (ms) at which sleeps of the program end."""
        self._events = 0
        """Number of things that the program has done."""
        self._idle = -1
        """That number when the program was last found to poll."""
        self._is_stopped = False

    def attach(self) -> None:
        """Let LEGO's package find virtual devices. Raises MediumUnavailableError if it is not
        installed."""
        # This comes before the imports of LEGO's package, whose failure would not say what to
        # install.
        lego_package()
        from legoeducation.ble_transport import register_transport

        from brickhub.kits.lego_transport import VirtualTransport

        register_transport(VirtualTransport)

    def search(self, part: KitPart) -> dict[str, Any]:
        """Arguments of ``connect`` in LEGO's package: the device itself. Raises HubNotFoundError if
        it is out of reach."""
        if not self.in_reach():
            raise HubNotFoundError(
                f"no {part.product.title} is in reach; switch it on, and bring it near"
            )
        for peer in self.peers:
            if peer.device.part == part:
                return {"device": peer}
        raise KeyError(part)

    def now_s(self) -> float:
        """Simulated time."""
        return self.machine.time_ms / 1000

    def reset(self, rng: Rng) -> None:
        """Place the robot at the start of an episode, which takes a second."""
        self.sleep(PLACEMENT_MS / 1000)
        self.body.reset(rng)

    @property
    def link(self) -> LinkProfile:
        """The link that was given, or the body's, of each device; no packet of theirs is lost for
        good."""
        return self._link or self.body.link

    def check_stopped(self) -> None:
        """Raise SystemExit in a program that is to end, at the time limit or by Ctrl-C."""
        if self._is_stopped:
            raise SystemExit

    # The methods from here on run in the thread that calls them, and move the world.

    def sleep(self, seconds: float) -> None:
        """Let the world go on for some time."""
        end_ms = self.machine.time_ms + seconds * 1000
        # In real time, the world also catches up with what happened outside of it.
        if self._pace is not None:
            end_ms = max(end_ms, self._pace.wall_ms())
        while self.machine.time_ms < end_ms:
            self._tick()

    def run(
        self,
        function: Callable[[], _T],
        limit_s: float | None = None,
    ) -> _T:
        """Run a function that uses LEGO's package, in a thread; the world goes on while it waits.
        Returns what it returns, and raises what it raises, HubTimeoutError after ``limit_s``."""
        future: concurrent.futures.Future[_T] = concurrent.futures.Future()

        def work() -> None:
            settle(future, function)
            # The end of the program is something that it does, so the world need not wait any
            # longer.
            with self.awake:
                self.wake()

        self._is_stopped = False
        limit_ms = math.inf
        if limit_s is not None:
            limit_ms = self.machine.time_ms + limit_s * 1000
        # A program that computes for ever cannot be ended, so its thread is a daemon.
        threading.Thread(
            target=work,
            name="program",
            daemon=True,
        ).start()
        try:
            while not future.done():
                self._go_on()
                if self.machine.time_ms >= limit_ms and not future.done():
                    raise HubTimeoutError(
                        f"nothing answered within {limit_s:g} s; check that the devices are on "
                        "and near"
                    )
        # Ctrl-C is caught too, because the motors of a program that is gone must not go on.
        except BaseException:
            self._stop_program()
            raise
        return future.result()

    def _go_on(self) -> None:
        """Let time pass if the program waits; else wait for what it does next, or if it does
        nothing, let real time pass."""
        events = self._events
        if self.is_realtime or self._sleepers or self._hand_over([]):
            self._tick()
            return
        # The program computes, or polls. Once it is found to poll, its time passes as in reality.
        patience_s = CONTROL_LOOP_MS / 1000 if self._idle == events else _IDLE_S
        with self.awake:
            if self.awake.wait_for(lambda: self._events != events, patience_s):
                return
        self._idle = events
        self._tick()

    def wake(self) -> None:
        """Tell the world that the program has done something; ``awake`` is held."""
        self._events += 1
        self.awake.notify_all()

    def step(self) -> list[Delivery]:
        """One control step of the world; returns what arrives at this computer in it."""
        with self.awake:
            machine = self.machine
            machine.advance(CONTROL_LOOP_MS - machine.time_ms % CONTROL_LOOP_MS)
            arrived: list[Delivery] = []
            for peer in self.peers:
                arrived += peer.exchange(machine.time_ms)
            self._sleepers = [due_ms for due_ms in self._sleepers if due_ms > machine.time_ms]
            self.awake.notify_all()
        return arrived

    def _tick(self) -> None:
        """One control step of the world, and what arrives in it."""
        arrived = self.step()
        # The lock is not held here, because the package's thread may need it for what it does next.
        if arrived:
            self._hand_over(arrived)
        if self._pace is not None:
            self._pace.keep(self.machine.time_ms)

    def _hand_over(self, arrived: list[Delivery]) -> int:
        """Give LEGO's package what has arrived; returns how many of its calls waited for something
        before and still do."""
        if self.loop is None or self.loop.is_closed():
            return 0

        async def deliver() -> int:
            before = asyncio.all_tasks()
            for notify, packet in arrived:
                await notify(None, packet)
            for _ in range(_TURNS):
                await asyncio.sleep(0)
            # This task itself is one of those counted, so it is taken off.
            return len(before & asyncio.all_tasks()) - 1

        return asyncio.run_coroutine_threadsafe(deliver(), self.loop).result()

    def _stop_program(self) -> None:
        with self.awake:
            self._is_stopped = True
            self.awake.notify_all()
        for peer in self.peers:
            peer.disconnect()

    # The methods from here on run in the program, in its thread.

    def wait(self, seconds: float) -> None:
        """``time.sleep`` of a program: the world goes on in its own thread."""
        # Within a notification nothing else can happen, because LEGO's package waits for its end.
        if threading.get_ident() == self.package_thread:
            return
        with self.awake:
            due_ms = self.machine.time_ms + seconds * 1000
            self._sleepers.append(due_ms)
            self.wake()
            while self.machine.time_ms < due_ms:
                self.check_stopped()
                self.awake.wait(1.0)


VirtualRobot: TypeAlias = "VirtualHub | VirtualKit"


def virtual_robot(
    body: Body,
    *,
    realtime: bool = False,
    link: LinkProfile | None = None,
    seed: int = 0,
) -> VirtualRobot:
    """The virtual hub, or the virtual devices of LEGO's kits, of a robot's body. ``link``: in place
    of the body's, with its random ``seed``."""
    # In a browser's tab there are no greenlets, of which a hub is made here.
    from brickhub.virtual.virtual_transport import VirtualHub

    make = VirtualHub if body.robot.hub.model.runs_programs else VirtualKit
    robot = make(
        body,
        realtime=realtime,
        link=link,
        seed=seed,
    )
    if isinstance(body, FaultyBody) and body.link_breaks_s is not None:
        robot.in_reach = BreakingLink(body.link_breaks_s, robot.now_s)
    return robot
