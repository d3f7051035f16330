"""Endings of pages, plays, teams and trainings, drawn by a seed: what is left of each afterwards,
and how long it takes.

    python -m benchmarks endings

Each trial starts a command, with a browser's connection where it has a page, and ends it in one of
the ways of :data:`WAYS`. Then all processes that descend from it are counted, wherever they are in
the tree, and the ports of its pages. A virtual robot is in one of these processes: its motors turn
for as long as that lives. What is not over after :data:`HANG_S` is a hang. Linux only.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import select
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.session import Session
from brickhub.errors import BricksError

HANG_S = 20.0
_START_S, _POLL_S, _RESTS_S = 240.0, 0.02, 2.5
_MARK = "BRICKSRL_ENDINGS_TRIAL"
_URL = re.compile(r"live page: (\S+)")
_NO_SCREEN = {"DISPLAY": "", "WAYLAND_DISPLAY": "", "SSH_CONNECTION": "1"}

WAYS = {
    "INT": "Ctrl-C",
    "TERM": "SIGTERM",
    "HUP": "SIGHUP",
    "KILL": "SIGKILL of the command, whose processes are then orphans",
    "two INTs": "Ctrl-C twice, 0.2 s apart",
    "closed terminal": "the terminal that it was started in is closed",
    "frozen browser": "the browser does not read any more, then SIGTERM",
    "cut connection": "the browser's connection is reset while it drives, then SIGTERM",
    "frozen job": "a job of the start page is stopped by SIGSTOP, then SIGTERM to the page",
    "closed tab": "the visitor of the start page closes all tabs; the job is to end by itself",
}
_SIGNALS = ("INT", "TERM", "HUP", "KILL", "two INTs", "closed terminal")


@dataclass(frozen=True)
class Kind:
    """Kind of trial.

    Attributes:
        words: command.
        sign: text of its output after which it is at work.
        press: press on its start page that starts a job.
        ways: ways of its ending.
    """

    words: tuple[str, ...]
    sign: str
    press: tuple[str, str] | None = None
    ways: tuple[str, ...] = _SIGNALS


_PAGE, _BROWSERS = ("page",), ("frozen browser", "cut connection")
_OF_JOBS = (*_SIGNALS, *_BROWSERS, "frozen job", "closed tab")
_TRAIN = ("train", "RunAway-v0", "--no-film", "--episodes", "400")
KINDS = {
    "page, driven": Kind(_PAGE, "live page", ("drive", "Spinning-v0"), _OF_JOBS),
    "page, played": Kind(_PAGE, "live page", ("play", "Walker-v1"), _OF_JOBS),
    "page, a game": Kind(_PAGE, "live page", ("game", "Tag-v0"), _OF_JOBS),
    "page, training": Kind(
        _PAGE, "live page", ("train", "RunAway-v0"), (*_SIGNALS, *_BROWSERS, "frozen job")
    ),
    "page alone": Kind(_PAGE, "live page", None, (*_SIGNALS, *_BROWSERS)),
    "play": Kind(("play", "Walker-v1", "--page"), "live page", None, (*_SIGNALS, *_BROWSERS)),
    "play in the terminal": Kind(("play", "Walker-v1"), "episode 1 "),
    "drive": Kind(("drive", "Spinning-v0"), "live page", None, (*_SIGNALS, *_BROWSERS)),
    "team that plays": Kind(
        ("team", "Tag-v0", "--page"), "live page", None, (*_SIGNALS, *_BROWSERS)
    ),
    "team that trains": Kind(("team", "Tag-v0", "--copies", "32"), "step "),
    "training": Kind(_TRAIN, "return "),
    "training with a page": Kind((*_TRAIN, "--page"), "return ", None, (*_SIGNALS, *_BROWSERS)),
    "asynchronous training": Kind((*_TRAIN, "--asynchronous"), "return "),
    "fleet": Kind((*_TRAIN, "--robots", "2"), "return "),
    "seeds": Kind((*_TRAIN, "--seeds", "2"), "return "),
}


def _hear_hangup() -> None:
    """Let commands that start from here on be ended by a hang-up.

    A benchmark that was started with ``nohup`` ignores it, and its children would inherit that; a
    handler is not inherited.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda _number, _frame: None)


