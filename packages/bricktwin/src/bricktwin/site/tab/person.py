"""Person at the page, who acts while a program runs: sets what sensors of the bench sense, presses
buttons, pulls the robot, stops the program."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from brickhub.robot import Sense
from brickhub.virtual.bench_body import FittedBench
from brickhub.virtual.machine import Machine
from brickhub.virtual.run import stop_program
from bricktwin.site.tab.room import RoomHand
from bricktwin.twin.body import TwinBody
from bricktwin.twin.hand import Hand


class Person:
    """Person beside a machine; called from within its time.

    Args:
        hand: by which robots are pulled; by default one of its own, if there is a body.
    """

    def __init__(self, machine: Machine, hand: Hand | RoomHand | None = None) -> None:
        self._machine = machine
        body = machine.body
        if hand is None and isinstance(body, TwinBody):
            hand = Hand(body.engine)
        self._hand = hand
        self._pulled: tuple[int, float, float] | None = None

    def obey(self, messages: str) -> None:
        """Do what the page has sent: a JSON list of messages, or nothing."""
        if messages:
            for message in json.loads(messages):
                self._do(message)

    def _do(self, message: Mapping[str, Any]) -> None:
        match message["kind"]:
            case "reading":
                self.set_readings([message["reading"]])
            case "press":
                self._machine.panel.hold(message["button"])
            case "release":
                self._machine.panel.release(message["button"])
            case "pull":
                self._pulled = (message["body"], *message["at"])
            case "let go":
                self._pulled = None
            case "stop":
                stop_program()

    def act(self) -> None:
        """Pull what is held; in each control loop, as a hand does not let go in between."""
        hand = self._hand
        if hand is None:
            return
        if self._pulled is None:
            hand.let_go()
        else:
            hand.pull(*self._pulled)

    def set_readings(self, readings: Iterable[tuple[str, str, Any]]) -> None:
        """Let sensors of the bench sense what is given by port and sense."""
        bench = self._machine.body
        if not isinstance(bench, FittedBench):
            return
        for port, sense, value in readings:
            stimulus = tuple(value) if isinstance(value, list) else float(value)
            bench.set_reading(port, Sense(sense), stimulus)
