"""Run of a program in a tab: ``brickhub run`` with the page in place of the terminal."""

import io
import json
import re
import shutil
import signal
from collections.abc import Mapping
from contextlib import chdir, closing, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, TextIO, cast

from brickhub.errors import BricksError, MediumUnavailableError, UnknownNameError
from brickhub.hub.program.program_files import ProgramFiles
from brickhub.hub.program.run_program import imports
from brickhub.hub.transport import HubProgram
from brickhub.kits.radio import LEGO_PACKAGE
from brickhub.user_devices import load_own_device
from brickhub.user_files import without_name
from brickhub.virtual.body import Body
from brickhub.virtual.machine import Machine, Pace
from brickhub.virtual.own_devices import AnyOwnDevice, OwnDeviceOf
from brickhub.virtual.run import Operation, interruptible, run_file
from bricktwin.site.tab.js_engine import JsEngine
from bricktwin.site.tab.person import Person
from bricktwin.site.tab.recorder import FRAME_MS, Page, Recorder
from bricktwin.site.tab.room import Others, Seat, shared_world

FOLDER = Path("/programs")
"""Where the page's programs are while one of them runs."""
REFUSED_EXIT_CODE = 2
"""Exit code of a run that cannot begin, as of the command."""
STOPPED_EXIT_CODE = 130
_ON_PORT = re.compile(r"(?m)^# Port: *(\w+=[\w.-]+\.py(?::\w+)?) *$")


def heed_stops_in_runs_only() -> None:
    """Let the page's interrupt end nothing but a program that runs.

    One that comes late, as the program has ended by itself meanwhile, would end the tab's Python.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class ProgramOutput:
    """A stream of the program, of which the page is told as it comes."""

    def __init__(self, recorder: Recorder, kind: str) -> None:
        self.recorder = recorder
        self._kind = kind

    def write(self, data: bytes | str, /) -> int:
        # Bytes of any kind, one character each: what is no text stays what it is.
        text = data if isinstance(data, str) else data.decode("latin-1")
        self.recorder.tell(self._kind, text=text)
        return len(data)

    def flush(self) -> None:
        """Nothing is kept here: the recorder posts what it has in time."""


class _TabPace(Pace):
    """Keeps simulated time to the page's clock, and lets the person at the page act meanwhile."""

    def __init__(
        self,
        page: Page,
        recorder: Recorder,
        person: Person,
    ) -> None:
        super().__init__()
        self._page = page
        self._recorder = recorder
        self._person = person

    def keep(self, time_ms: float) -> None:
        self._person.act()
        if time_ms % FRAME_MS:
            return
        self._recorder.frame()
        self._person.obey(self._page.take())
        is_posted = False
        while not self._page.may_go_on(int(time_ms)):
            # What has happened so far is to be seen while the hub waits.
            if not is_posted:
                self._recorder.post()
                is_posted = True
            self._person.obey(self._page.take())


def run_in_room(
    request_text: str,
    page: Page,
    others: Others,
    file: dict[str, Any] | None = None,
    handle: Any = None,
) -> int:
    """Run the program of one of several hubs, each in a worker of its own; returns the exit code.

    Args:
        request_text: JSON as of `run_in_tab`, with ``seat``: ``number`` of the hub, and
            ``programs`` of all of them.
        page: the page.
        others: the other workers.
        file: of the robots that share a world; ``None`` for benches.
        handle: ``Engine`` of ``engine.js`` that was made of the same file.
    """
    place = json.loads(request_text)["seat"]
    seat = Seat(others, place["number"], place["programs"])
    body = None
    if file is not None:
        body = seat.enter(shared_world(file, JsEngine(handle)))
    return run_in_tab(request_text, page, body, seat)


