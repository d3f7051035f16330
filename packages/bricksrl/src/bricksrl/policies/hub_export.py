"""Export of a policy as a program with which the hub acts by itself, tried on the virtual hub."""

import itertools
import json
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, median
from types import ModuleType
from typing import Any

import torch
from tensordict import TensorDictBase

from brickhub.files import check_writable, refuse_existing, write_durably
from brickhub.hub.program.compile import compile_program, program_blob
from brickhub.hub.program.generate import Goals, Place, generate_alone, start_line
from brickhub.search.structure import source_by
from brickhub.seed import episode_seed
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.exceptions import HostStop
from brickhub.virtual.pybricks import modules
from bricksrl.agents.search.structures import hub_structure
from bricksrl.envs.env_interface import interface_of
from bricksrl.envs.make import make
from bricksrl.envs.odometry import Odometer, SonarOdometer, TrueOdometer, floor_pose
from bricksrl.envs.robot_env import chance_of
from bricksrl.envs.rollout import play_episodes
from bricksrl.envs.task import Task
from bricksrl.envs.transforms import base_of
from bricksrl.errors import RunError, an
from bricksrl.policies import config_of, load_policy, make_env_of
from bricksrl.policies.by_name import TRAINED, PlainPolicy, path_of
from bricksrl.policies.hub_network import HIDDEN, Acting, HubNetwork, distil
from bricksrl.training.reproducible import reproducible
from bricksrl.training.restore import Which
from bricktwin.site.tab.plain_values import plain
from bricktwin.twin.make_body import make_body
from bricktwin.twin.physics import Physics
from bricktwin.twin.scene import OPEN_FLOOR

EPISODES = 5
"""Of the comparison, on seeds that the policy never saw."""
_SEED = 20261126
_LONGEST_ON_MS = 1000
_FEWER = "give fewer hidden units, such as export_program(..., hidden=(8, 8))"


@dataclass(frozen=True)
class HubExport:
    """A written program, and what it does on the virtual hub.

    Attributes:
        kind: "gait" for the policy itself, "network" for a distilled one.
        age_ms: age of an observation when its commands start, as over the policy's link: a moving
            robot is elsewhere by then.
        program_bytes, heap_bytes: of the compiled program, and of its objects.
        computing_ms: longest time between what it observes and its commands, by what a product
            costs (`HubModel.product_us`).
        policy_return, hub_return: means over as many episodes each.
    """

    kind: str
    age_ms: int
    program_bytes: int
    heap_bytes: int
    computing_ms: int
    policy_return: float
    hub_return: float


def export_program(
    path: Path | str,
    out: Path,
    *,
    which: Which = "last",
    hidden: tuple[int, ...] = HIDDEN,
    episodes: int | None = None,
) -> HubExport:
    """Export the policy of a run, or a shared one, as a program for the robot's hub, and try it on
    the virtual hub, for some episodes, by default `EPISODES`.

    Raises:
        RunError: ``out`` exists, the task has what a hub cannot know, or the program computes
            longer than a step takes.
        ProgramError: the program is too large for the hub.
        WriteError: ``out`` cannot be written.
        CheckpointError: the policy is damaged.
    """
    _check_free(out)
    physics = config_of(Path(path)).known_physics
    twin = {"hub": "virtual", "realtime": False, "randomize": False}
    with closing(make_env_of(Path(path), **twin)) as trained, reproducible(_SEED):
        # The hub observes what the robot does, and the policy brings its transforms.
        env = base_of(trained)
        _task_of(env)
        policy = load_policy(path, env, which=which)
        # A gait alone is a few lines on the hub; as a base of something else it is a part of it.
        actor = next(policy.module.children(), None) if trained is env else None
        return _export(
            env,
            policy,
            actor,
            out,
            physics,
            hidden,
            episodes or EPISODES,
        )


