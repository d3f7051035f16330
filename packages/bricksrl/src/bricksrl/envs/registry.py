"""Registry of environments: their names, tasks and options; `make` makes them. Importing it imports
neither torch nor MuJoCo."""

from __future__ import annotations

import functools
import inspect
import re
import sys
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from brickhub.fields import check_call, check_value
from brickhub.files import quoted
from brickhub.robot import Robot
from brickhub.user_files import beside, is_reference, load_object, objects_in, without_name
from bricksrl.envs.arenas import ARENAS
from bricksrl.envs.base_env import BaseEnv
from bricksrl.envs.options import TRANSFORMS, EnvOptions
from bricksrl.envs.task import Kinematics, Task, task_of
from bricksrl.envs.tasks.line_follow import line_follow
from bricksrl.envs.tasks.on_robots import with_robots
from bricksrl.envs.tasks.park import PARK
from bricksrl.envs.tasks.robo_arm import robo_arm
from bricksrl.envs.tasks.robo_arm_mixed import robo_arm_mixed
from bricksrl.envs.tasks.run_away import run_away
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.envs.tasks.walker import walker
from bricksrl.envs.tasks.walker_forward import walker_forward
from bricksrl.envs.tasks.walker_streamed import WALKER_STREAMED
from bricksrl.errors import (
    DescriptionError,
    UnknownNameError,
    UnknownOptionError,
    hint,
)
from bricktwin.robots import CART, EV3_DRIVER
from bricktwin.robots.planned import completed, is_plan
from bricktwin.target import load_scene
from bricktwin.twin.make_body import lies_on_bench


@dataclass(frozen=True)
class Registration:
    """A registered environment.

    Attributes:
        build: makes the task from its options.
        kinematics: parameters of its kinematic simulation; ``None`` where a robot, real or virtual,
            runs the task.
        episodes: default length of a training run: the paper's budget, where it has one.
        agent: default agent of a training run.
        note: difference from other environments of the same task.
    """

    build: Callable[..., Task]
    kinematics: Kinematics | None = None
    episodes: int = 40
    agent: str = "sac"
    note: str = ""


_SIMULATED = " (simulated without a hub, thousands at once)"
_BUILT_IN = {
    "LineFollow-v0": Registration(line_follow, episodes=30),
    "Park-v0": Registration(with_robots(PARK, CART, EV3_DRIVER), episodes=30),
    "RunAway-v0": Registration(run_away),
    "Spinning-v0": Registration(with_robots(SPINNING, CART, EV3_DRIVER), episodes=15),
    "Walker-v0": Registration(functools.partial(walker, "Walker-v0"), episodes=75),
    "Walker-v1": Registration(walker_forward, episodes=75),
    "Walker-v2": Registration(lambda: WALKER_STREAMED, episodes=12),
    "WalkerSim-v0": Registration(
        functools.partial(walker, "WalkerSim-v0"),
        Kinematics(noise=0.1),
        episodes=75,
        note=_SIMULATED,
    ),
    "WalkerSim-v1": Registration(
        functools.partial(walker, "WalkerSim-v1"),
        Kinematics(noise=0.02, motion="firmware"),
        episodes=75,
        note=f"{_SIMULATED[:-1]}; legs turn as the firmware turns them)",
    ),
    "RoboArm-v0": Registration(functools.partial(robo_arm, "RoboArm-v0"), episodes=250),
    "RoboArm_mixed-v0": Registration(
        functools.partial(robo_arm_mixed, "RoboArm_mixed-v0"),
        episodes=250,
    ),
    "RoboArmSim-v0": Registration(
        functools.partial(robo_arm, "RoboArmSim-v0"),
        Kinematics(noise=0.05),
        episodes=250,
        note=_SIMULATED,
    ),
}
BUILT_IN = tuple(_BUILT_IN)
"""Ids of the environments that come with BricksRL."""
_specs = dict(_BUILT_IN)


class _Labels:
    """Texts that can only be the id of an environment: it is looked up here, names one that is
    given, or what the robot of a plan learns, and is never loaded."""

    def __contains__(self, text: object) -> bool:
        if not isinstance(text, str):
            return False
        return re.fullmatch(r"[\w-]+", text) is not None or is_plan(without_name(text))


LABELS = _Labels()


def is_simulation(env_id: str) -> bool:
    """Whether an environment is a batched kinematic simulation. Raises UnknownNameError if there is
    no such environment."""
    return registration(env_id).kinematics is not None


def simulation_text(env_id: str) -> str:
    """How a kinematic simulation differs from the robot of its task, for its page; empty for a
    robot. Raises UnknownNameError if there is no such environment."""
    spec = registration(env_id)
    if spec.kinematics is None:
        return ""
    task = get_task(env_id)
    kinematics = spec.kinematics
    commanded = set(task.interface.angle_indices.values())
    channels = enumerate(task.interface.channels)
    silent = [channel.name for index, channel in channels if index not in commanded]
    motion = "at once"
    if kinematics.motion == "firmware":
        motion = "as far as the firmware turns it in the time of a step"
    noise = (
        f"normal noise with a standard deviation of {kinematics.noise:g} is added to each "
        f"{kinematics.noise_on}, in -1..1"
    )
    zeros = f" {', '.join(silent)} are always 0." if silent else ""
    start = "An episode starts at angles that are drawn from their ranges, and so are goals."
    return f"There is no hub: each motor turns by its command, {motion}; {noise}.{zeros} {start}"


