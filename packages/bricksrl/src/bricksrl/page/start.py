"""Start page: environments, runs, building plans and the hub check, without a command typed.

A press starts the command of its row in a process of its own. Values of presses are only chosen from names that the page knows.
"""

import contextlib
import logging
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from bricksrl.envs.arenas import ARENAS, arena_summary
from bricksrl.envs.registry import is_simulation, list_envs
from bricksrl.errors import BricksError
from bricksrl.page.board import Board
from bricksrl.page.server import PageOptions, PageServer, chosen
from bricksrl.policies.by_name import TRAINED
from bricksrl.training.run_folder import RunFolder
from bricktwin.robots import ROBOTS

_MAX_JOBS, _MAX_LINES, _MAX_RUNS, _MAX_POINTS, _LAST_EPISODES = 12, 60, 30, 60, 5
_REFRESH_S, _END_S, _READ_S = 1.0, 4.0, 1.0
_log = logging.getLogger(__name__)
_PAGE_LINE = re.compile(r"live page: (\S+)")


@dataclass(frozen=True)
class Action:
    """Action of the page.

    Attributes:
        kind: kind of the names that it is for.
        words: its command, before and after the names.
        out: ending of the file that it writes.
        has_page, is_alone: whether it has a page of its own, and ends the one before.
    """

    kind: str
    words: tuple[str, ...]
    options: tuple[str, ...] = ()
    out: str = ""
    has_page: bool = True
    is_alone: bool = True


ACTIONS = {
    "play": Action("environment", ("play",), ("--page",)),
    "drive": Action("environment", ("drive",)),
    "train": Action("environment", ("train",), ("--page", "--no-film"), is_alone=False),
    "game": Action("arena", ("team",), ("--page",)),
    "watch": Action("run", ("play",), ("--page",)),
    "compare": Action("run", ("compare",), out="png", has_page=False, is_alone=False),
    "build": Action("plan", ("plan", "show")),
    "booklet": Action("plan", ("plan", "steps"), out="pdf", has_page=False, is_alone=False),
    **{
        f"check {hub}": Action("environment", ("hub", "check"), ("--hub", hub, "--yes"), has_page=False)
        for hub in ("virtual", "ble", "usb")
    },
}
_OUTPUTS = {"png": "image/png", "pdf": "application/pdf"}
Launch = Callable[[Sequence[str], Path], "subprocess.Popen[str]"]


