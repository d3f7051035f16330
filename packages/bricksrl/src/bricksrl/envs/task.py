"""Task: a robot, its commands and channels, and pure functions of tensors.

A task is independent of TorchRL and of the hub, and importing one imports neither torch nor MuJoCo.
All functions are batched: observations have the shape ``[*batch, n]``, actions ``[*batch, m]`` (in
-1..1), rewards and ends ``[*batch, 1]``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal

from brickhub.entry import Entry
from brickhub.fields import Range, check_arguments, check_fields, check_value
from brickhub.hub.interface import ClientChannel, ClientCommand, Interface, UntilDone
from brickhub.hub.link.own_client import OwnClient
from brickhub.hub.program.generate import generate
from brickhub.hub.transport import HubProgram
from brickhub.robot import Robot
from bricksrl.envs.base_env import BaseEnv
from bricksrl.envs.host_sensors.host_sensor import HostSensor
from bricksrl.envs.odometry import Target, wheels
from bricksrl.envs.vision.camera import CameraView
from bricksrl.errors import DescriptionError
from bricktwin.twin.scene import OPEN_FLOOR, Goal, Scene

if TYPE_CHECKING:
    import numpy as np
    import torch

    Tensor = torch.Tensor
else:
    # This is for annotations only, so that importing a task loads no torch.
    Tensor = Any


@dataclass(frozen=True)
class SampledEntry(Entry):
    """Entry of the observation that is drawn at every reset and constant for the episode.
    ``whole``: draw an integer ``low, low + 1, ..., high`` instead of a real number."""

    whole: bool = False

    def draw(self, rng: np.random.Generator) -> float:
        """A uniformly random value."""
        if self.whole:
            return float(rng.integers(int(self.low), int(self.high), endpoint=True))
        return float(rng.uniform(self.low, self.high))


def never(observation: Tensor) -> Tensor:
    """``False`` of shape ``[*batch, 1]``: ``terminated`` of a task that ends by its time limit
    only."""
    return observation.new_zeros((*observation.shape[:-1], 1)).bool()


@dataclass(frozen=True)
class Task:
    """A reinforcement learning task on a robot. Raises DescriptionError if the parts are
    inconsistent.

    The observation consists of the channels in order, the readings of sensors, the sampled entries,
    the measured entries, the last commands and the target's entries. With a target, the wheel
    angles are left out. Where a camera has a goal, the task's functions get two further entries
    that the agent does not: see ``task_entries``.

    Attributes:
        id: name and version, such as ``"RunAway-v0"``.
        doc: the description; its first line is the summary.
        max_steps: steps after which an episode is truncated.
        reward: maps ``(previous observation, action, observation)`` to the reward ``[*batch, 1]``.
            The action is the agent's, in -1..1, before it is mapped to commands.
        success: maps the observations ``[*batch, steps, n]`` after each step of a whole episode to
            bool ``[*batch]``.
        metrics: maps the same observations to named numbers ``[*batch]``; units in the names.
        terminated: maps an observation to bool ``[*batch, 1]``.
        blocked: maps an observation to bool ``[*batch, 1]``: an obstacle is in the robot's way; the
            robot then waits, motors held, until it is gone. A kinematic simulation never waits.
        scene: surroundings of a virtual robot.
        sampled_entries, measured_entries: entries after the channels. The measured ones are
            computed by the host after every step (the distance forward in it), and 0 after a reset.
        observes_commands: whether the last commands are observed (0 after a reset): for a robot
            that comes to a new speed so late that much of a step is still the command before.
        target: a pose that a driving robot is to reach; success and metrics get the true pose of a
            virtual robot.
        walks: whether a virtual robot reports distance, speed and straightness.
        camera: a camera on the robot, which adds an image to the observation.
        sensors: sensors on the computer; their entries follow the channels.
        streams: whether the hub always streams its observations, for steps shorter than an exchange
            over the link.
        symmetric: whether a run in the mirror, left for right, is a run of the task too; the robot
            has to be ``mirrored``.
        settings: values that suit the task better than an agent's defaults, by the names of its
            settings; each agent takes those that it has.
        program, commands, answer: a client program of your own, and the ``struct`` formats of what
            it gets and answers at a step; see :class:`~brickhub.hub.link.own_client.OwnClient`.
        base_env: resets, steps and rewards of your own, in place of the task's functions.
    """

    id: str
    doc: str
    robot: Robot
    interface: Interface
    max_steps: int
    reward: Callable[[Tensor, Tensor, Tensor], Tensor]
    success: Callable[[Tensor], Tensor]
    metrics: Callable[[Tensor], dict[str, Tensor]]
    terminated: Callable[[Tensor], Tensor] = never
    blocked: Callable[[Tensor], Tensor] = never
    scene: Scene = OPEN_FLOOR
    sampled_entries: tuple[SampledEntry, ...] = ()
    measured_entries: tuple[Entry, ...] = ()
    observes_commands: bool = False
    target: Target | None = None
    walks: bool = False
    camera: CameraView | None = None
    sensors: tuple[HostSensor, ...] = ()
    streams: bool = False
    symmetric: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    program: str | None = None
    commands: str = ""
    answer: str = ""
    base_env: BaseEnv | None = None

    def __post_init__(self) -> None:
        check_fields(Task, vars(self))
        self.robot.check_complete()
        if self.client is not None:
            # An absolute path keeps its meaning in any folder.
            object.__setattr__(self, "program", self.client.program)
            self.client.check(self.interface)
        for name, arguments in _ARGUMENTS.items():
            check_arguments(f"{name} of {self.id}", getattr(self, name), arguments)
        if re.fullmatch(r"\w+-v\d+", self.id) is None:
            raise DescriptionError(
                f"'{self.id}' is not an id for a task; take a name and a version, such as "
                "'MyTask-v0'"
            )
        if self.max_steps < 1:
            raise DescriptionError(
                f"task {self.id}: an episode of {self.max_steps} steps is empty; give max_steps "
                "of 1 or more"
            )
        if self.target is not None:
            # The call raises where dead reckoning is impossible, before an episode needs it.
            wheels(self.robot, self.interface)
        if not self.interface.commands or not self.entries:
            raise DescriptionError(
                f"task {self.id}: nothing to command or nothing to observe; name commands and "
                "channels"
            )
        self._check_names()
        if self.symmetric:
            # This raises where something has no mirror image.
            mirrors(self)

    def _check_names(self) -> None:
        """Raise DescriptionError where two numbers or images have one name, or an image that of a
        part of each step, or a range is none."""
        images = [sensor.name for sensor in self.sensors if sensor.image_px]
        names = [entry.name for entry in self.entries] + images
        if len(set(names)) < len(names):
            raise DescriptionError(
                f"task {self.id}: the observation {', '.join(names)} names an entry twice; "
                "rename one"
            )
        taken = [name for name in images if name in RESERVED_KEYS]
        if taken:
            raise DescriptionError(
                f"task {self.id}: '{taken[0]}' is what each step has anyway; give the sensor "
                "another name"
            )
        # NaN is not above anything, so the comparison is negated to catch an end that is no number
        # as well.
        backwards = [entry.name for entry in self.entries if not entry.low <= entry.high]
        if backwards:
            raise DescriptionError(
                f"task {self.id}: the range of {', '.join(backwards)} ends below its start; "
                "exchange the two"
            )

    @property
    def client(self) -> OwnClient | None:
        """The client program of one's own, if any."""
        if self.program is None:
            return None
        return OwnClient(self.program, self.commands, self.answer)

    @property
    def hub_program(self) -> HubProgram:
        """The program on the hub. Raises ProgramError if the hub cannot run it."""
        client = self.client
        return generate(self.robot, self.interface) if client is None else client.load()

    @property
    def summary(self) -> str:
        """The first paragraph of the description, as one line."""
        return " ".join(self.doc.strip().partition("\n\n")[0].split())

    @property
    def rate_hz(self) -> float:
        """Nominal steps per second; 1 if they have no fixed time."""
        step_ms = self.interface.settle.fixed_ms
        return 1.0 if step_ms is None else 1000.0 / step_ms

    @property
    def observed_channels(self) -> tuple[int, ...]:
        """Indices of the channels that are in the observation."""
        # With a target, the wheels only tell where it is (see `Target`).
        wheel_angles = () if self.target is None else wheels(self.robot, self.interface)
        channels = enumerate(self.interface.channels)
        return tuple(
            index
            for index, channel in channels
            if index not in wheel_angles and not channel.is_aside
        )

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Entries of the observation vector."""
        channels = (self.interface.channels[index].entry for index in self.observed_channels)
        target = () if self.target is None else self.target.entries
        sensed = (entry for sensor in self.sensors for entry in sensor.observed_entries)
        return (
            *channels,
            *sensed,
            *self.sampled_entries,
            *self.measured_entries,
            *self.command_entries,
            *target,
        )

    @property
    def images(self) -> dict[str, int]:
        """Side in px of each image of the observation, by its key: the camera's is ``"image"``."""
        images = {}
        if self.camera is not None:
            images["image"] = self.camera.image_px
        for sensor in self.sensors:
            if sensor.image_px:
                images[sensor.name] = sensor.image_px
        return images

    @property
    def command_entries(self) -> tuple[Entry, ...]:
        """Entries of the last commands, where they are observed."""
        if not self.observes_commands:
            return ()
        entries = []
        for command in self.interface.commands:
            # After a reset this reads 0, even where 0 is no command.
            limits = (min(command.low, 0.0), max(command.high, 0.0))
            name = f"last_{command.name}"
            entries.append(
                Entry(
                    name,
                    command.low,
                    command.high,
                    command.unit,
                    limits=limits,
                )
            )
        return tuple(entries)

    @property
    def has_hidden_entries(self) -> bool:
        """Whether success and metrics may get more than the agent sees."""
        return self.camera is not None or self.target is not None

    def goal(self, observation: Sequence[float]) -> Goal | None:
        """Pose that the robot is to reach by an observation ``[n]``, to be drawn: of motors, each
        with an entry such as ``low_goal``, or the target's; ``None`` if there is none."""
        names = [entry.name for entry in self.entries]
        values = dict(zip(names, observation, strict=False))
        goals = {}
        for motor in self.robot.motors:
            name = f"{motor.name}_goal"
            if name in values:
                goals[motor.name] = values[name]
        if self.target is not None:
            place = self.target.place
            return Goal(goals, (place.x_mm, place.y_mm), place.heading_deg)
        return Goal(goals) if goals else None

    @property
    def task_entries(self) -> tuple[Entry, ...]:
        """Entries that reward, ends, success and metrics get: the observation and, where a camera
        has a goal, two distances.

        These are the mean distance of the red objects from it (the last seen in the episode; 0
        before) and that of the nearest.
        """
        if self.camera is None or self.camera.goal is None:
            return self.entries
        farthest_px = self.camera.farthest_px
        return (
            *self.entries,
            Entry(
                "mean_distance",
                0.0,
                farthest_px,
                "px",
            ),
            Entry(
                "nearest_distance",
                0.0,
                farthest_px,
                "px",
            ),
        )


