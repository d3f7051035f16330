"""Room of several hubs in a tab, where each hub has a worker of its own.

A tab's Python has one stack, so programs that wait for one another need several of it. Each worker
has its own air and, for robots with bodies, its own copy of their world; they tell one another what
their hubs do, in the order of simulated time. A hub waits where it has to know what another one
does until then. The same deeds at the same times make the same world everywhere, to the last bit.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from brickhub.hub.program.marked import Marked, names_of
from brickhub.seed import derive_seed
from brickhub.virtual.air import DISTANCE_M, Air, Antenna, Message
from brickhub.virtual.machine import CONTROL_LOOP_MS, Machine
from bricktwin.site.tab.plain_values import plain, read_plain
from bricktwin.site.tab.robot_file import Draws
from bricktwin.twin.arena import SharedWorld, SharingBody, side_by_side
from bricktwin.twin.body import NoiseSources
from bricktwin.twin.engines.engine import Engine
from bricktwin.twin.hand import Hand
from bricktwin.twin.physics import Physics

_PATIENCE_MS = 20
"""Real time between two looks for what the page wants, while a hub waits for the others."""

Deed = list[Any]
"""What a hub has done: its kind, and values for JSON.

| kind | values |
|---|---|
| ``voltage`` | port, mV or nothing |
| ``pull`` | number of a body, x and y in m, or nothing: what the page's hand does |
| ``broadcast`` | ms, channel, message |
| ``until`` | ms: time of the world up to which the hub does nothing more |
| ``step`` | ms: control loop to which the hub has come |
| ``end`` | |
"""


class Others(Protocol):
    """The other workers, as one of them sees them."""

    def tell(self, deeds: str) -> None:
        """Send deeds to all of them: a JSON list."""

    def hear(self, number: int, longest_ms: int) -> str:
        """What hub ``number`` has told since the last call: a JSON list of lists of deeds, empty
        for none. Waits for it, at most so long."""


class Seat:
    """Place of one hub in the room, in its worker.

    Args:
        others: the other workers.
        number: of this hub.
        programs: names of all hubs' programs, by number.

    Attributes:
        on_wait: called again and again while the hub waits for the others.
    """

    def __init__(
        self,
        others: Others,
        number: int,
        programs: Sequence[str],
    ) -> None:
        self._others = others
        self._number = number
        self._name = names_of([Path(program) for program in programs])[number]
        self._told: list[Deed] = []
        self._world: SharedWorld[ToldBody] | None = None
        self.on_wait: Callable[[], None] = lambda: None
        self._antenna = _ToldAntenna(self._told)
        self._stand_ins: dict[int, _StandIn] = {}
        antennas: list[Antenna] = []
        for hub in range(len(programs)):
            if hub == number:
                antennas.append(self._antenna)
                continue
            stand_in = self._stand_ins[hub] = _StandIn(hub, partial(self._hear, hub))
            antennas.append(stand_in.antenna)
        self._air = Air(antennas, self._distance_m)
        self._marked: list[Marked] = []

    def marked(self, out: Any, mark: str | bytes, line_end: str | bytes) -> Marked:
        """A stream whose lines begin with the name of this hub's program and ``mark``."""
        name = self._name if isinstance(mark, str) else self._name.encode()
        stream = Marked(out, name + mark, line_end)  # type: ignore[operator]
        self._marked.append(stream)
        return stream

    def enter(self, world: SharedWorld[ToldBody]) -> ToldBody:
        """The body of this hub's robot in a world, which is this worker's copy of that of all."""
        self._world = world
        for number, body in enumerate(world.bodies):
            if number == self._number:
                body.on_voltage = lambda port, mv: self._told.append(["voltage", port, mv])
                body.on_advance = self._tell_until
                # It is not asked to run: what asks is this hub itself.
                world.runners.append(_stay)
            else:
                self._stand_ins[number].enter(world, body)
                world.runners.append(self._stand_ins[number].run)
        return world.bodies[self._number]

    def hand(self) -> RoomHand | None:
        """The page's hand in the world; ``None`` on a bench."""
        if self._world is None:
            return None
        return RoomHand(Hand(self._world.engine), self._told)

    def attend(self, machine: Machine) -> None:
        """Take the machine of this hub before its program begins."""
        machine.antenna = self._antenna
        # A limit of the run's own would be at this alarm.
        limit_ms = machine.alarm_ms
        on_limit = machine.on_alarm

        def step() -> None:
            time_ms = machine.time_ms
            if limit_ms is not None and time_ms >= limit_ms:
                on_limit()
            self._meet(time_ms)
            set_alarm(time_ms + CONTROL_LOOP_MS)

        def set_alarm(next_ms: int) -> None:
            machine.alarm_ms = next_ms if limit_ms is None else min(next_ms, limit_ms)

        machine.on_alarm = step
        set_alarm(CONTROL_LOOP_MS)

    def leave(self) -> None:
        """Tell the others that this hub's program has ended."""
        for stream in self._marked:
            stream.end()
        self._told.append(["end"])
        self._tell()

    def _meet(self, time_ms: int) -> None:
        """Wait until all hubs have come to this control loop, and let them hear one another."""
        self._told.append(["step", time_ms])
        self._tell()
        for stand_in in self._stand_ins.values():
            stand_in.come_to(time_ms)
        self._air.carry(time_ms)

    def _tell_until(self, time_ms: int) -> None:
        self._told.append(["until", time_ms])
        self._tell()

    def _tell(self) -> None:
        self._others.tell(json.dumps(self._told))
        self._told.clear()

    def _hear(self, number: int) -> list[Deed]:
        """The next deeds of a hub; waits for them."""
        while True:
            text = self._others.hear(number, _PATIENCE_MS)
            if text:
                return [deed for deeds in json.loads(text) for deed in deeds]
            self.on_wait()

    def _distance_m(self, one: int, other: int) -> float:
        if self._world is None:
            return DISTANCE_M
        return self._world.distance_m(one, other)


