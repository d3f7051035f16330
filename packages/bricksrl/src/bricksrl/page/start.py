"""Start page: environments, runs, building plans and the hub check, without a command typed.

A press starts the command of its row in a process of its own. Values of presses are only chosen
from names that the page knows.
"""

import contextlib
import json
import logging
import os
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import urllib.parse
import urllib.request
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from brickhub.cli.descendants import kill_frozen
from brickhub.cli.ending import DEADLINE_S
from brickhub.files import quoted
from brickhub.user_files import without_folder
from bricksrl.child_process import own_python
from bricksrl.envs.arenas import ARENAS, arena_summary
from bricksrl.envs.registry import is_simulation, list_envs
from bricksrl.errors import BricksError, PageError, UntrustedError
from bricksrl.page.board import Board
from bricksrl.page.drawings import Drawings
from bricksrl.page.server import PageOptions, PageServer, chosen
from bricksrl.page.visitors import Seats, Visitor
from bricksrl.policies.by_name import TRAINED
from bricksrl.training.run_folder import RunFolder
from bricktwin.plans.booklet.committed import committed_booklet
from bricktwin.robots import ROBOTS
from bricktwin.robots.planned import plan_file

_MAX_JOBS = 12
_MAX_LINES = 60
_MAX_RUNS = 30
_MAX_POINTS = 60
_LAST_EPISODES = 5
_REFRESH_S = 1.0
_READ_S = 0.5
_ANSWER_S = 0.5
_END_S = 4.0
"""Time that a job has to end."""
_CLOSE_S = DEADLINE_S - 1.5
"""The same at the end of the page, whose own process has not much longer."""
_MAX_ROBOTS = 6
"""Robots of all visitors at a time."""
_DESERTED_S = 5.0
"""Time after which a play ends whose tabs were closed."""
_ASLEEP_S = 120.0
"""Time after which a play ends that nobody has looked at yet, or whose connections broke."""
_DIRECTLY = urllib.request.build_opener(urllib.request.ProxyHandler({}))
"""Opener of pages of this computer, to which a school's proxy, which the system or a variable
names, knows no way."""
_log = logging.getLogger(__name__)
_PAGE_LINE = re.compile(r"live page: (\S+)")


@dataclass(frozen=True)
class Action:
    """Action of the page.

    Attributes:
        kind: kind of the names that it is for.
        words: its command, before and after the names.
        out: ending of the file that it writes.
        has_page, is_alone: whether it has a page of its own, and ends the one before of the same
            visitor.
    """

    kind: str
    words: tuple[str, ...]
    options: tuple[str, ...] = ()
    out: str = ""
    has_page: bool = True
    is_alone: bool = True

    @property
    def ends_alone(self) -> bool:
        """Whether it ends when nobody looks any more; a training goes on."""
        return self.has_page and self.is_alone


ACTIONS = {
    "play": Action("environment", ("play",), ("--page",)),
    "drive": Action("environment", ("drive",)),
    "train": Action(
        "environment",
        ("train",),
        ("--page",),
        is_alone=False,
    ),
    "game": Action("arena", ("team",), ("--page",)),
    "watch": Action("run", ("play",), ("--page",)),
    "compare": Action(
        "run",
        ("compare",),
        out="png",
        has_page=False,
        is_alone=False,
    ),
    "class": Action(
        "class",
        ("compare", "--class"),
        has_page=False,
        is_alone=False,
    ),
    "look": Action(
        "drawing",
        ("learn",),
        ("--look", "--json"),
        has_page=False,
        is_alone=False,
    ),
    "teach": Action(
        "goal",
        ("learn",),
        ("--page",),
        is_alone=False,
    ),
    "build": Action("plan", ("plan", "show")),
    "booklet": Action(
        "plan",
        ("plan", "steps"),
        out="pdf",
        has_page=False,
        is_alone=False,
    ),
}
for _hub in ("virtual", "ble", "usb"):
    _options = ("--hub", _hub, "--yes")
    ACTIONS[f"check {_hub}"] = Action(
        "environment",
        ("hub", "check"),
        _options,
        has_page=False,
    )