_ARGUMENTS = {
    "reward": ("previous", "action", "observation"),
    "success": ("observations",),
    "metrics": ("observations",),
    "terminated": ("observation",),
    "blocked": ("observation",),
}
"""Arguments of the functions of a task."""


# Trackers log these of each episode, whatever its task.
MEASURED = ("episode", "phase", "steps", "length", "return", "success")
"""The first columns of ``metrics.csv``."""
MEASURED_TOO = ("seconds", "updates_per_step", "link_lost", "evaluation", "robot")
"""The last columns of ``metrics.csv``."""
_IN_INFO = (
    "is_success",
    "final_obs",
    "final_info",
    "final_observation",
    "terminal_observation",
    "TimeLimit.truncated",
)
RESERVED_MEASURES = frozenset((*MEASURED, *MEASURED_TOO, *_IN_INFO))
"""Names that no metric of a task and no measure of an agent's updates may have: those of columns
and trackers, and those of Gymnasium's ``info``, where a name with an underscore before it says
which copies have it."""
_OF_STEPS = (
    "observation",
    "image",
    "action",
    "reward",
    "done",
    "terminated",
    "truncated",
    "link_lost",
)
_OF_OTHERS = ("next", "intervention", "episode_reward", "step_count", "is_init", "mask")
RESERVED_KEYS = frozenset((*_OF_STEPS, *_OF_OTHERS))
"""Keys of a step that no image of a sensor may have."""


