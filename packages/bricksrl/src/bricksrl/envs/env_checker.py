"""Checker of environments and tasks: one finding for each part of an environment's contract."""

import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

import torch
from tensordict import TensorDictBase

from brickhub.finding import Finding, Outcome
from brickhub.hub.program.compile import check_program
from brickhub.user_lines import line_of_user
from bricksrl.envs.env import outside_text
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.make import make
from bricksrl.envs.registry import get_task
from bricksrl.envs.task import Task
from bricksrl.errors import BricksError, RenderingUnavailableError, an
from bricksrl.quiet import without_torchrl_notes

_STEPS = 5
"""Steps of a repeated episode, and of a batch that the task's functions get."""
_SEED = 7
_EPISODES = 3
"""Episodes of random actions whose values are looked at."""
_LONG = 10
"""Longest of these episodes, in steps, because a check is to take seconds."""
_MOST_SHOWN = 160
"""Largest number of characters that are shown of a library's message."""


class Broken(Exception):
    """A failed check; the message says what is wrong."""


class Doubtful(Exception):
    """A check whose result may be meant so; the message says what is odd."""


class Skip(Exception):
    """A check that does not apply; the message says why."""


def check_env(env_id: str) -> Iterator[Finding]:
    """Check a task and, on the virtual hub or in its simulation, the environment made of it. Raises
    UnknownNameError or DescriptionError if there is no such task.

    Args:
        env_id: as :func:`bricksrl.make` takes it.
    """
    task = get_task(env_id)
    with _said_once():
        yield from _all_checks(env_id, task)


def _all_checks(env_id: str, task: Task) -> Iterator[Finding]:
    # What needs no robot comes first, because an error there explains those that follow.
    checks: dict[str, Callable[[], str]] = {
        "description": lambda: _description(task),
        "functions": lambda: _functions(task),
        "hub program": lambda: _program(task),
        "specs": lambda: _specs(env_id),
        "reset": lambda: _reset(env_id),
    }
    if task.sensors:
        checks["sensors"] = lambda: _sensors(env_id, task)
    checks["determinism"] = lambda: _determinism(env_id, task)
    checks["twin"] = lambda: _twin(env_id)
    checks["values"] = lambda: _values(env_id, task)
    with without_torchrl_notes():
        yield from run_checks(checks)


@contextmanager
def _said_once() -> Iterator[None]:
    """Context in which the log says each thing once, as a check makes the environment many
    times."""
    said: set[str] = set()

    def is_new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        is_first = text not in said
        said.add(text)
        return is_first

    # Where no logging is set up, Python prints warnings by its last resort.
    found: list[logging.Handler | None] = [*logging.getLogger().handlers]
    found = found or [logging.lastResort]
    handlers = [handler for handler in found if handler is not None]
    for handler in handlers:
        handler.addFilter(is_new)
    try:
        yield
    finally:
        for handler in handlers:
            handler.removeFilter(is_new)


def run_checks(checks: dict[str, Callable[[], str]]) -> Iterator[Finding]:
    """Run checks by name: each returns its result as text, or raises `Broken`, `Doubtful` or
    `Skip`."""
    first_checks: dict[str, str] = {}
    for name, check in checks.items():
        try:
            yield Finding(name, Outcome.OK, check())
        except (Skip, RenderingUnavailableError) as reason:
            yield Finding(name, Outcome.SKIPPED, str(reason))
        except Doubtful as doubt:
            yield Finding(name, Outcome.WARNING, str(doubt))
        except Exception as error:  # noqa: BLE001 - any error of the user's functions is a finding
            text = str(error)
            if not isinstance(error, (Broken, BricksError)):
                # An error of the user's code is told by its type and line, because nothing else
                # says what it is about.
                text = f"{type(error).__name__}: {error}{line_of_user(error)}"
            text = " ".join(text.split())
            # One fault may fail many checks, but is told only once.
            first = first_checks.setdefault(text, name)
            yield Finding(name, Outcome.ERROR, text if first == name else f"the same as in {first}")


def table(doc: str, heading: str) -> list[list[str]]:
    """Rows of the table below a heading of a description, without its header; empty if there is
    none."""
    _, _, below = doc.partition(f"## {heading}\n")
    section, _, _ = below.partition("\n## ")
    rows = [line for line in section.splitlines() if line.startswith("|")]
    # The header and the line under it are no data.
    body = rows[2:]
    return [_cells(row) for row in body]


def _cells(row: str) -> list[str]:
    return [cell.strip() for cell in row.strip("|").split("|")]


