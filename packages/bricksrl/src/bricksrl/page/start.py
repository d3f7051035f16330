"""Start page: environments, runs, building plans and the hub check, without a command typed.

A press starts the command of its row in a process of its own. Values of presses are only chosen from names that the page knows.
"""

import contextlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from bricksrl.envs.arenas import ARENAS, arena_summary
from bricksrl.envs.registry import is_simulation, list_envs
from bricksrl.errors import BricksError, PageError
from bricksrl.page.board import Board
from bricksrl.page.server import PageOptions, PageServer, chosen
from bricksrl.policies.by_name import TRAINED
from bricksrl.training.config import MAX_NAME
from bricksrl.training.run_folder import RunFolder
from bricktwin.robots import ROBOTS

_MAX_JOBS, _MAX_LINES, _MAX_RUNS, _MAX_POINTS, _LAST_EPISODES = 12, 60, 30, 60, 5
_REFRESH_S, _END_S = 1.0, 8.0
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
    "train": Action("environment", ("train",), ("--page",), is_alone=False),
    "game": Action("arena", ("team",), ("--page",)),
    "watch": Action("run", ("play",), ("--page",)),
    "compare": Action("run", ("compare",), out="png", has_page=False, is_alone=False),
    "class": Action("class", ("compare", "--class"), has_page=False, is_alone=False),
    "build": Action("plan", ("plan", "show")),
    "booklet": Action("plan", ("plan", "steps"), out="pdf", has_page=False, is_alone=False),
    **{
        f"check {hub}": Action("environment", ("hub", "check"), ("--hub", hub, "--yes"), has_page=False)
        for hub in ("virtual", "ble", "usb")
    },
}
_RUN_FILES = {"report.html": "text/html; charset=utf-8", "before_after.mp4": "video/mp4"}
"""What can be taken home of a run."""
_OUTPUTS = {"png": "image/png", "pdf": "application/pdf"}
Launch = Callable[[Sequence[str], Path], "subprocess.Popen[str]"]


def launch(words: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    """Start a command of ``bricksrl`` in a folder, with all that it says on one pipe; Ctrl-C does not reach it."""
    return subprocess.Popen(  # noqa: S603  our own interpreter
        [sys.executable, "-u", "-m", "bricksrl", *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


@dataclass
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
        with self.process:
            for line in self.process.stdout or ():
                if (match := _PAGE_LINE.search(line)) is not None:
                    self.url = match[1]
                else:
                    self.lines.append(line.rstrip())

    def end(self) -> None:
        """Ask it to end, and kill it if it does not."""
        self.process.terminate()
        try:
            self.process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self.reader.join()

    def described(self) -> dict[str, Any]:
        """What the page shows of it."""
        shown = {"number": self.number, "action": self.action, "about": self.about, "url": self.url, "lines": list(self.lines)}
        return shown | {"code": self.process.poll()}


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
        for job in self._jobs:
            job.end()
        super().close()
        if self._results is not None:
            shutil.rmtree(self._results, ignore_errors=True)

    def file(self, name: str) -> tuple[str, bytes] | None:
        """Files of the page, and results of its jobs."""
        results = {} if self._results is None else {path.name: path for path in self._results.iterdir()}
        folder, _, ending = name.removeprefix("runs/").partition("/")
        if ending in _RUN_FILES and folder in {run["name"] for run in self._runs()}:
            path = self._folder / "runs" / folder / ending
            return (_RUN_FILES[ending], path.read_bytes()) if path.exists() else None
        if name in results:
            return _OUTPUTS[name.rpartition(".")[2]], results[name].read_bytes()
        return super().file(name or "start.html")

    def _press(self, name: str, value: Any) -> None:
        message = ""
        try:
            if name == "end":
                self._end(job for job in self._jobs if job.number == value)
            elif name != "left":
                pupil = ""
                if name == "train" and isinstance(value, dict):
                    value, pupil = value.get("env"), _pupil(value.get("name"))
                self._begin(chosen("button", name, ACTIONS), value if isinstance(value, list) else [value], pupil)
        except BricksError as error:
            message = str(error)
        self.board.update_status(message=message)
        self._publish()

    def _end(self, jobs: Iterable[Job]) -> None:
        for job in jobs:
            job.end()

    def _begin(self, name: str, values: list[Any], pupil: str = "") -> None:
        """Start the command of an action for names. Raises PageError for those that the page does not know."""
        action, runs = ACTIONS[name], self._runs()
        known: dict[str, Iterable[str]] = {"environment": self._envs, "arena": ARENAS, "plan": self._plans, "class": ["runs"]}
        known["run"] = [run["name"] for run in runs]
        names = [chosen(action.kind, value, known[action.kind]) for value in values]
        number = 1 + max((job.number for job in self._jobs), default=0)
        words = [*action.words, *(f"runs/{one}" if action.kind == "run" else one for one in names), *action.options]
        words += ["--out", f"{self._results}/{number}.{action.out}"] if action.out else []
        words += ["--page-host", self._options.page_host] if action.has_page else []
        if name == "train":  # or the same run would come again
            words += ["--seed", f"{sum(run['env'] in names for run in runs)}"]
            words += [f"--name={pupil}"] if pupil else []
        if action.is_alone:
            self._end(job for job in self._jobs if ACTIONS[job.action].is_alone)
        job = Job(number, name, ", ".join(names), self._launch(words, self._folder))
        self._jobs = [*self._jobs, job][-_MAX_JOBS:]

    def _refresh(self) -> None:
        while not self._ended.wait(_REFRESH_S):
            self._publish()

    def _publish(self) -> None:
        self.board.update_status(jobs=[job.described() for job in self._jobs[::-1]], runs=self._runs())

    def _runs(self) -> list[dict[str, Any]]:
        """The runs in the folder, the latest first, with the mean return of the last episodes."""
        found = []
        configs = sorted(self._folder.glob("runs/*/config.json"), key=lambda path: path.stat().st_mtime, reverse=True)
        for config in configs[:_MAX_RUNS]:
            run = RunFolder(config.parent)
            with contextlib.suppress(BricksError):
                config, returns = run.read_config(), [episode.return_ for episode in run.read_episodes()]
                about = {"env": config.env, "agent": config.agent, "episodes": len(returns), "pupil": config.name}
                about |= {"seed": config.seed, "has_report": (run.path / "report.html").exists()}
                about |= {"has_film": (run.path / "before_after.mp4").exists()}
                points = returns[:: 1 + len(returns) // _MAX_POINTS]
                found.append({**about, **_scored(run, returns), "name": run.path.name, "points": points})
        return found


def _scored(run: RunFolder, returns: list[float]) -> dict[str, Any]:
    """The return that the page shows of a run, and what it is: of the evaluation, or else of the last episodes."""
    evaluation = run.own_evaluation(len(returns))
    if evaluation is not None:
        return {"return": evaluation["return_mean"], "score": "evaluation"}
    last = returns[-_LAST_EPISODES:]
    return {"return": sum(last) / len(last) if last else None, "score": f"mean of the last {_LAST_EPISODES} episodes"}


def _pupil(name: Any) -> str:
    """The name of who trains, as it was typed. Raises PageError if it is none."""
    if not isinstance(name, str) or len(name) > MAX_NAME or not name.isprintable():
        raise PageError(f"that is no name; give one line of up to {MAX_NAME} characters")
    return name.strip()