def export_own(
    env_id: str,
    out: Path,
    *,
    learned: str | None = None,
    hidden: tuple[int, ...] = HIDDEN,
) -> HubExport:
    """Export the policy that comes with an environment of ours, as `export_program` does.

    Args:
        learned: environment that it has learned in, such as a simulation of this robot; by default
            the same.

    Raises:
        RunError: as of `export_program`, or nothing comes with the environment.
    """
    _check_free(out)
    learned = learned or env_id
    if learned not in TRAINED:
        raise RunError(f"no policy comes with {learned}; choose {', '.join(TRAINED)}")
    env = make(env_id, hub="virtual", realtime=False, randomize=False)
    with closing(env), reproducible(_SEED):
        _task_of(env)
        policy = OwnPolicy(PlainPolicy.load(path_of(learned)))
        return _export(
            env,
            policy,
            None,
            out,
            None,
            hidden,
            EPISODES,
        )


class OwnPolicy:
    """A policy of plain numbers, for TorchRL's environments and for tensors."""

    def __init__(self, numbers: PlainPolicy) -> None:
        self._numbers = numbers

    def __call__(self, state: TensorDictBase) -> TensorDictBase:
        return state.set("action", self.act(state["observation"]))

    def act(self, observation: torch.Tensor) -> torch.Tensor:
        """Action ``[*batch, m]`` for an observation ``[*batch, n]``."""
        return torch.from_numpy(self._numbers.act(observation.numpy()))

    def reset(self) -> None:
        """It remembers nothing."""


def _check_free(out: Path) -> None:
    for path in (out, world_file(out)):
        refuse_existing(path, RunError)
    check_writable(out)


def world_file(out: Path) -> Path:
    """File beside a program with the world that its policy is for."""
    return out.with_suffix(".json")


def _task_of(env: Any) -> Task:
    """The task of an environment. Raises RunError if a hub by itself cannot know what it
    observes."""
    task = interface_of(env).task
    lacks_measure = task is not None and task.target is not None and task.measured_entries
    if task is None or task.images or task.sensors or task.client or lacks_measure:
        reason = "a hub by itself sees no images and nothing that this computer senses"
        raise RunError(f"{reason}; export the policy of another task")
    return task


def _export(
    env: Any,
    policy: Acting,
    actor: Any,
    out: Path,
    physics: Physics | None,
    hidden: tuple[int, ...],
    episodes: int,
) -> HubExport:
    """Write a policy as a program, and try it for some episodes."""
    task = _task_of(env)
    channels = task.observed_channels
    ends_s = list[float]()

    def timed(state: TensorDictBase) -> TensorDictBase:
        # A simulation without a link has none.
        episode = interface_of(env).episode
        if episode is not None:
            ends_s.append(episode.hub_time_s)
        return policy(state)

    played = play_episodes(
        env,
        timed,
        episodes,
        _SEED,
        reset_policy=policy.reset,
    )
    before = [episode.return_ for episode in played]
    age_ms = _age_ms(ends_s, task.interface.settle.fixed_ms)
    single = None if actor is None else hub_structure(actor)
    if single is not None:
        kind = "gait"
        source = source_by(single, actor.best.tolist())
    else:
        kind = "network"
        observed = task.entries[: _observed_count(task)]
        network = HubNetwork(observed, len(task.interface.commands), hidden)
        distil(env, policy, network, _SEED)
        source = network.hub_source()
    has_world = task.scene != OPEN_FLOOR
    program = generate_alone(
        task.robot,
        task.interface,
        channels,
        source,
        f"{an(kind)} that learned {task.id}",
        age_ms,
        goals_of(task),
        out.stem if has_world else "",
        place_of(task),
    )
    blob = program_blob(compile_program(program), task.robot.hub)
    # The program itself, in the virtual hub, which counts its time and its memory: from where the
    # policy began, to the same goals.
    alone = []
    for number in range(1, episodes + 1):
        seed = episode_seed("evaluation", _SEED, number)
        alone.append(play_as_env(program.source, task, physics, seed))
    computing_ms = max(episode.computing_ms for episode in alone)
    heap_bytes = max(episode.heap_bytes for episode in alone)
    if computing_ms > task.interface.settle.longest_ms:
        limit = f"a step of {task.id} takes {task.interface.settle.longest_ms} ms"
        raise RunError(f"the program computes for {computing_ms} ms, and {limit}; {_FEWER}")
    if len(blob) + heap_bytes > task.robot.hub.model.program_bytes:
        raise RunError(f"the program and its objects need {len(blob) + heap_bytes} bytes; {_FEWER}")
    write_durably(out, program.source.encode())
    if has_world:
        world = json.dumps(plain(task.scene), separators=(",", ":"))
        write_durably(world_file(out), f"{world}\n".encode())
    policy_return = fmean(before)
    hub_return = fmean(episode.return_ for episode in alone)
    return HubExport(
        kind,
        age_ms,
        len(blob),
        heap_bytes,
        computing_ms,
        policy_return,
        hub_return,
    )