@dataclass(frozen=True)
class Kinematics:
    """Kinematic model: each commanded motor turns by its command plus noise. Raises
    DescriptionError if the noise is negative, or ``noise_on`` or ``motion`` is unknown.

    Attributes:
        noise: standard deviation of the normal noise on each normalised action, before it is mapped
            to degrees.
        noise_on: ``"action"``, or ``"state"`` for the same noise, in the same degrees, on the angle
            after the move.
        motion: ``"instant"``: a motor reaches its target before the next command. ``"firmware"``:
            it follows the firmware's trajectory for the task's step time and carries its speed over
            into the next command.
    """

    noise: Annotated[float, Range()]
    noise_on: Literal["action", "state"] = "action"
    motion: Literal["instant", "firmware"] = "instant"

    def __post_init__(self) -> None:
        check_fields(Kinematics, vars(self))


def success_of(task: Task, observations: Tensor) -> bool:
    """Success of one episode, by its observations ``[steps, n]``. Raises DescriptionError if the
    task's function gives none."""
    return bool(_number(task, "success", task.success(observations)))


def metrics_of(task: Task, observations: Tensor) -> dict[str, float]:
    """Metrics of one episode, by its observations ``[steps, n]``. Raises DescriptionError if the
    task's function gives none."""
    values = task.metrics(observations)
    check_value(f"what metrics of {task.id} returns", values, dict)
    check_measures(values, f"metrics of {task.id}")
    return {name: _number(task, f"metrics['{name}']", value) for name, value in values.items()}