def launch(words: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    """Start a command of ``bricksrl`` in a folder, with all that it says on one pipe; Ctrl-C does not reach it. It ends when its
    standard input does, which also happens if this process is killed."""
    return subprocess.Popen(  # noqa: S603  our own interpreter
        [sys.executable, "-u", "-m", "bricksrl.cli.job", *words],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )


@dataclass(eq=False)
class Job:
    """A command in a process of its own, with its lines, which it reads itself, and the address of its page."""

    number: int
    action: str
    about: str
    process: subprocess.Popen[str]
    url: str = ""
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_MAX_LINES))

    def __post_init__(self) -> None:
        self.reader = threading.Thread(target=self.listen, name="bricksrl-page-job", daemon=True)
        self.reader.start()

    def listen(self) -> None:
        """Read its lines until it ends."""
        for line in self.process.stdout or ():
            if (match := _PAGE_LINE.search(line)) is not None:
                self.url = match[1]
            else:
                self.lines.append(line.rstrip())
        self.process.wait()

    @property
    def is_running(self) -> bool:
        """Whether its process has not ended."""
        return self.process.poll() is None

    def ask_to_end(self) -> None:
        """Let its standard input end, at which it ends by itself."""
        with contextlib.suppress(OSError):
            if self.process.stdin is not None:
                self.process.stdin.close()

    def end_by(self, deadline_s: float) -> None:
        """Wait for its end until a monotonic time; then kill it."""
        try:
            self.process.wait(max(0.0, deadline_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.reader.join(_READ_S)  # a process that it has started may hold its output open

    def described(self) -> dict[str, Any]:
        """What the page shows of it."""
        shown = {"number": self.number, "action": self.action, "about": self.about, "url": self.url, "lines": list(self.lines)}
        return shown | {"code": self.process.poll()}


def end_jobs(jobs: Sequence[Job]) -> None:
    """End jobs, all at the same time."""
    for job in jobs:
        job.ask_to_end()
    deadline_s = time.monotonic() + _END_S
    for job in jobs:
        job.end_by(deadline_s)


def without_old(jobs: list[Job]) -> list[Job]:
    """The jobs without the oldest of those that have ended, where there are more than are shown.

    One that runs is always there, as it could not be ended otherwise.
    """
    surplus = len(jobs) - _MAX_JOBS
    ended = [job for job in jobs if not job.is_running][: max(0, surplus)]
    return [job for job in jobs if job not in ended]


class StartPage(PageServer):
    """Start page, served while entered; its jobs end with it.

    Args:
        folder: folder in which the commands run; their runs are in its folder ``runs``.
        options: address of this page and of those of its jobs.
        launch: starts the process of a command.
    """

    def __init__(self, folder: Path, options: PageOptions | None = None, launch: Launch = launch) -> None:
        super().__init__(Board(), self._press, lambda: None, options)
        self._folder, self._launch, self._jobs, self._ended = folder, launch, list[Job](), threading.Event()
        self._results: Path | None = None
        self._envs = {env_id: summary for env_id, summary in list_envs().items() if not is_simulation(env_id)}
        self._plans = list({robot.model: name for name, robot in reversed(ROBOTS.items()) if robot.model}.values())
        cards = [
            {"env": env_id, "summary": self._envs[env_id]} for env_id in sorted(self._envs, key=lambda one: one not in TRAINED)
        ]
        games = [{"env": env_id, "summary": arena_summary(env_id), "is_arena": True} for env_id in ARENAS]
        self.board.update_status(title="BricksRL", cards=[*cards, *games], plans=self._plans)
        self._publish()

    def __enter__(self) -> Self:
        super().__enter__()
        self._results = Path(tempfile.mkdtemp(prefix="bricksrl-page-"))
        self._start("bricksrl-page-jobs", self._refresh)
        return self

    def close(self) -> None:
        """End all jobs and stop serving."""
        self._ended.set()
        end_jobs(self._jobs)
        super().close()
        if self._results is not None:
            shutil.rmtree(self._results, ignore_errors=True)

    def file(self, name: str) -> tuple[str, bytes] | None:
        """Files of the page, and results of its jobs."""
        results = {} if self._results is None else {path.name: path for path in self._results.iterdir()}
        if name in results:
            return _OUTPUTS[name.rpartition(".")[2]], results[name].read_bytes()
        return super().file(name or "start.html")

    def _press(self, name: str, value: Any) -> None:
        message = ""
        try:
            if name == "end":
                end_jobs([job for job in self._jobs if job.number == value])
            elif name != "left":
                self._begin(chosen("button", name, ACTIONS), value if isinstance(value, list) else [value])
        except BricksError as error:
            message = str(error)
        self.board.update_status(message=message)
        self._publish()

    def _begin(self, name: str, values: list[Any]) -> None:
        """Start the command of an action for names. Raises PageError for those that the page does not know."""
        action, runs = ACTIONS[name], self._runs()
        known: dict[str, Iterable[str]] = {"environment": self._envs, "arena": ARENAS, "plan": self._plans}
        known["run"] = [run["name"] for run in runs]
        names = [chosen(action.kind, value, known[action.kind]) for value in values]
        number = 1 + max((job.number for job in self._jobs), default=0)
        words = [*action.words, *(f"runs/{one}" if action.kind == "run" else one for one in names), *action.options]
        words += ["--out", f"{self._results}/{number}.{action.out}"] if action.out else []
        words += ["--page-host", self._options.page_host] if action.has_page else []
        if name == "train":  # or the same run would come again
            words += ["--seed", f"{sum(run['env'] in names for run in runs)}"]
        if action.is_alone:
            end_jobs([job for job in self._jobs if ACTIONS[job.action].is_alone])
        job = Job(number, name, ", ".join(names), self._launch(words, self._folder))
        self._jobs = without_old([*self._jobs, job])

    def _refresh(self) -> None:
        while not self._ended.wait(_REFRESH_S):
            try:
                self._publish()
            except Exception as error:  # noqa: BLE001  the next time it may be right again
                _log.warning("the start page: %s", error)

    def _publish(self) -> None:
        self.board.update_status(jobs=[job.described() for job in self._jobs[::-1]], runs=self._runs())

    def _runs(self) -> list[dict[str, Any]]:
        """The runs in the folder, the latest first, with the mean return of the last episodes."""
        found = []
        configs = sorted(self._folder.glob("runs/*/config.json"), key=_changed_s, reverse=True)
        for config in configs[:_MAX_RUNS]:
            run = RunFolder(config.parent)
            with contextlib.suppress(BricksError, OSError):  # such as a run that is deleted now
                origin, returns = run.origin(), [episode.return_ for episode in run.read_episodes()]
                last = returns[-_LAST_EPISODES:]
                about = {"env": origin.env, "agent": origin.agent, "episodes": len(returns)}
                points = returns[:: 1 + len(returns) // _MAX_POINTS]
                found.append(
                    {**about, "name": run.path.name, "points": points, "return": sum(last) / len(last) if last else None}
                )
        return found


def _changed_s(path: Path) -> float:
    """Time of a file's last change; 0 if it has just been deleted."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