def run_in_tab(
    request_text: str,
    page: Page,
    body: Body | None = None,
    seat: Seat | None = None,
) -> int:
    """Run one of the page's programs to its end; returns the exit code.

    Args:
        request_text: JSON with ``files`` (text by name), the ``name`` of the one to run,
            ``readings`` (port, sense, value), ``stdin`` and ``time_limit_s``.
        page: the page.
        body: the robot; ``None`` for the bench.
        seat: place in a room of several hubs; ``None`` for a hub alone.
    """
    request = json.loads(request_text)
    recorder = Recorder(page)
    errors = cast("TextIO", ProgramOutput(recorder, "err"))
    output = cast("BinaryIO", ProgramOutput(recorder, "out"))
    write_programs(request["files"])

    def attend(machine: Machine) -> None:
        machine.panel.is_watched = True
        person = Person(machine, None if seat is None else seat.hand())
        person.set_readings(request["readings"])
        machine.pace = _TabPace(page, recorder, person)
        recorder.begin(machine)
        if seat is not None:
            seat.attend(machine)
            seat.on_wait = partial(_wait_for_others, page, recorder, person)

    def tell(line: str) -> None:
        recorder.tell("note", text=f"{line}\n")

    source = request["files"].get(request["name"], "")
    try:
        with closing(ProgramFiles(output, FOLDER, tell)) as files, interruptible():
            path = FOLDER / request["name"]
            time_limit_s = request.get("time_limit_s")
            operation = Operation(attend=attend, own_devices=own_devices(source, request["files"]))
            if seat is not None:
                # As in a terminal: what several hubs print is marked, and saved by nobody.
                code = run_file(
                    path,
                    body,
                    stdout=cast("BinaryIO", seat.marked(output, b": ", b"\n")),
                    stderr=cast("TextIO", seat.marked(errors, ": ", "\n")),
                    time_limit_s=time_limit_s,
                    operation=operation,
                )
            elif is_for_kits(source):
                with redirect_stdout(TextOutput(output)):
                    code = _run_kit(path, body, errors, time_limit_s, operation)
            else:
                code = run_file(
                    path,
                    body,
                    stdout=cast("BinaryIO", files),
                    stderr=errors,
                    stdin=io.StringIO(request["stdin"]) if request.get("stdin") else None,
                    time_limit_s=time_limit_s,
                    operation=operation,
                )
    except BricksError as error:
        recorder.tell("err", text=f"error: {error}\n")
        code = REFUSED_EXIT_CODE
    except KeyboardInterrupt:
        recorder.tell("err", text="The program was stopped (SystemExit).\n")
        code = STOPPED_EXIT_CODE
    finally:
        if seat is not None:
            seat.leave()
        recorder.frame()
        tell_written(request["files"], recorder)
        recorder.post()
    return code


def own_devices(source: str, files: Mapping[str, str]) -> dict[str, AnyOwnDevice | OwnDeviceOf]:
    """Devices of the user's own that a program names, by port, in lines such as ``# Port:
    A=my_device.py:GAUGE``; the same as ``--port`` of a command. They are written in other files of
    the page.

    Raises UnknownNameError if there is none, and DescriptionError as `load_own_device`.
    """
    found = {}
    for text in _ON_PORT.findall(source):
        _, _, reference = text.partition("=")
        name = without_name(reference)
        if name not in files:
            raise UnknownNameError(
                f"'# Port: {text}' names a file that is not on this page; open {name}, or write it "
                "(New program, Rename)"
            )
        # Where the page's files are while a program runs.
        with chdir(FOLDER):
            port, device = load_own_device(text)
        found[port] = device
    return found


def _wait_for_others(
    page: Page,
    recorder: Recorder,
    person: Person,
) -> None:
    """Called while a hub waits for the others of its room."""
    # What has happened so far is to be seen while the hub waits.
    recorder.post()
    person.obey(page.take())


def is_for_kits(source: str) -> bool:
    """Whether a program is for LEGO's kits of 2026."""
    return imports(HubProgram(source, 0), LEGO_PACKAGE)


class TextOutput(io.TextIOBase):
    """Standard output of a program that runs in this very Python."""

    def __init__(self, output: BinaryIO) -> None:
        super().__init__()
        self._output = output

    def write(self, text: str, /) -> int:
        self._output.write(text.encode())
        return len(text)


def _run_kit(
    path: Path,
    body: Body | None,
    errors: TextIO,
    time_limit_s: float | None,
    operation: Operation,
) -> int:
    """Run a program for LEGO's package. Raises MediumUnavailableError if the site lacks it."""
    from brickhub.kits.kit_run import run_kit_file
    from bricktwin.site.tab.kit_in_tab import OneThreadKit

    try:
        return run_kit_file(
            path,
            body,
            stderr=errors,
            time_limit_s=time_limit_s,
            operation=operation,
            kit_class=OneThreadKit,
        )
    except MediumUnavailableError:
        raise MediumUnavailableError(
            "this site has no package legoeducation, which is LEGO's (BUSL-1.1, for non-commercial "
            "use); make it with `bricktwin site --kits`, or run the program with `brickhub run`"
        ) from None


def write_programs(files: Mapping[str, str]) -> None:
    """Put the page's programs, and nothing else, into their folder."""
    with suppress(FileNotFoundError):
        shutil.rmtree(FOLDER)
    FOLDER.mkdir(parents=True)
    for name, source in files.items():
        file = FOLDER / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(source, encoding="utf-8")


def tell_written(files: Mapping[str, str], recorder: Recorder) -> None:
    """Hand over files that the program has written."""
    for path in sorted(FOLDER.rglob("*")):
        name = path.relative_to(FOLDER).as_posix()
        if path.is_file() and name not in files:
            recorder.tell("file", name=name, text=path.read_bytes().decode("latin-1"))