def check_measures(names: Iterable[object], where: str) -> None:
    """Raise DescriptionError if a name of a measure is that of something else that is kept beside
    it, or no name."""
    for name in names:
        if not isinstance(name, str) or not name.isprintable() or not name.strip(" _"):
            raise DescriptionError(
                f"{where} are named {name!r}; take a name in words, with the unit"
            )
        if name in RESERVED_MEASURES or name.startswith("_"):
            remedy = f"give it another one, such as task_{name.strip('_')}"
            raise DescriptionError(
                f"{where} have the name '{name}', which each episode has for something else; "
                f"{remedy}"
            )


def _number(
    task: Task,
    name: str,
    value: Any,
) -> float:
    try:
        return float(value)
    except (RuntimeError, TypeError, ValueError):
        given = f"of shape {list(value.shape)}" if hasattr(value, "shape") else repr(value)
        raise DescriptionError(
            f"{name} of {task.id} is {given}; give one number for an episode"
        ) from None


@dataclass(frozen=True)
class Mirror:
    """Mirror image of vectors, left for right: of each entry the one whose place it takes, its
    factor, and whether it wraps from 360 to 0."""

    places: tuple[int, ...]
    signs: tuple[int, ...]
    wraps: tuple[bool, ...]

    def __call__(self, vector: Tensor) -> Tensor:
        """Mirror image of vectors ``[*batch, n]``."""
        moved = vector[..., list(self.places)] * vector.new_tensor(self.signs)
        # An angle in 0..360 degrees would leave its range when its sign changes, so it is wrapped
        # again.
        signs_and_wraps = enumerate(zip(self.signs, self.wraps, strict=True))
        turned = [index for index, (sign, wraps) in signs_and_wraps if wraps and sign < 0]
        if turned:
            moved[..., turned] = moved[..., turned].remainder(360.0)
        return moved