class Command:
    """Command in a process of its own, in a terminal of its own if ``has_terminal``; it is over
    with its context."""

    def __init__(self, words: Sequence[str], folder: Path, *, has_terminal: bool) -> None:
        self.mark = f"{os.getpid()}-{time.monotonic_ns()}"
        self.said = ""
        _hear_hangup()
        environment = {**os.environ, **_NO_SCREEN, _MARK: self.mark, "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-u", "-m", "bricksrl", *words]
        if has_terminal:
            pid, self._output = os.forkpty()
            if pid == 0:
                os.chdir(folder)
                os.execve(sys.executable, command, environment)  # noqa: S606  our own interpreter
            self.pid, self._process = pid, None
        else:
            self._output, write = os.pipe()
            self._process = subprocess.Popen(  # noqa: S603  our own interpreter
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=write,
                stderr=write,
                start_new_session=True,
            )
            os.close(write)
            self.pid = self._process.pid

    def __enter__(self) -> Command:
        return self

    def __exit__(self, *_: object) -> None:
        for pid in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.close_terminal()
        self.reap()

    def close_terminal(self) -> None:
        """Close what it writes to, which may be its terminal."""
        with contextlib.suppress(OSError):
            os.close(self._output)

    def listen(self) -> None:
        """Take what it has said meanwhile, so that it is never kept waiting."""
        with contextlib.suppress(OSError):
            while select.select([self._output], [], [], 0)[0] and (
                data := os.read(self._output, 65536)
            ):
                self.said += data.decode(errors="replace")

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for something. Raises BricksError if it does not come."""
        limit_s = time.monotonic() + _START_S
        while not condition():
            self.listen()
            if time.monotonic() > limit_s:
                raise BricksError(f"{what} did not come; the command said {self.said[-400:]!r}")
            time.sleep(_POLL_S)

    def reap(self) -> None:
        """Take the exit code of the process, if it has ended."""
        if self._process is not None:
            self._process.poll()
            return
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self.pid, os.WNOHANG)

    def processes(self) -> list[int]:
        """The processes that descend from it and have not ended, also those without a parent."""
        self.reap()
        wanted = f"{_MARK}={self.mark}".encode()
        found = []
        for entry in Path("/proc").iterdir():
            with contextlib.suppress(OSError, IndexError):
                if not entry.name.isdecimal() or wanted not in (
                    entry / "environ"
                ).read_bytes().split(b"\0"):
                    continue
                if (entry / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[
                    0
                ] != "Z":
                    found.append(int(entry.name))
        return found


@dataclass
class Browser:
    """Connection of a browser to a page, which tells it what it sees. ``status``: the last one."""

    url: str
    status: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        from websockets.sync.client import connect
        from websockets.typing import Origin

        host = self.url.split("/")[2]
        address = f"ws://{host}/ws?{urllib.parse.urlsplit(self.url).query}"
        self._socket = connect(
            address,
            origin=Origin(f"http://{host}"),
            compression=None,
            max_size=None,
            ping_interval=None,
        )

    def look(self) -> None:
        """Take what the page has said meanwhile."""
        with contextlib.suppress(TimeoutError):
            while True:
                message = self._socket.recv(timeout=0)
                if isinstance(message, str):
                    self.status = json.loads(message).get("status", self.status)

    def press(self, name: str, value: Any = None) -> None:
        """Press a button."""
        self._socket.send(json.dumps({"press": name, "value": value}))

    def reset(self) -> None:
        """End the connection without a word, as a broken network does."""
        # l_onoff, l_linger
        option = (1).to_bytes(4, sys.byteorder) + (0).to_bytes(4, sys.byteorder)
        self._socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, option)
        self._socket.socket.close()

    def close(self) -> None:
        """Close the tab."""
        self._socket.close(1001)  # as a browser does


def port_of(url: str) -> int:
    """Port of a page."""
    return urllib.parse.urlsplit(url).port or 80


def is_free(url: str) -> bool:
    """Whether a page is served no more; its port may be another program's by now, which does not
    know the token."""
    parts = urllib.parse.urlsplit(url)
    try:
        with urllib.request.urlopen(
            f"http://{parts.netloc}/visitors.json?{parts.query}", timeout=1.0
        ):
            return False
    except urllib.error.HTTPError as refusal:
        refusal.close()
        return True
    except TimeoutError:  # somebody listens, and does not answer
        return False
    except OSError as error:
        return not isinstance(getattr(error, "reason", None), TimeoutError)


def drawn(number: int, seed: int) -> tuple[str, str, float]:
    """Kind and way of a trial, and the seconds for which the command works before; each kind in
    turn."""
    rng = random.Random(f"{seed}-{number}")
    name = list(KINDS)[number % len(KINDS)]
    ways = KINDS[name].ways
    return name, ways[(number // len(KINDS) + rng.randrange(2)) % len(ways)], rng.uniform(0.0, 2.0)


def trial(number: int, seed: int) -> dict[str, Any]:
    """Start a command and end it; what was left."""
    name, way, delay_s = drawn(number, seed)
    kind = KINDS[name]
    # a shell in the background makes us, and so them, ignore it
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder = Path(tempfile.mkdtemp(prefix="bricksrl-ending-"))
    try:
        with Command(kind.words, folder, has_terminal=way == "closed terminal") as command:
            outcome = _end(command, kind, way, delay_s)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return {"kind": name, "way": way, **outcome}


def _end(command: Command, kind: Kind, way: str, delay_s: float) -> dict[str, Any]:
    command.wait_for(lambda: kind.sign in command.said, kind.sign)
    urls = _URL.findall(command.said)
    browsers = [Browser(url) for url in urls]
    job: Browser | None = None
    if kind.press is not None:
        browsers[0].press(*kind.press)
        job = Browser(_url_of_job(command, browsers[0]))
        urls.append(job.url)
        browsers.append(job)
    for _ in range(round(delay_s / 0.1)):
        time.sleep(0.1)
        command.listen()
        for browser in browsers:
            browser.look()
    rests = _rests(command, urls, browsers, way)
    ended_s = time.monotonic()
    _act(command, browsers, way)
    before = set(command.processes())
    limit_s = ended_s + HANG_S
    left, ports = _left(command, urls, way)
    while (left or ports) and time.monotonic() < limit_s:
        if way != "closed terminal":
            command.listen()
        time.sleep(_POLL_S)
        left, ports = _left(command, urls, way)
    return {
        "processes": len(before),
        "pages": len(urls),
        "seconds": round(time.monotonic() - ended_s, 2),
        "processes_left": len(left),
        "ports_left": len(ports),
        "rests": rests,
    }


def _url_of_job(command: Command, page: Browser) -> str:
    """Address of the page of the job that was started."""

    def has_page() -> bool:
        page.look()
        return any(job["url"] for job in page.status.get("jobs", ()))

    command.wait_for(has_page, "the page of the job")
    return next(str(job["url"]) for job in page.status["jobs"] if job["url"])


def _left(command: Command, urls: Sequence[str], way: str) -> tuple[list[int], list[int]]:
    """Processes and ports that are left; a start page whose job's tab was closed goes on by
    itself."""
    left = command.processes()
    if way != "closed tab":
        return left, [port_of(url) for url in urls if not is_free(url)]
    return [pid for pid in left if pid != command.pid], [
        port_of(url) for url in urls[1:] if not is_free(url)
    ]


def _rests(
    command: Command, urls: Sequence[str], browsers: Sequence[Browser], way: str
) -> bool | None:
    """Whether a robot comes to rest once the browser that drives it is cut off; ``None`` where none
    is driven so."""
    if way not in ("frozen browser", "cut connection"):
        return None
    page = browsers[-1]
    page.look()
    drive = page.status.get("drive")
    if drive is None or not drive.get("in_charge"):
        if way == "cut connection":
            page.reset()
        return None
    page.press("drive", [1.0] * len(drive["commands"]))
    time.sleep(0.3)
    if way == "cut connection":
        page.reset()
    other = Browser(urls[-1])
    limit_s = time.monotonic() + _RESTS_S
    while time.monotonic() < limit_s:
        other.look()
        command.listen()
        if other.status and not any(other.status["drive"]["pushes"]):
            return True
        time.sleep(_POLL_S)
    return False


def _act(command: Command, browsers: Sequence[Browser], way: str) -> None:
    """End the command."""
    match way:
        case "closed terminal":
            command.close_terminal()
        case "closed tab":
            for browser in browsers:
                browser.close()
        case "frozen job":
            os.kill(_job_of(command), signal.SIGSTOP)
            os.kill(command.pid, signal.SIGTERM)
        case "two INTs":
            os.kill(command.pid, signal.SIGINT)
            time.sleep(0.2)
            with contextlib.suppress(ProcessLookupError):
                os.kill(command.pid, signal.SIGINT)
        case "frozen browser" | "cut connection":
            os.kill(command.pid, signal.SIGTERM)
        case _:
            os.kill(command.pid, signal.Signals[f"SIG{way}"])


def _job_of(command: Command) -> int:
    """The process of the job of a start page."""
    for pid in command.processes():
        if b"bricksrl.cli.job" in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0"):
            return pid
    raise BricksError("the page has no job")


def summary(results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Counts over all trials, and the seconds until all had ended, by kind and by way."""
    rested = [result["rests"] for result in results if result["rests"] is not None]
    return {
        "trials": len(results),
        "processes": sum(result["processes"] for result in results),
        "processes_left": sum(result["processes_left"] for result in results),
        "ports_left": sum(result["ports_left"] for result in results),
        "hangs": sum(result["seconds"] >= HANG_S for result in results),
        "over_5_s": sum(
            result["seconds"] > 5.0 for result in results if result["way"] != "closed tab"
        ),
        "driven_robots_cut_off": len(rested),
        "of_which_came_to_rest": sum(rested),
        "seconds": _seconds(results),
        "by_kind": dict(_groups(results, "kind")),
        "by_way": dict(_groups(results, "way")),
    }


def _seconds(results: Sequence[dict[str, Any]]) -> dict[str, float]:
    seconds = [result["seconds"] for result in results]
    return {"median": round(statistics.median(seconds), 2), "max": max(seconds)}


def _groups(results: Sequence[dict[str, Any]], by: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, count in Counter(result[by] for result in results).items():
        yield (
            name,
            {"trials": count, **_seconds([result for result in results if result[by] == name])},
        )


def main(session: Session) -> None:
    """Make the trials, print what was left, and write the results."""
    args = session.parse(trials=200, seed=0)
    parts = {f"{number:03}": (number, args.seed) for number in range(args.trials)}
    results = []
    for result in session.outcomes(trial, parts, session.jobs or 1):
        results.append(result)
        print(f"{result}", flush=True)
    session.write({"seed": args.seed, **summary(results), "results": results})