def _description(task: Task) -> str:
    if not task.summary:
        raise Broken("the description is empty; say in one line what is to be learned")
    known = ("Action", "Observation", "End of an episode")
    headings = [heading for heading in known if table(task.doc, heading)]
    if not headings:
        raise Skip("it has no tables of action, observation and end")
    actions: list[tuple[str | float, ...]] = [
        (str(number), command.name, -1.0, 1.0, command.low, command.high, command.unit)
        for number, command in enumerate(task.interface.commands)
    ]
    entries: list[tuple[str | float, ...]] = [
        (str(number), entry.name, entry.low, entry.high, entry.unit)
        for number, entry in enumerate(task.entries)
    ]
    for heading, expected in (("Action", actions), ("Observation", entries)):
        rows = [_values_of(row) for row in table(task.doc, heading)]
        if heading in headings and rows != expected:
            wrong = _first_wrong(rows, expected)
            raise Broken(
                f"the table of the {heading.lower()} in the task's doc does not fit the task at "
                f"{wrong}; correct it, and give a changed copy of a task a doc of its own"
            )
    ends = [row[1] for row in table(task.doc, "End of an episode") if row[0] == "truncated"]
    if "End of an episode" in headings and ends != [f"after {task.max_steps} steps"]:
        raise Broken(f"the table of ends does not say: truncated, after {task.max_steps} steps")
    return f"the tables ({', '.join(headings).lower()}) fit the task"


def _values_of(row: list[str]) -> tuple[str | float, ...]:
    """Cells of a row: texts at its ends (place, name; unit), numbers between them."""
    numbers = [_number(cell) for cell in row[2:-1]]
    return (*row[:2], *numbers, *row[max(2, len(row) - 1) :])


def _first_wrong(
    rows: list[tuple[str | float, ...]],
    expected: list[tuple[str | float, ...]],
) -> object:
    """The first row that is not as expected, or how many rows there are in place of how many."""
    for row, right in zip(rows, expected, strict=False):
        if row != right:
            return row
    return f"{len(rows)} rows in place of {len(expected)}"


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def _program(task: Task) -> str:
    if not task.robot.hub.model.runs_programs:
        raise Skip(f"{an(task.robot.hub.value)} runs no programs")
    size = check_program(task.hub_program, task.robot.hub)
    return f"{size} of the {task.robot.hub.value} hub's {task.robot.hub.model.program_bytes} bytes"


def _specs(env_id: str) -> str:
    from torchrl.envs import check_env_specs

    with closing(make(env_id, seed=_SEED)) as env:
        with warnings.catch_warnings(action="ignore"):
            try:
                check_env_specs(env, seed=_SEED)
            except AssertionError as error:
                # TorchRL prints both specs in full below its first line.
                first_line, _, _ = str(error).partition("\n")
                raise Broken(
                    f"what it returns does not fit its specs: {first_line[:_MOST_SHOWN]}"
                ) from None
        return (
            f"observation {list(env.observation_spec['observation'].shape)}, action "
            f"{list(env.action_spec.shape)}"
        )


def _reset(env_id: str) -> str:
    with closing(make(env_id, seed=_SEED)) as env:
        observations = [env.reset()["observation"] for _ in range(2)]
    for observation in observations:
        if not bool(torch.isfinite(observation).all()):
            raise Broken(
                f"the observation holds {observation.tolist()}; all entries have to be numbers"
            )
    first_values = [round(value, 1) for value in observations[0].tolist()[:4]]
    return f"twice, the observation starts with {first_values}"


def _sensors(env_id: str, task: Task) -> str:
    with closing(make(env_id, seed=_SEED)) as env:
        state = env.reset()
    names = [entry.name for entry in task.entries]
    values = dict(zip(names, state["observation"].tolist(), strict=True))
    readings = []
    images = []
    for sensor in task.sensors:
        of_sensor = [entry.name for entry in sensor.observed_entries]
        readings += [f"{name} {values[name]:.4g}" for name in of_sensor]
        if sensor.image_px:
            images.append(f"an image {sensor.name}")
    return ", ".join([*readings, *images])


def _determinism(env_id: str, task: Task) -> str:
    real = [sensor.name for sensor in task.sensors if sensor.twin is None]
    if real:
        raise Skip(f"{', '.join(real)} is a real sensor beside the virtual robot")
    rollouts = []
    for _ in range(2):
        with closing(make(env_id, seed=_SEED)) as env, torch.random.fork_rng(devices=[]):
            # Actions draw from torch's generator, so it gets the same seed each time.
            torch.manual_seed(_SEED)
            rollouts.append(env.rollout(_STEPS))
    first, second = rollouts
    if first.shape != second.shape or not bool((first == second).all()):
        raise Broken(
            "the same seed and actions gave another episode; draw random numbers in sampled "
            "entries only"
        )
    return f"the same seed and actions repeat {first.shape[0]} steps bit for bit"


def _twin(env_id: str) -> str:
    with closing(make(env_id, seed=_SEED)) as env:
        twin = interface_of(env).twin
        if twin is None:
            raise Skip("it is simulated without a robot")
        state = env.reset()
        started_s = twin.now_s()
        # The values are both ends, the middle, and one value twice, so that every kind of command
        # shows some change.
        before = state["observation"]
        changed = torch.zeros_like(before, dtype=torch.bool)
        for value in (1.0, 0.0, -1.0, 0.5, 0.5):
            state["action"] = torch.full(env.action_spec.shape, value)
            stepped, state = env.step_and_maybe_reset(state)
            changed |= stepped["next", "observation"] != before
        elapsed_s = twin.now_s() - started_s
    if not bool(changed.any()):
        raise Broken(
            "nothing that it observes changed in five steps; let the observation show what the "
            "commands do"
        )
    return (
        f"five steps in {elapsed_s:.2f} simulated seconds, {int(changed.sum())} of "
        f"{len(changed)} entries changed"
    )