def mirrors(task: Task) -> tuple[Mirror, Mirror]:
    """Mirrors of the task's observation and action. Raises DescriptionError if its robot is not
    declared symmetric, or a number has no mirror image."""
    robot = task.robot
    interface = task.interface
    if not robot.mirrored:
        raise DescriptionError(
            f"{task.id} is symmetric and its robot {robot.name} is not; give the robot mirrored="
        )
    if task.sampled_entries or task.target is not None or task.camera is not None:
        raise DescriptionError(
            f"{task.id} is symmetric and has a goal, whose mirror image is unknown; omit symmetric"
        )
    channels = [interface.channels[index] for index in task.observed_channels]
    actions = [command.in_mirror(robot) for command in interface.commands]
    observed = [channel.in_mirror(robot) for channel in channels]
    observed += [(entry.name, 1) for entry in task.measured_entries]
    if task.observes_commands:
        observed += [(f"last_{name}", sign) for name, sign in actions]
    for command, (_, sign) in zip(interface.commands, actions, strict=True):
        # A command whose range is not about 0 has no mirror image in it.
        is_about_0 = command.low == -command.high
        if sign == 0 or (sign < 0 and not is_about_0):
            raise command.error(
                f" has no mirror image in {task.id}: give it a range about 0, or omit symmetric"
            )
    names = [entry.name for entry in task.entries]
    wraps = [entry.wraps for entry in task.entries]
    of_observation = _mirror(task, names, observed, wraps)
    commands = [command.name for command in interface.commands]
    of_action = _mirror(
        task,
        commands,
        actions,
        [False] * len(commands),
    )
    return of_observation, of_action


def _mirror(
    task: Task,
    names: Sequence[str],
    images: Sequence[tuple[str, int]],
    wraps: Sequence[bool],
) -> Mirror:
    missing = {name for name, _ in images} - set(names)
    if missing:
        raise DescriptionError(
            f"{task.id} is symmetric and lacks {', '.join(sorted(missing))}; add them, or omit "
            "symmetric"
        )
    return Mirror(
        tuple(names.index(name) for name, _ in images),
        tuple(sign for _, sign in images),
        tuple(wraps),
    )


def task_of(env: BaseEnv) -> Task:
    """What everybody asks of an environment. Raises DescriptionError if a part of it is missing."""
    try:
        actions = _ends(env.action_spec.space)
        states = _ends(env.observation_spec[env.observation_key].space)
        commands = [ClientCommand(f"action_{i}", *ends) for i, ends in enumerate(actions)]
        channels = [ClientChannel(f"state_{i}", *ends) for i, ends in enumerate(states)]
        return Task(
            id=f"{type(env).__name__}-v0",
            doc=type(env).__doc__ or "An environment with resets and steps of its own.",
            robot=env.robot,
            interface=Interface(tuple(commands), tuple(channels), UntilDone()),
            max_steps=env.max_episode_steps,
            # Its own steps compute reward and end, so nothing calls these functions.
            reward=lambda previous, action, observation: _unpaid(observation),
            success=_unjudged,
            metrics=lambda observations: {},
            scene=env.scene,
            program=env.program,
            commands="!" + "f" * env.action_dim,
            answer="!" + "f" * env.state_dim,
            base_env=env,
        )
    except (AttributeError, KeyError) as error:
        raise DescriptionError(
            f"{type(env).__name__}: {error}; set robot, program and specs, and call __init__"
        ) from None


def _ends(space: Any) -> list[tuple[float, float]]:
    """Lowest and highest value of each number of a space."""
    lows = space.low.flatten().tolist()
    highs = space.high.flatten().tolist()
    return list(zip(lows, highs, strict=True))


def _unpaid(observation: Tensor) -> Tensor:
    return observation.new_zeros((*observation.shape[:-1], 1))


def _unjudged(observations: Tensor) -> Tensor:
    return observations.new_zeros(observations.shape[:-2]).bool()