class _StandIn:
    """Another hub of the room: does here what it has done in its worker.

    Args:
        number: of the hub.
        hear: returns its next deeds.
    """

    def __init__(self, number: int, hear: Callable[[], list[Deed]]) -> None:
        self._number = number
        self._hear = hear
        self._deeds: deque[Deed] = deque()
        self._until_ms = 0
        self._step_ms = 0
        self._has_ended = False
        self.antenna = Antenna()
        self._world: SharedWorld[ToldBody] | None = None
        self._body: ToldBody | None = None
        self._hand: Hand | None = None

    def enter(self, world: SharedWorld[ToldBody], body: ToldBody) -> None:
        """Take its robot's body in the world of this worker."""
        self._world = world
        self._body = body
        self._hand = Hand(world.engine)

    def run(self, time_ms: int) -> None:
        """Do what it has done up to a time of the world; as of ``SharedWorld.runners``."""
        world = self._world
        if world is None:
            return
        while not self._has_ended:
            if self._until_ms >= time_ms:
                return
            if self._until_ms > world.time_ms:
                world.advance_for(self._number, self._until_ms)
            self._do_next()

    def come_to(self, time_ms: int) -> None:
        """Do what it has done up to a control loop."""
        while self._step_ms < time_ms and not self._has_ended:
            self._do_next()

    def _do_next(self) -> None:
        if not self._deeds:
            self._deeds.extend(self._hear())
        kind, *values = self._deeds.popleft()
        match kind:
            case "voltage":
                if self._body is not None:
                    self._body.set_voltage(*values)
            case "pull":
                if self._hand is not None:
                    _pull(self._hand, values)
            case "broadcast":
                time_ms, channel, message = values
                self.antenna.broadcast(time_ms, channel, read_plain(message))
            case "until":
                (self._until_ms,) = values
            case "step":
                (self._step_ms,) = values
            case "end":
                self._has_ended = True


class _ToldAntenna(Antenna):
    """Antenna of whose broadcasts the others are told."""

    def __init__(self, told: list[Deed]) -> None:
        super().__init__()
        self._told = told

    def broadcast(self, time_ms: int, channel: int, message: Message | None) -> None:
        super().broadcast(time_ms, channel, message)
        self._told.append(["broadcast", time_ms, channel, plain(message)])


class ToldBody(SharingBody):
    """Body of whose deeds the others are told, if it is that of this worker's hub.

    Attributes:
        on_voltage: called with port and mV before a voltage is applied.
        on_advance: called with a time in ms before the world is asked to come there.
    """

    on_voltage: Callable[[str, int | None], None] | None = None
    on_advance: Callable[[int], None] | None = None

    def set_voltage(self, port: str, voltage_mv: int | None) -> None:
        if self.on_voltage is not None:
            self.on_voltage(port, voltage_mv)
        super().set_voltage(port, voltage_mv)

    def advance_to(self, time_ms: int) -> None:
        if self.on_advance is not None:
            self.on_advance(time_ms)
        super().advance_to(time_ms)


class RoomHand:
    """Hand of this worker's page, of which the others are told; lets go of what it has pulled."""

    def __init__(self, hand: Hand, told: list[Deed]) -> None:
        self._hand = hand
        self._told = told
        self._pulls = False

    def let_go(self) -> None:
        """Pull nothing any more. What others pull is theirs."""
        if self._pulls:
            self._pulls = False
            self._do([])

    def pull(self, body: int, x_m: float, y_m: float) -> None:
        """Pull a body, by its number in the model, towards a point."""
        self._pulls = True
        self._do([body, x_m, y_m])

    def _do(self, values: list[float]) -> None:
        self._told.append(["pull", *values])
        _pull(self._hand, values)


def _pull(hand: Hand, values: Sequence[Any]) -> None:
    if values:
        hand.pull(*values)
    else:
        hand.let_go()


def _stay(_time_ms: int) -> None:
    """Runner of a hub that runs by itself."""


def shared_world(
    file: dict[str, Any],
    engine: Engine,
    seed: int = 0,
) -> SharedWorld[ToldBody]:
    """World of several robots' file, where they stand as ``bricktwin run`` puts them.

    Args:
        file: as of ``put_together``, or such a one with another scene.
        engine: engine of the file's model.
        seed: seed of the sensors' noise.
    """
    arena = side_by_side(read_plain(file["robots"]), read_plain(file["scene"]))
    noises = []
    for number in range(len(arena.robots)):
        noises.append(
            NoiseSources(
                readings=Draws(derive_seed(seed, "readings", number)),
                heading=Draws(derive_seed(seed, "heading", number)),
            )
        )
    world = SharedWorld(arena, engine, ToldBody, Physics(), noises)
    world.place(Draws(derive_seed(seed, "start")))
    return world