REAL_HUB = ("check ble", "check usb")
"""Actions that one visitor can do at a time."""
_RUN_FILES = {"report.html": "text/html; charset=utf-8", "before_after.mp4": "video/mp4"}
"""What can be taken home of a run."""
_OUTPUTS = {"png": "image/png", "pdf": "application/pdf"}
Launch = Callable[[Sequence[str], Path], "subprocess.Popen[str]"]


def launch(words: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    """Start a command of ``bricksrl`` in a folder, with all that it says on one pipe; Ctrl-C does
    not reach it. It ends when its standard input does, which also happens if this process is
    killed."""
    command, variables = own_python(
        "-u",
        "-m",
        "bricksrl.cli.job",
        *words,
    )
    # Windows would take the encoding of the country.
    variables["PYTHONIOENCODING"] = "utf-8"
    # A group of its own, so that a Ctrl-C in the terminal is for the page, which ends its jobs.
    return subprocess.Popen(  # noqa: S603  our own interpreter
        command,
        cwd=folder,
        env=variables,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
    )


@dataclass(eq=False)
class Job:
    """A command in a process of its own, with its lines, which it reads itself, and the address of
    its page.

    Attributes:
        owner: the visitor who has started it.
        why: why it was ended, if it was.
        empty_s: monotonic time since which nobody is there who looks at it.
        is_seen: whether somebody has looked at its page.
    """

    number: int
    action: str
    about: str
    process: subprocess.Popen[str]
    owner: Visitor | None = None
    url: str = ""
    why: str = ""
    empty_s: float | None = None
    is_seen: bool = False
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_MAX_LINES))

    def __post_init__(self) -> None:
        self.reader = threading.Thread(
            target=self.listen,
            name="bricksrl-page-job",
            daemon=True,
        )
        self.reader.start()

    def listen(self) -> None:
        """Read its lines until it ends."""
        with self.process:
            for line in self.process.stdout or ():
                if (match := _PAGE_LINE.search(line)) is not None:
                    self.url = match[1]
                else:
                    self.lines.append(line.rstrip())

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
            # While they can still be found by their ancestor.
            kill_frozen(self.process.pid)
            self.process.kill()
            self.process.wait()
        # What it has left in its group, such as a process that was frozen.
        if hasattr(os, "killpg"):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.reader.join(_READ_S)

    def described(self) -> dict[str, Any]:
        """What the page shows of it."""
        shown = {
            "number": self.number,
            "action": self.action,
            "about": self.about,
            "url": self.url,
            "lines": list(self.lines),
        }
        owner = "" if self.owner is None else self.owner.name
        return shown | {"code": self.process.poll(), "owner": owner, "why": self.why}

    def visitors(self) -> dict[str, Any]:
        """Who looks at its page: what `Visitors.described` says; empty if it does not answer."""
        parts = urllib.parse.urlsplit(self.url)
        address = f"http://{parts.netloc}/visitors.json?{parts.query}"
        try:
            with _DIRECTLY.open(address, timeout=_ANSWER_S) as answer:
                found: dict[str, Any] = json.load(answer)
        except (OSError, ValueError):
            return {}
        return found