_MOST_STEPS = 10_000_000
"""Steps of all copies together in a training run of default length: about 90 s of computing for
4,096 copies of WalkerSim-v0."""


def training_episodes(env_id: str, copies: int = 1) -> int:
    """Default number of training episodes of an environment, in each of some copies: fewer where
    all together would make more than ten million steps. Raises UnknownNameError if there is no
    environment of that name."""
    found = registration(env_id)
    if copies == 1:
        return found.episodes
    steps = copies * build_task(env_id, found, {}).max_steps
    return max(1, min(found.episodes, _MOST_STEPS // steps))


def training_agent(env_id: str) -> str:
    """Default agent of an environment. Raises UnknownNameError if there is no environment of that
    name."""
    return registration(env_id).agent


def list_envs() -> dict[str, str]:
    """Summary of each environment, in one line, by id."""
    summaries = {}
    for env_id, spec in sorted(_specs.items()):
        task = build_task(env_id, spec, {})
        summaries[env_id] = task.summary + spec.note
    return summaries


def get_task(env_id: str, **options: Any) -> Task:
    """The task of an environment. Raises UnknownNameError if there is no environment of that name,
    UnknownOptionError if it has no such option."""
    return build_task(env_id, registration(env_id), options)


def task_with(env_id: str, options: EnvOptions) -> Task:
    """The task of an environment with options, in their scene if they have one. Raises
    DescriptionError for a robot that is in no scene, otherwise as `get_task` and
    `bricktwin.target.load_scene`."""
    task = get_task(env_id, **options.options)
    if options.scene is None:
        return task
    scene = load_scene(options.scene)
    if lies_on_bench(task.robot, scene):
        raise DescriptionError(
            f"the robot of {env_id} lies on the bench, which is in no scene; omit scene"
        )
    return replace(task, scene=scene)


def options_of(env_id: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the options that an environment has. Raises UnknownNameError if there is no
    environment of that name."""
    unknown = _unknown(registration(env_id), options)
    return {name: value for name, value in options.items() if name not in unknown}


def option_types(env_id: str) -> dict[str, Any]:
    """Annotations of the options of an environment that comes with BricksRL, by name; empty for any
    other."""
    if env_id not in _BUILT_IN:
        return {}
    builder = _BUILT_IN[env_id].build
    # Some makers are partial functions, which have no annotations of their own.
    function = getattr(builder, "func", builder)
    return typing.get_type_hints(function, include_extras=True)


def _unknown(spec: Registration, options: Iterable[str]) -> list[str]:
    """Names of the options that an environment does not have."""
    parameters = inspect.signature(spec.build).parameters
    kinds = [parameter.kind for parameter in parameters.values()]
    # A user's function may take any option.
    if inspect.Parameter.VAR_KEYWORD in kinds:
        return []
    return [name for name in options if name not in parameters]


def build_task(
    env_id: str,
    spec: Registration,
    options: dict[str, Any],
) -> Task:
    """The task of a registration with options. Raises UnknownOptionError if it has no such option,
    DescriptionError if a value is invalid."""
    unknown = _unknown(spec, options)
    if unknown:
        raise UnknownOptionError(_unknown_option(env_id, spec, unknown[0]))
    checked = check_call(f"{env_id}: ", spec.build, options)
    try:
        return spec.build(**checked)
    except TypeError as error:
        given = ", ".join(options) or "no options"
        raise DescriptionError(
            f"{env_id} cannot be made with {given} ({error}); see its description"
        ) from error


ARGUMENTS = {
    "simulation": ("seed", "copies", "batch_size", "device", "kinematics", "place"),
    "robot": ("seed", "copies", "place", "arrays", "watched_button"),
}
"""Names of the arguments of `make` that each kind of environment takes, beside its options."""


def _unknown_option(
    env_id: str,
    spec: Registration,
    option: str,
) -> str:
    """Message about an option that an environment does not have, with those that it has."""
    of_task = list(inspect.signature(spec.build).parameters)
    if spec.kinematics is None:
        all_options = [field.name for field in fields(EnvOptions) if field.name != "options"]
        of_all = [*ARGUMENTS["robot"], *all_options]
    else:
        of_all = [*ARGUMENTS["simulation"], *TRANSFORMS]
    own = f"its task has {', '.join(of_task) or 'none'}"
    all_have = f"all environments like it have {', '.join(of_all)}"
    # TorchRL asks for options that some environments lack, and reads Python's words in the answer.
    python_words = f"unexpected keyword argument '{option}'"
    return (
        f"{env_id} has no option {option}{hint(option, [*of_task, *of_all])}; {own}, "
        f"{all_have} ({python_words})"
    )


def registration(env_id: str) -> Registration:
    """Registration of an id, or one that is made of a user's task. Raises UnknownNameError if there
    is no such environment."""
    check_value("env_id", env_id, str)
    if is_plan(without_name(env_id)):
        return _of_plan(env_id)
    if is_reference(env_id):
        return Registration(_user_builder(env_id))
    try:
        return _specs[env_id]
    except KeyError:
        if env_id in ARENAS:
            message = (
                f"{env_id} has several robots; train it with `bricksrl team {env_id}`, make "
                "it with bricksrl.make_arena"
            )
            raise UnknownNameError(message) from None
        known = sorted(_specs)
        message = (
            f"there is no environment '{env_id}'{hint(env_id, known)}; choose one of "
            f"{', '.join(known)}"
        )
        raise UnknownNameError(message) from None


def _of_plan(reference: str) -> Registration:
    """Registration of what a plan's robot can learn, ``rover.ldr:walk``. Raises UnknownNameError if
    there is nothing of that name."""
    # Reading plans imports NumPy and more, which only plans need.
    from bricksrl.envs.abilities.of_plans import ability_of, task_of_plan

    ability = ability_of(reference)
    return Registration(
        lambda: task_of_plan(reference),
        episodes=ability.episodes,
        agent=ability.agent,
    )


def _user_builder(reference: str) -> Callable[..., Task]:
    """Builder of a task in the user's code, as a function of its options.

    Args:
        reference: a Python file or an importable module, a colon, and the name of a :class:`Task`
            in it or of a function that returns one; the name may be omitted for a file with a
            single task.

    Raises:
        UnknownNameError: there is no such file, module or name.
        DescriptionError: the named object is no task or has the id of a different built-in one, or
            the code raised.
    """
    missing = "`bricksrl new task FILE` writes a file with one"
    try:
        found = load_object(reference, Task, missing=missing)
    except UnknownNameError as error:
        raise UnknownNameError(f"{error}{_on_robots_in(reference)}") from None
    if not isinstance(found, Task) and not callable(found):
        raise DescriptionError(
            f"{reference} is a {type(found).__name__} and no task; name a bricksrl.envs.Task"
        )
    builder = (lambda: found) if isinstance(found, Task) else found

    @functools.wraps(builder)
    def build(**options: Any) -> Task:
        with beside(reference):
            task = builder(**options)
            if isinstance(task, BaseEnv):
                task = task_of(task)
        if not isinstance(task, Task):
            raise DescriptionError(
                f"{reference} returns a {type(task).__name__} and no task; let it return a "
                "bricksrl.envs.Task"
            )
        if task.id in _BUILT_IN and not _is_alike(_BUILT_IN[task.id].build(), task):
            raise DescriptionError(
                f"{task.id} comes with BricksRL; give your task another name or version"
            )
        return task

    return build


def _on_robots_in(reference: str) -> str:
    """What to do with a file that has no task but a robot; "" if it has neither. Raises PlanError
    if a robot's plan cannot be read, DescriptionError if the robot is wrong."""
    if not Path(reference).is_file():
        return ""
    found = objects_in(reference, Robot)
    # A plan that is missing is the first thing to mend, whatever else the file lacks.
    for robot in found.values():
        completed(robot)
    if not found:
        return ""
    command = f"bricksrl hub check {quoted(reference)} --hub virtual"
    return f"; `{command}` checks the robot that it has"


def _is_alike(task: Task, other: Task) -> bool:
    """Whether two tasks are one. Functions are not compared: each call makes new ones."""
    parts = ("doc", "robot", "interface", "max_steps", "scene")
    return all(getattr(task, part) == getattr(other, part) for part in parts)


def register(task: Task) -> None:
    """Register a task by its id for :func:`make` and, as ``bricksrl/<id>``, for Gymnasium. Raises
    DescriptionError if the id is one of the environments that come with BricksRL.

    Registering the same id again replaces the earlier task.
    """
    check_value("task", task, Task)
    if task.id in _BUILT_IN:
        raise DescriptionError(
            f"{task.id} comes with BricksRL; give your task another name or version"
        )
    _specs[task.id] = Registration(lambda: task)
    if "gymnasium" in sys.modules:
        register_with_gymnasium((task.id,))


def register_with_gymnasium(env_ids: Iterable[str] | None = None) -> None:
    """Register environments, by default all, with Gymnasium as ``bricksrl/<id>``; called when
    Gymnasium is imported."""
    import gymnasium

    for env_id in _specs if env_ids is None else env_ids:
        gym_id = f"bricksrl/{env_id}"
        gymnasium.registry.pop(gym_id, None)
        gymnasium.register(
            id=gym_id,
            entry_point="bricksrl.interfaces.gymnasium:GymnasiumEnv",
            vector_entry_point="bricksrl.interfaces.gymnasium:GymnasiumVectorEnv"
            if _specs[env_id].kinematics
            else None,
            max_episode_steps=get_task(env_id).max_steps,
            kwargs={"env_id": env_id},
        )
