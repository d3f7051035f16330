"""Real hub of a tab: connects, runs a program of the page, lets a robot learn; the very code that
does so on a computer, over the page's Bluetooth or cable."""

import io
import json
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import replace
from typing import Any, BinaryIO, TextIO, cast

from brickhub.errors import BricksError, HubError
from brickhub.hub.program.compile import check_program
from brickhub.hub.program.program_files import ProgramFiles
from brickhub.hub.program.run_program import load_program, run_program
from brickhub.hub.transports.connection import HubIdentity
from brickhub.hub.transports.profile import Status
from brickhub.robot import Robot
from bricktwin.site.tab.hub_lessons import HUB_LESSONS
from bricktwin.site.tab.hub_teaching import HubTeaching
from bricktwin.site.tab.hub_transport import WebTransport
from bricktwin.site.tab.recorder import Page, Recorder
from bricktwin.site.tab.robot_file import robot_in
from bricktwin.site.tab.run import (
    FOLDER,
    REFUSED_EXIT_CODE,
    STOPPED_EXIT_CODE,
    ProgramOutput,
    tell_written,
    write_programs,
)
from bricktwin.site.tab.web_port import HubPage

LOST_EXIT_CODE = 3
"""Exit code of a run whose link was lost."""


class RealHub:
    """The hub that the person at the page has connected.

    Args:
        hub_page: the page's Bluetooth and cable.
        page: the page. Beside the events of a program it is sent ``hub``: what is known of the hub.
    """

    def __init__(self, hub_page: HubPage, page: Page) -> None:
        self._recorder = Recorder(page)
        self._told: dict[str, Any] = {}
        self._transport = WebTransport(hub_page, self._look)
        self._is_stopped = False

    def obey(self, request_text: str, file: dict[str, Any] | None) -> int:
        """Do what the page asks for, until it is done; returns the exit code.

        Args:
            request_text: JSON with ``hub``: ``connect``, ``leave``, ``run`` (and what
                :func:`~bricktwin.site.tab.run.run_in_tab` takes) or ``teach`` (and what
                :func:`~bricktwin.site.tab.teach.teach_in_tab` takes); and ``by``: ``bluetooth``,
                which is usual, or ``cable``.
            file: the robot's, to teach it.
        """
        request = json.loads(request_text)
        self._is_stopped = False
        self._transport.by = request.get("by", "bluetooth")
        self._transport.on_person = self._on_person(self._transport.stop)
        try:
            return self._do(request, file)
        except HubError as error:
            self._recorder.tell("err", text=f"error: {error}\n")
            return STOPPED_EXIT_CODE if self._is_stopped else LOST_EXIT_CODE
        except BricksError as error:
            self._recorder.tell("err", text=f"error: {error}\n")
            return STOPPED_EXIT_CODE if self._is_stopped else REFUSED_EXIT_CODE
        finally:
            self._look()
            self._recorder.post()

    def attend(self) -> None:
        """Between two requests: take what has come of the hub."""
        self._transport.attend()
        self._look()
        self._recorder.post()

    def _do(self, request: Mapping[str, Any], file: dict[str, Any] | None) -> int:
        match request["hub"]:
            case "connect":
                self._transport.open()
            case "leave":
                self._transport.close()
            case "run":
                return self._run(request)
            case "teach":
                assert file is not None  # noqa: S101  the page has sent it
                return self._teach(request, file)
        return 0

    def _run(self, request: Mapping[str, Any]) -> int:
        recorder = self._recorder
        write_programs(request["files"])
        self._transport.open()
        program = load_program(FOLDER / request["name"])
        check_program(program, self._identity().kind)
        stdin = request.get("stdin")
        output = cast("BinaryIO", ProgramOutput(recorder, "out"))

        def tell(line: str) -> None:
            recorder.tell("note", text=f"{line}\n")

        try:
            with closing(ProgramFiles(output, FOLDER, tell)) as files:
                code = run_program(
                    self._transport,
                    program,
                    stdout=cast("BinaryIO", files),
                    stderr=cast("TextIO", ProgramOutput(recorder, "err")),
                    stdin=io.StringIO(stdin) if stdin else None,
                )
        finally:
            tell_written(request["files"], recorder)
        return STOPPED_EXIT_CODE if self._is_stopped else code

    def _teach(self, request: Mapping[str, Any], file: dict[str, Any]) -> int:
        self._transport.open()
        robot = _on_hub(robot_in(file), self._identity())
        teaching = HubTeaching(
            HUB_LESSONS[request["goal"]](robot),
            robot,
            self._transport,
            self._recorder,
        )
        self._transport.on_person = self._on_person(teaching.stop, teaching.go_on)
        try:
            teaching.run(request)
        finally:
            # Its motors stand; the hub stays connected for what comes next.
            with suppress(HubError):
                self._transport.stop()
        return STOPPED_EXIT_CODE if self._is_stopped else 0

    def _on_person(
        self,
        stop: Callable[[], None],
        go_on: Callable[[], None] = lambda: None,
    ) -> Callable[[str], None]:
        """What obeys the person at the page."""

        def obey(wish: str) -> None:
            if wish == "stop":
                self._is_stopped = True
                stop()
            else:
                go_on()

        return obey

    def _identity(self) -> HubIdentity:
        identity = self._transport.identity
        # It is connected here.
        assert identity is not None  # noqa: S101
        return identity

    def _look(self) -> None:
        """Tell the page what is new, also while something else waits."""
        state = self._state()
        if state != self._told:
            self._told = state
            self._recorder.tell("hub", **state)
        self._recorder.post_in_time()

    def _state(self) -> dict[str, Any]:
        """What the page is to know of the hub: ``connected``; ``name``, ``kind``, ``firmware``;
        ``battery``; ``running``, a program; ``stop``, what stops it."""
        connection = self._transport.connection
        if connection is None or not connection.is_connected:
            return {"connected": False}
        identity = connection.identity
        return {
            "connected": True,
            "name": identity.name,
            "type": identity.kind.value,
            "firmware": identity.firmware,
            "battery": _battery(connection.status.flags),
            "running": connection.is_running,
            "stop": self._transport.emergency_stop.hex(),
        }


def _battery(flags: Status) -> str:
    """What a hub says of its battery: no more than this."""
    if Status.BATTERY_EMPTY in flags:
        return "empty"
    return "low" if Status.BATTERY_LOW in flags else "charged"


def _on_hub(robot: Robot, identity: HubIdentity) -> Robot:
    """A robot as it is built on the connected hub, which may be of another kind than its
    description's. Raises DescriptionError if the hub lacks what the robot needs."""
    built = robot if robot.hub is identity.kind else replace(robot, hub=identity.kind)
    built.check_complete()
    return built