def end_jobs(jobs: Sequence[Job], within_s: float = _END_S) -> None:
    """End jobs, all at the same time; kill those that have not ended in time, such as frozen
    ones."""
    for job in jobs:
        job.ask_to_end()
    deadline_s = time.monotonic() + within_s
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

    def __init__(
        self,
        folder: Path,
        options: PageOptions | None = None,
        launch: Launch = launch,
    ) -> None:
        super().__init__(
            Board(),
            self._press,
            lambda: None,
            options,
        )
        self._folder = folder
        self._launch = launch
        self._jobs = list[Job]()
        self._ended = threading.Event()
        self._seats = Seats(holds_several=True)
        self._drawings = Drawings(folder)
        self._results: Path | None = None
        # A kinematic simulation has no robot to look at.
        self._envs = {}
        for env_id, summary in list_envs().items():
            if not is_simulation(env_id):
                self._envs[env_id] = summary
        # Several robots may have one plan, which is shown under the first one's name.
        plans: dict[str, str] = {}
        for name, robot in reversed(ROBOTS.items()):
            if robot.model:
                plans[robot.model] = name
        self._plans = list(plans.values())
        # What is drawn already is opened at once, and not drawn anew.
        self._booklets: dict[str, Path] = {}
        for model, name in plans.items():
            plan = plan_file(model)
            booklet = None if plan is None else committed_booklet(plan)
            if booklet is not None:
                self._booklets[name] = booklet
        # Those that can be played at once, as a policy comes with them, stand first.
        cards: list[dict[str, Any]] = []
        for env_id in sorted(self._envs, key=lambda name: name not in TRAINED):
            cards.append({"env": env_id, "summary": self._envs[env_id]})
        for env_id in ARENAS:
            cards.append({"env": env_id, "summary": arena_summary(env_id), "is_arena": True})
        self.board.update_status(
            title="BricksRL",
            folder=_short(folder),
            cards=cards,
            plans=self._plans,
            booklets=list(self._booklets),
        )
        self._publish()

    def __enter__(self) -> Self:
        super().__enter__()
        self._results = Path(tempfile.mkdtemp(prefix="bricksrl-page-"))
        self._start("bricksrl-page-jobs", self._refresh)
        return self

    def close(self) -> None:
        """End all jobs and stop serving."""
        self._ended.set()
        end_jobs(self._jobs, _CLOSE_S)
        super().close()
        if self._results is not None:
            shutil.rmtree(self._results, ignore_errors=True)

    def file(self, name: str) -> tuple[str, bytes] | None:
        """Files of the page, and results of its jobs."""
        results = {}
        if self._results is not None:
            results = {path.name: path for path in self._results.iterdir()}
        # Only of runs that the page shows: a name from a browser is never joined to a path.
        folder, _, file_name = name.removeprefix("runs/").partition("/")
        if file_name in _RUN_FILES and folder in {run["name"] for run in self._runs()}:
            path = self._folder / "runs" / folder / file_name
            if not path.exists():
                return None
            return _RUN_FILES[file_name], path.read_bytes()
        booklet = self._booklets.get(name.removeprefix("booklets/").removesuffix(".pdf"))
        if booklet is not None and name.startswith("booklets/"):
            return _OUTPUTS["pdf"], booklet.read_bytes()
        if name in results:
            return _OUTPUTS[name.rpartition(".")[2]], results[name].read_bytes()
        return super().file(name or "start.html")

    def _press(
        self,
        name: str,
        value: Any,
        visitor: Visitor | None = None,
    ) -> None:
        message = ""
        try:
            match name:
                case "arrived" | "left" | "renamed":
                    pass
                case "end":
                    self._end_or_ask(value, visitor)
                case "answer":
                    self._answer_question(value, visitor)
                case _:
                    values = value if isinstance(value, list) else [value]
                    self._begin(chosen("button", name, ACTIONS), values, visitor)
        except BricksError as error:
            message = str(error)
        if visitor is None:
            self.board.update_status(message=message)
        elif message:
            # It concerns nobody else.
            visitor.note = message
        self._publish()

    def _end_or_ask(
        self,
        number: Any,
        visitor: Visitor | None,
    ) -> None:
        """End a job, after asking the visitor who has started it."""
        for job in self._jobs:
            if job.number != number or not job.is_running:
                continue
            if visitor is None or self._seats.ask(_seat(job), visitor):
                is_others = visitor is not None and job.owner not in (None, visitor)
                self._end([job], f"ended by {visitor.name}" if is_others and visitor else "")

    def _answer_question(
        self,
        value: Any,
        visitor: Visitor | None,
    ) -> None:
        """Answer of a visitor who was asked whether a job may end."""
        if visitor is None or not isinstance(value, list) or len(value) != 2:
            return
        for job in self._jobs:
            if _seat(job) != value[0]:
                continue
            asker = self._seats.answer(_seat(job), visitor, agrees=value[1] is True)
            if asker is not None:
                visitor.note = f"{job.about} was ended for {asker.name}, as you said yes."
                self._end([job], f"ended for {asker.name}")

    def _end(
        self,
        jobs: Sequence[Job],
        why: str,
    ) -> None:
        for job in jobs:
            job.why = why
        end_jobs(jobs)
        for job in jobs:
            self._seats.give_back(_seat(job))

    def _begin(
        self,
        name: str,
        values: list[Any],
        visitor: Visitor | None,
    ) -> None:
        """Start the command of an action for names; the robot that the visitor had before ends.
        Raises PageError for names that the page does not know, and where others have all robots, or
        the hub, already."""
        action = ACTIONS[name]
        runs = self._runs()
        known: dict[str, Iterable[str]] = {
            "environment": self._envs,
            "arena": ARENAS,
            "plan": self._plans,
            "drawing": self._drawings.names(),
            "goal": self._drawings.goals(),
            "class": ["runs"],
        }
        known["run"] = [run["name"] for run in runs]
        names = [chosen(action.kind, value, known[action.kind]) for value in values]
        number = 1 + max((job.number for job in self._jobs), default=0)
        places = [f"runs/{run}" for run in names] if action.kind == "run" else names
        words = [*action.words, *places, *action.options]
        if action.out:
            words += ["--out", f"{self._results}/{number}.{action.out}"]
        if action.has_page:
            words += ["--page-host", self._options.page_host]
        if name in ("train", "teach"):
            # Another seed than the runs before, or the same run would come again.
            seed = sum(without_folder(run["env"]) in names for run in runs)
            words += ["--seed", f"{seed}"]
            if visitor is not None and visitor.given_name:
                # In one word: a name may begin like an option.
                words.append(f"--name={visitor.given_name}")
        if action.is_alone:
            alone = [job for job in self._jobs if ACTIONS[job.action].is_alone and job.is_running]
            others = [job for job in alone if visitor is not None and job.owner is not visitor]
            self._check_room(name, others)
            self._end([job for job in alone if job not in others], "")
        job = Job(
            number,
            name,
            ", ".join(names),
            self._launch(words, self._folder),
            visitor,
        )
        if visitor is not None:
            self._seats.take(_seat(job), visitor)
        self._jobs = without_old([*self._jobs, job])

    def _check_room(
        self,
        name: str,
        others: Sequence[Job],
    ) -> None:
        """Raise PageError if the robots of others leave none for a visitor."""
        names = [job.owner.name if job.owner is not None else "somebody" for job in others]
        if len(others) >= _MAX_ROBOTS:
            owners = ", ".join(names)
            raise PageError(
                f"{len(others)} robots are at work already ({owners}); end one of them, or "
                "ask for it"
            )
        for job, owner in zip(others, names, strict=True):
            if name in REAL_HUB and job.action == name:
                raise PageError(f"{owner} checks a hub; wait for its end, or ask for it")

    def _end_deserted(self) -> None:
        """End plays whose visitors have closed all tabs. A phone that sleeps, whose connection
        broke, has two minutes."""
        for job in self._jobs:
            is_play = job.is_running and job.url and ACTIONS[job.action].ends_alone
            if not is_play or job.owner is None:
                continue
            seen = job.visitors()
            now_s = time.monotonic()
            # A page that does not answer is busy, and its visitors are taken to be there.
            if not seen or job.owner.key in seen["here"]:
                # The visitor is not away, but in another tab, at the robot.
                job.owner.left_s = now_s
                if self._seats.holder(_seat(job)) is None:
                    self._seats.take(_seat(job), job.owner)
            # A tab may have come and gone since the last look.
            job.is_seen = job.is_seen or bool(seen.get("came"))
            if seen.get("here") or job.owner.tabs or not seen:
                job.empty_s = None
                continue
            job.empty_s = job.empty_s or now_s
            # A closed tab is closed; a phone in a pocket, or a page that is still loading, comes.
            may_return = not job.is_seen or job.owner.is_asleep or seen["asleep"]
            if now_s - job.empty_s > (_ASLEEP_S if may_return else _DESERTED_S):
                self._end([job], "ended, as all its tabs were closed")

    def _tick(self) -> None:
        self._seats.refresh()
        self._publish()

    def _refresh(self) -> None:
        while not self._ended.wait(_REFRESH_S):
            try:
                self._end_deserted()
                self._publish()
            except Exception as error:  # noqa: BLE001  the next time it may be right again
                _log.warning("the start page: %s", error)

    def _publish(self) -> None:
        runs, untrusted = self._runs_and_untrusted()
        self._take_looks()
        jobs = [job.described() for job in reversed(self._jobs)]
        self.board.update_status(
            jobs=jobs,
            runs=runs,
            untrusted=untrusted,
            drawings=self._drawings.described(),
        )
        self.board.update_status(**self._seats.described())

    def _take_looks(self) -> None:
        """Show what was found in a drawing, or why it cannot be read, beside it, and the job no
        more."""
        for job in list(self._jobs):
            has_said_all = not job.is_running and not job.reader.is_alive()
            if job.action != "look" or not has_said_all:
                continue
            if job.process.returncode == 0:
                self._drawings.take(job.about, job.lines)
            else:
                last = job.lines[-1] if job.lines else "it was ended"
                self._drawings.fail(job.about, last.removeprefix("error: "))
            self._jobs.remove(job)

    def _runs(self) -> list[dict[str, Any]]:
        """The runs in the folder, the latest first, with the mean return of the last episodes."""
        return self._runs_and_untrusted()[0]

    def _runs_and_untrusted(self) -> tuple[list[dict[str, Any]], list[dict[str, str]]]:
        """The runs; and those that need trust before they are read, with the command for it."""
        found = []
        untrusted = []
        paths = sorted(self._folder.glob("runs/*/config.json"), key=_changed_s, reverse=True)
        for path in paths[:_MAX_RUNS]:
            run = RunFolder(path.parent)
            # A run may be damaged, or be deleted just now: the others are shown.
            with contextlib.suppress(BricksError, OSError):
                try:
                    config = run.read_config()
                except UntrustedError:
                    place = quoted(Path("runs") / run.path.name)
                    untrusted.append({"name": run.path.name, "allow": f"bricksrl trust {place}"})
                    continue
                returns = [episode.return_ for episode in run.read_episodes()]
                # Every second, third, ... return, as a small curve needs no more.
                points = returns[:: 1 + len(returns) // _MAX_POINTS]
                about = {
                    "name": run.path.name,
                    "env": config.env,
                    "agent": config.agent,
                    "episodes": len(returns),
                    "pupil": config.name,
                    "seed": config.seed,
                    "has_report": (run.path / "report.html").exists(),
                    "has_film": (run.path / "before_after.mp4").exists(),
                    "points": points,
                }
                found.append({**about, **_scored(run, returns)})
        return found, untrusted


def _seat(job: Job) -> str:
    """Name under which a job is held."""
    return f"{job.about} (job {job.number})"


def _short(folder: Path) -> str:
    """A folder's path as its owner says it: from the home folder."""
    path = folder.resolve()
    home = Path.home()
    return f"~/{path.relative_to(home)}" if path.is_relative_to(home) else str(path)


def _changed_s(path: Path) -> float:
    """Time of a file's last change; 0 if it has just been deleted."""
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _scored(run: RunFolder, returns: list[float]) -> dict[str, Any]:
    """The return that the page shows of a run, and what it is: of the evaluation, or else of the
    last episodes."""
    evaluation = run.own_evaluation(len(returns))
    if evaluation is not None:
        return {"return": evaluation["return_mean"], "score": "evaluation"}
    last = returns[-_LAST_EPISODES:]
    return {
        "return": sum(last) / len(last) if last else None,
        "score": f"mean of the last {_LAST_EPISODES} episodes",
    }