def _values(env_id: str, task: Task) -> str:
    """Values that random actions change in some episodes: entries, rewards, and the robot by each
    action."""
    observed = []
    rewards = []
    with closing(make(env_id, seed=_SEED)) as env, torch.random.fork_rng(devices=[]):
        # Actions draw from torch's generator, so it gets the same seed each time.
        torch.manual_seed(_SEED)
        for _ in range(_EPISODES):
            episode = env.rollout(_LONG)
            observed += [episode["observation"], episode["next", "observation"]]
            rewards.append(episode["next", "reward"])
        outside: dict[str, float] = getattr(interface_of(env), "outside", {})
    entries = {entry.name: entry for entry in task.entries}
    if outside:
        text = ", ".join(outside_text(entries[name], value) for name, value in outside.items())
        raise Broken(f"{text}; correct the client, or the range")
    values = torch.cat(observed)  # [observations, n]
    reward = torch.cat(rewards)
    are_numbers = values.isfinite().all(0).tolist()
    wrong = [name for name, is_number in zip(entries, are_numbers, strict=False) if not is_number]
    if wrong:
        raise Broken(f"{', '.join(wrong)} is not always a number (NaN); correct what computes it")
    doubts = []
    first = values[0]
    never_changed = (values == first).all(0).tolist()
    constant = []
    for index, name in enumerate(entries):
        if never_changed[index]:
            constant.append(f"{name} ({first[index]:g})")
    if constant:
        doubts.append(
            f"{', '.join(constant)} never changed; look at the sensor and the scene, or "
            "leave it out"
        )
    if bool((reward == reward[0]).all()):
        doubts.append(f"the reward was always {float(reward[0]):g}; nothing can be learned from it")
    idle = _idle_actions(env_id, task)
    if idle:
        doubts.append(
            f"action {', '.join(idle)} changed nothing; look at its port, its range and its units"
        )
    if doubts:
        raise Doubtful("; ".join(doubts))
    return (
        f"in {len(values) // 2} random steps all entries and the reward changed, and each "
        "action changed something"
    )


def _idle_actions(env_id: str, task: Task) -> list[str]:
    """Names of the commands whose smallest and largest action lead to the same observations and
    rewards."""
    commands = task.interface.commands
    idle = []
    for index, command in enumerate(commands):
        lowest = _outcome(env_id, index, len(commands), -1.0)
        highest = _outcome(env_id, index, len(commands), 1.0)
        if lowest.shape == highest.shape and bool((lowest == highest).all()):
            idle.append(command.name)
    return idle


def _outcome(
    env_id: str,
    index: int,
    count: int,
    value: float,
) -> TensorDictBase:
    """Observations and rewards of two steps in which one command has a value, and the others are
    0."""
    # The other commands rest, so that a change is caused by this one.
    action = torch.zeros(count)
    action[index] = value

    def act(state: TensorDictBase) -> TensorDictBase:
        return state.set("action", action.clone())

    with closing(make(env_id, seed=_SEED)) as env:
        return env.rollout(2, act).select(("next", "observation"), ("next", "reward"))


def _functions(task: Task) -> str:
    """Check that reward, ends, success and metrics return the documented shapes and types on a
    batch."""
    if task.base_env is not None:
        raise Skip("its resets and steps are its own")
    generator = torch.Generator().manual_seed(_SEED)
    steps = _STEPS
    commands = len(task.interface.commands)
    low = torch.tensor([entry.low for entry in task.task_entries])
    high = torch.tensor([entry.high for entry in task.task_entries])
    share = torch.rand((2, steps, len(low)), generator=generator)
    before, after = low + (high - low) * share  # [steps, n] each
    action = 2 * torch.rand((steps, commands), generator=generator) - 1
    episodes = torch.stack((after, after))
    # Each function is listed with what it returns, and the shape that this should have.
    shapes = {
        "reward": (task.reward(before, action, after), (steps, 1)),
        "terminated": (task.terminated(after), (steps, 1)),
        "blocked": (task.blocked(after), (steps, 1)),
        "success": (task.success(episodes), (2,)),
    }
    for name, value in task.metrics(episodes).items():
        shapes[name] = (value, (2,))
    for name, (value, shape) in shapes.items():
        if not isinstance(value, torch.Tensor):
            raise Broken(
                f"{name} is no tensor but {type(value).__name__}; compute it from the observations"
            )
        if tuple(value.shape) != shape:
            raise Broken(
                f"{name} has the shape {list(value.shape)} for observations of {steps} steps; "
                f"give {list(shape)}"
            )
    if not bool(torch.isfinite(shapes["reward"][0]).all()):
        raise Broken("the reward is not always a number")
    flags = ("terminated", "blocked", "success")
    wrong = [name for name in flags if shapes[name][0].dtype is not torch.bool]
    if wrong:
        raise Broken(f"{', '.join(wrong)} is not bool; compare")
    return f"{', '.join(shapes)} have the right shapes"