def _observed_count(task: Task) -> int:
    """How many entries of the observation, the first ones, a hub by itself knows."""
    if task.target is not None:
        return len(task.entries)
    return len(task.observed_channels) + len(task.sampled_entries)


def place_of(task: Task) -> Place | None:
    """The place that a hub reckons from the middle of the task's starts, if the task has one."""
    base = task.robot.drive_base
    if task.target is None or base is None:
        return None
    x_mm, y_mm = (sum(ends) / 2 for ends in task.scene.start_mm)
    heading_deg = sum(task.scene.heading_deg) / 2
    place = task.target.place
    return Place(
        (x_mm, y_mm, heading_deg),
        (place.x_mm, place.y_mm, place.heading_deg),
        (base.left, base.right),
        base.turn_deg(1.0),
        base.axle_track_mm,
    )


def goals_of(task: Task) -> Goals | None:
    """What the hub draws itself, as nobody tells it a goal."""
    if not task.sampled_entries:
        return None
    ranges: list[tuple[float, float]] = []
    for entry in task.sampled_entries:
        # Whole numbers stay whole, by which the hub knows how to draw them.
        is_whole = entry.whole
        low, high = (int(entry.low), int(entry.high)) if is_whole else (entry.low, entry.high)
        ranges.append((low, high))
    return Goals(tuple(ranges), task.max_steps)


def _age_ms(ends_s: list[float], step_ms: int | None) -> int:
    """Age of an observation when its commands start, from the times when steps ended. Where a step
    lasts until all moves have ended, the robot stands, and an observation does not age."""
    steps_s = [after - before for before, after in itertools.pairwise(ends_s)]
    if step_ms is None or not steps_s:
        return 0
    return max(0, round(1000 * median(steps_s)) - step_ms)


class _Over(HostStop):
    """The episode has ended."""


@dataclass
class Alone:
    """An episode of a program that acts by itself, read from what it prints; a console of the
    virtual hub.

    Attributes:
        return_, length: rewards and steps so far.
        computing_ms, heap_bytes: the longest that it has computed before a step, and its largest
            heap.
        seen: the last observation ``[n]``, and the action ``[m]`` on it.
    """

    task: Task
    machine: Machine
    odometer: Odometer
    heap: Callable[[], int] = lambda: 0
    inbox: bytearray = field(default_factory=bytearray)
    return_: float = 0.0
    length: int = 0
    computing_ms: int = 0
    heap_bytes: int = 0
    _line: bytes = b""
    seen: tuple[torch.Tensor, torch.Tensor] | None = field(default=None, init=False)
    _commanded: list[float] = field(default_factory=list, init=False)

    def available(self) -> int:
        return 0

    def read(self, n: int) -> bytes:
        raise EOFError("nobody types")

    def write_app_data(self, data: bytes) -> None:
        """Discard it."""

    def write(self, data: bytes) -> None:
        self._line += data
        *lines, self._line = self._line.split(b"\r\n")
        for line in lines:
            self._step([float(text) for text in line.split()])

    def _step(self, numbers: list[float]) -> None:
        """Take the reward of the step that ended with these numbers, if they are not the first.
        Raises _Over at the end."""
        task = self.task
        count = _observed_count(task)
        commands = task.interface.commands
        self.computing_ms = max(self.computing_ms, round(numbers[0]))
        self.heap_bytes = max(self.heap_bytes, self.heap())
        seen = numbers[1 : count + 1]
        # A task may observe its last commands and what this computer measures of the way: both are
        # of its reward, and the hub knows neither. Whichever it does not observe is cut off.
        last = self._commanded or [0.0] * len(commands)
        last = last[: len(task.command_entries)]
        forward_mm = self.odometer.forward_mm(self.machine.body_ms / 1000, seen)
        moved = [forward_mm][: len(task.measured_entries)]
        # A hub that reckons a place tells its last commands, too.
        unknown = [] if task.target is not None else [*moved, *last]
        observation = torch.tensor([*seen, *unknown])
        self._commanded = []
        actions = []
        for command, number in zip(commands, numbers[count + 1 :], strict=True):
            value = number / command.scale
            self._commanded.append(value)
            actions.append((2 * value - command.low - command.high) / (command.high - command.low))
        before = self.seen
        self.seen = (observation, torch.tensor(actions))
        if before is None:
            return
        self.return_ += float(task.reward(*before, observation))
        self.length += 1
        if bool(task.terminated(observation)) or self.length >= task.max_steps:
            raise _Over


def play_as_env(
    source: str,
    task: Task,
    physics: Physics | None,
    seed: int,
) -> Alone:
    """Let a program of `generate_alone` play the episode that an environment plays by a seed, on a
    virtual hub: from the same start, and to the same goals. Raises the program's exception."""
    chance = chance_of(seed)
    body: Any = make_body(
        task.robot,
        scene=task.scene,
        physics=physics,
        seed=chance.twin_seed,
    )
    body.reset(chance.place)
    place = place_of(task)
    if place is not None:
        # The program is told where the robot was put, as its user tells it.
        there = floor_pose(body.pose())
        start = start_line((there.x_mm, there.y_mm, there.heading_deg))
        source = source.replace(start_line(place.start), start)
    goals = [entry.draw(chance.host) for entry in task.sampled_entries]
    return _play(source, task, body, _told(goals))


def _told(goals: Sequence[float]) -> ModuleType:
    """MicroPython's module ``urandom``, which draws these goals, one after the other."""
    left = itertools.cycle(goals)
    told = ModuleType("urandom")
    told.uniform = lambda _low, _high: next(left)  # type: ignore[attr-defined]
    told.randint = lambda _low, _high: int(next(left))  # type: ignore[attr-defined]
    return told


def play_alone(
    source: str,
    task: Task,
    physics: Physics | None,
    seed: int,
) -> Alone:
    """Let a program of `generate_alone` play an episode of the task on a virtual hub, which draws
    its goals itself. Raises the program's exception."""
    body: Any = make_body(
        task.robot,
        scene=task.scene,
        physics=physics,
        seed=seed,
    )
    return _play(source, task, body, on_ms=seed % _LONGEST_ON_MS)


def _play(
    source: str,
    task: Task,
    body: Any,
    random: ModuleType | None = None,
    on_ms: int = 0,
) -> Alone:
    """Play an episode with a body at its start."""
    machine = Machine(body)
    # A hub draws by the time that it has been on.
    machine.advance(on_ms)
    pose = getattr(body, "pose", None)
    odometer = SonarOdometer(task.interface) if pose is None else TrueOdometer(pose, 0.0)
    episode = Alone(task, machine, odometer)
    importable = modules(machine, episode)
    if random is not None:
        importable["urandom"] = random
    episode.heap = importable["gc"].mem_alloc
    try:
        execute(
            source,
            "main.py",
            importable,
            episode,
        )
    except _Over:
        pass
    finally:
        machine.stop_motors()
    return episode
