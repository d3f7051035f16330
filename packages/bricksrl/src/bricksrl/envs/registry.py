"""Registry of environments. Importing it imports neither torch nor MuJoCo; making an environment
does."""

from __future__ import annotations

import functools
import inspect
import logging
import os
import re
import sys
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated, Any

from brickhub.fields import check_call, check_value
from brickhub.hub.link.profiles import profile
from brickhub.hub.transport import Pipe
from brickhub.hub.transports.address import parse_hub
from brickhub.robot import Robot
from brickhub.seed import check_seed
from brickhub.user_files import NotCode, beside, is_reference, load_object
from bricksrl.envs.arenas import ARENAS
from bricksrl.envs.base_env import BaseEnv
from bricksrl.envs.connection import Connection, Placement
from bricksrl.envs.host_sensors.host_sensor import World, reader_of
from bricksrl.envs.options import TRANSFORMS, EnvOptions
from bricksrl.envs.task import Kinematics, Task, task_of
from bricksrl.envs.tasks.line_follow import LINE_FOLLOW
from bricksrl.envs.tasks.park import PARK
from bricksrl.envs.tasks.robo_arm import robo_arm
from bricksrl.envs.tasks.robo_arm_mixed import robo_arm_mixed
from bricksrl.envs.tasks.run_away import run_away
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.envs.tasks.walker import walker
from bricksrl.envs.tasks.walker_forward import walker_forward
from bricksrl.envs.tasks.walker_streamed import WALKER_STREAMED
from bricksrl.envs.vision.camera import TwinCamera, VideoCamera
from bricksrl.errors import (
    DescriptionError,
    RunError,
    UnknownNameError,
    UnknownOptionError,
    counted,
    hint,
)
from bricktwin.robots import CART
from bricktwin.twin.make_body import check_mujoco, make_body
from bricktwin.twin.physics import RandomPhysics

if TYPE_CHECKING:
    import numpy as np
    from torchrl.envs import EnvBase

    from brickhub.hub.link.robot_link import RobotLink
    from brickhub.hub.transports.address import HubAddress
    from bricksrl.envs.robot_env import RobotEnv

_log = logging.getLogger(__name__)

Calibration = Callable[[Robot], Robot]


@dataclass(frozen=True)
class _Spec:
    """A registered environment.

    Attributes:
        build: makes the task from its options.
        kinematics: parameters of its kinematic simulation; ``None`` where a robot, real or virtual,
            runs the task.
        episodes: default length of a training run: the paper's budget, where it has one.
        note: difference from other environments of the same task.
    """

    build: Callable[..., Task]
    kinematics: Kinematics | None = None
    episodes: int = 40
    note: str = ""


def _on_robot(task: Task) -> Callable[..., Task]:
    """Builder of a task that another driving robot can do too: the option ``robot`` names its own
    or the cart of LEGO's kits."""

    def build(robot: Annotated[str, NotCode()] = task.robot.name) -> Task:
        known = {each.name: each for each in (task.robot, CART)}
        if robot not in known:
            raise DescriptionError(
                f"{task.id} is not for robot '{robot}'{hint(robot, known)}; choose "
                f"{' or '.join(known)}"
            )
        return task if robot == task.robot.name else replace(task, robot=known[robot])

    return build


_SIMULATED = " (simulated without a hub, thousands at once)"
_BUILT_IN = {
    "LineFollow-v0": _Spec(_on_robot(LINE_FOLLOW), episodes=30),
    "Park-v0": _Spec(_on_robot(PARK), episodes=30),
    "RunAway-v0": _Spec(run_away),
    "Spinning-v0": _Spec(_on_robot(SPINNING), episodes=15),
    "Walker-v0": _Spec(functools.partial(walker, "Walker-v0"), episodes=75),
    "Walker-v1": _Spec(walker_forward, episodes=75),
    "Walker-v2": _Spec(lambda: WALKER_STREAMED, episodes=12),
    "WalkerSim-v0": _Spec(
        functools.partial(walker, "WalkerSim-v0"),
        Kinematics(noise=0.1),
        episodes=75,
        note=_SIMULATED,
    ),
    "WalkerSim-v1": _Spec(
        functools.partial(walker, "WalkerSim-v1"),
        Kinematics(noise=0.02, motion="firmware"),
        episodes=75,
        note=f"{_SIMULATED[:-1]}; legs turn as the firmware turns them)",
    ),
    "RoboArm-v0": _Spec(functools.partial(robo_arm, "RoboArm-v0"), episodes=250),
    "RoboArm_mixed-v0": _Spec(functools.partial(robo_arm_mixed, "RoboArm_mixed-v0"), episodes=250),
    "RoboArmSim-v0": _Spec(
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
    """Texts that can only be the id of an environment: it is looked up here, or names one that is
    given, and is never loaded."""

    def __contains__(self, text: object) -> bool:
        return isinstance(text, str) and re.fullmatch(r"[\w-]+", text) is not None


LABELS = _Labels()


def make(
    env_id: str,
    options: EnvOptions | None = None,
    *,
    seed: int | None = None,
    batch_size: int | Sequence[int] = 0,
    device: str = "cpu",
    kinematics: Kinematics | None = None,
    place: Placement | None = None,
    **named: Any,
) -> EnvBase:
    """Make an environment: ``make("RoboArm-v0", hub="ble", sparse=True)``.

    Pickling it, unless it is a real robot's, makes a fresh one with the same options and seed;
    without a seed, with another one.

    Args:
        env_id: one of :func:`list_envs`, or the location of a user's task: ``"my_task.py:TASK"``,
            ``"module:TASK"``.
        options: connection, physics and task options.
        seed: seed of all random numbers; the same seed and actions give the same episodes, bit for
            bit.
        batch_size, device: for a kinematic simulation: number of copies (``8``, or ``[8]`` as in
            TorchRL), 0 for one without a batch dimension; and the device of its tensors.
        kinematics: for a kinematic simulation: parameters in place of the environment's.
        place: places a real robot at the start of an episode and returns when it is there; by
            default the log asks for it.
        named: single fields of :class:`EnvOptions` by name, such as ``hub`` and ``realtime``, and
            options of the task, such as ``sparse`` and ``threshold_deg`` of the RoboArm.

    Raises:
        UnknownNameError: there is no such environment or no such kind of hub.
        RunError: there is no such device.
        DescriptionError: the environment has no such option, its steps have no fixed time and
            cannot be streamed, or the seed is invalid.
    """
    check_seed(seed)
    check_value("options", options, EnvOptions | None)
    options = (options or EnvOptions()).env_options.changed(**named)
    address = parse_hub(options.hub)
    spec = _spec(env_id)
    task = _build(env_id, spec, options.options)
    check_mujoco()  # TorchRL imports it, whatever the environment
    if spec.kinematics is not None:
        names = [
            field.name for field in fields(EnvOptions) if field.name not in ("options", *TRANSFORMS)
        ]
        options.refuse(
            names,
            f"{env_id} is simulated without a robot; omit hub, realtime, physics and the like",
        )
        from bricksrl.envs.simulation import SimulatedEnv

        simulation = SimulatedEnv(
            task, kinematics or spec.kinematics, batch_size=batch_size, device=device, seed=seed
        )
        again: dict[str, Any] = {
            "batch_size": batch_size,
            "device": device,
            "kinematics": kinematics,
        }
        simulation.remake = functools.partial(make, env_id, options.as_it_is(), **again)
        return _transformed(simulation, options)
    if batch_size or device != "cpu" or kinematics is not None:
        raise DescriptionError(f"{env_id} is one robot; omit batch_size, device and kinematics")
    of_robot = _connected(task, options, place)
    from bricksrl.envs.env import HubEnv
    from bricksrl.envs.own_env import OwnEnv

    env = HubEnv(*of_robot, seed=seed) if task.base_env is None else OwnEnv(*of_robot, seed=seed)
    if address.is_virtual:
        env.remake = functools.partial(make, env_id, options.as_it_is())
    return _transformed(env, options)


def _transformed(env: EnvBase, options: EnvOptions) -> EnvBase:
    if not options.is_transformed:
        return env
    from bricksrl.envs.transforms import transformed

    return transformed(env, options)


def _virtual(task: Task, options: EnvOptions) -> Callable[[int], Connection]:
    """Connections to virtual robots, by their seed."""
    import numpy as np

    from brickhub.hub.diagnostics.calibration import calibration_of
    from brickhub.kits.virtual_kit import virtual_robot
    from brickhub.virtual.faults import with_faults
    from brickhub.virtual.virtual_transport import VirtualHub

    physics = RandomPhysics() if options.randomize else options.known_physics
    link = None if options.link is None else profile(options.link)
    warns = True  # the first robot's link; each episode has a robot, and so a link, of its own

    def connect(twin_seed: int) -> Connection:
        nonlocal warns
        body = make_body(task.robot, scene=task.scene, physics=physics, seed=twin_seed)
        faulty = with_faults(body, options.fault)
        twin = virtual_robot(faulty, realtime=options.realtime, link=link, seed=twin_seed)
        if isinstance(twin, VirtualHub):
            twin.machine.panel.near |= {
                channel.wireless for channel in task.interface.channels if channel.wireless
            }
        camera = None if task.camera is None else TwinCamera(body, task.camera)
        pose = getattr(body, "pose", None)
        world = World(pose, body, task.scene, np.random.default_rng(twin_seed), twin.now_s)
        readers = tuple(reader_of(sensor, world) for sensor in task.sensors)
        # A robot with faults is somebody's own, to which the calibration that was saved for the
        # virtual hub belongs.
        calibrate = calibration_of(twin) if options.fault and isinstance(twin, VirtualHub) else None
        robot_link = _link(task, options, twin, calibrate, warns=warns)
        warns = False
        return Connection(robot_link, twin.reset, twin, camera, pose, readers)

    return connect


def make_robot(
    env_id: str,
    options: EnvOptions | None = None,
    *,
    seed: int | None = None,
    place: Placement | None = None,
) -> RobotEnv | None:
    """The robot of an environment without TorchRL, which takes seconds to load; ``None`` where
    there is no robot, or transforms need that. Raises the errors of `make`."""
    from bricksrl.envs.robot_env import RobotEnv

    check_seed(seed)
    options = options or EnvOptions()
    spec = _spec(env_id)
    task = _build(env_id, spec, options.options)
    if spec.kinematics is not None or options.is_transformed or task.base_env is not None:
        return None
    return RobotEnv(*_connected(task, options, place), seed=seed)


def _connected(
    task: Task, options: EnvOptions, place: Placement | None
) -> tuple[Task, Callable[[int], Connection]]:
    """The task, with this computer's colours for a real robot, and connections to its robot, by a
    virtual one's seed."""
    address = parse_hub(options.hub)
    if address.is_virtual:
        return task, _virtual(task, options)
    unreal = ("realtime", "randomize", "physics", "link", "fault")
    options.refuse(
        unreal,
        "a real robot has its own time, physics, link and faults; omit realtime, physics, link "
        "and fault",
    )
    return _real(task, options, address, place)


def _real(
    task: Task, options: EnvOptions, address: HubAddress, place: Placement | None
) -> tuple[Task, Callable[[int], Connection]]:
    from brickhub.hub.diagnostics.calibration import calibration_of
    from brickhub.kits.radio import real_radio
    from bricksrl.envs.vision.color_calibration import saved_red

    def ask_to_place(_rng: np.random.Generator) -> None:
        _log.warning("%s: put the robot where an episode starts", task.id)

    camera = None if task.camera is None else VideoCamera(task.camera)
    if (
        task.camera is not None
        and task.camera.goal is not None
        and "calibration" not in options.options
    ):
        red = saved_red(task.camera.device)
        goal = task.camera.goal if red is None else replace(task.camera.goal, red=red)
        task = replace(task, camera=replace(task.camera, goal=goal))
    if task.robot.hub.model.runs_programs:
        transport = address.transport()
        link = _link(task, options, transport, calibration_of(transport))
    else:
        link = _link(task, options, real_radio(address))
    readers = tuple(reader_of(sensor, None) for sensor in task.sensors)
    connection = Connection(link, place or ask_to_place, camera=camera, sensors=readers)
    return task, lambda _seed: connection


def _link(
    task: Task,
    options: EnvOptions,
    transport: Any,
    calibrate: Calibration | None = None,
    *,
    warns: bool = True,
) -> RobotLink:
    """Link over a transport to a hub, or over a radio to devices of LEGO's kits, as the robot has
    them. ``warns`` is whether it says what it lacks."""
    from brickhub.hub.link.lockstep import HubLink
    from brickhub.hub.link.own_client import ClientLink
    from brickhub.hub.link.streaming import StreamingLink
    from brickhub.kits.link import KitLink

    if not task.robot.hub.model.runs_programs:
        options.refuse(
            ("streaming", "app_data"),
            "devices of LEGO's kits always stream; omit streaming and app_data",
        )
        return KitLink(transport, task.robot, task.interface)
    if task.client is not None:
        if options.streaming or task.streams or options.app_data:
            raise DescriptionError(
                f"{task.program} is a client of your own, which neither streams nor reads "
                "AppData; omit both"
            )
        return ClientLink(transport, task.robot, task.interface, task.client, warns=warns)
    link_type = StreamingLink if options.streaming or task.streams else HubLink
    pipe = Pipe.APP_DATA if options.app_data else Pipe.STDIN
    return link_type(transport, task.robot, task.interface, pipe=pipe, calibrate=calibrate)


COPIES_PER_CORE = 8
"""Most processes of virtual robots; more than one a core only share it."""


def make_env(
    env_id: str,
    options: EnvOptions,
    copies: int = 1,
    *,
    seed: int | None,
    device: str = "cpu",
    place: Placement | None = None,
) -> EnvBase:
    """Environment of one robot, or with batch ``[copies]``: a batched simulation, or one process
    per virtual robot, which tracks return and length of episodes. ``place`` places a real robot at
    the start position. Raises UnknownNameError if there is no such environment or hub, RunError if
    it does not support copies, or their processes cannot be started."""
    options, plain = options.env_options, options.env_options.as_it_is()
    if copies == 1:
        return make(env_id, options, seed=seed, place=place)
    from torchrl.envs import Compose, RewardSum, StepCounter, TransformedEnv

    from bricksrl.envs.env import Processes

    try:
        if is_simulation(env_id):
            env = make(env_id, plain, batch_size=copies, seed=seed, device=device)
        else:
            if copies > (most := COPIES_PER_CORE * (os.cpu_count() or 1)):
                reason = (
                    "each is a process, and this computer has "
                    f"{counted(os.cpu_count() or 1, 'core')}"
                )
                raise RunError(
                    f"{copies} copies of {env_id} are too many: {reason}; give num_envs {most} "
                    "or fewer"
                )
            env = Processes(
                copies, functools.partial(make, env_id, plain, seed=seed), mp_start_method="spawn"
            )
            env.start()
            # attributes do not cross process boundaries
            env.task = get_task(env_id, **options.options)
    except DescriptionError as error:
        raise RunError(f"cannot make {copies} copies of {env_id}: {error}") from None
    except EOFError:  # a process ended at once, as it imports the script that starts it
        raise RunError(
            f"the {copies} processes cannot start; put your script under `if __name__ == "
            "'__main__':`"
        ) from None
    return _transformed(TransformedEnv(env, Compose(RewardSum(), StepCounter())), options)


def is_simulation(env_id: str) -> bool:
    """Whether an environment is a batched kinematic simulation. Raises UnknownNameError if there is
    no such environment."""
    return _spec(env_id).kinematics is not None


def simulation_text(env_id: str) -> str:
    """How a kinematic simulation differs from the robot of its task, for its page; empty for a
    robot. Raises UnknownNameError if there is no such environment."""
    spec = _spec(env_id)
    if spec.kinematics is None:
        return ""
    task = get_task(env_id)
    kinematics = spec.kinematics
    commanded = set(task.interface.angle_indices.values())
    silent = [
        channel.name
        for index, channel in enumerate(task.interface.channels)
        if index not in commanded
    ]
    motion = (
        "at once"
        if kinematics.motion == "instant"
        else "as far as the firmware turns it in the time of a step"
    )
    noise = (
        f"normal noise with a standard deviation of {kinematics.noise:g} is added to each "
        f"{kinematics.noise_on}, in -1..1"
    )
    zeros = f" {', '.join(silent)} are always 0." if silent else ""
    start = "An episode starts at angles that are drawn from their ranges, and so are goals."
    return f"There is no hub: each motor turns by its command, {motion}; {noise}.{zeros} {start}"


def training_episodes(env_id: str) -> int:
    """Default number of training episodes of an environment. Raises UnknownNameError if there is no
    environment of that name."""
    return _spec(env_id).episodes


def list_envs() -> dict[str, str]:
    """Summary of each environment, in one line, by id."""
    return {
        env_id: _build(env_id, spec, {}).summary + spec.note
        for env_id, spec in sorted(_specs.items())
    }


def get_task(env_id: str, **options: Any) -> Task:
    """The task of an environment. Raises UnknownNameError if there is no environment of that name,
    UnknownOptionError if it has no such option."""
    return _build(env_id, _spec(env_id), options)


def options_of(env_id: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Those of the options that an environment has. Raises UnknownNameError if there is no
    environment of that name."""
    unknown = _unknown(_spec(env_id), options)
    return {name: value for name, value in options.items() if name not in unknown}


def option_types(env_id: str) -> dict[str, Any]:
    """Annotations of the options of an environment that comes with BricksRL, by name; empty for any
    other."""
    if env_id not in _BUILT_IN:
        return {}
    builder = _BUILT_IN[env_id].build
    return typing.get_type_hints(getattr(builder, "func", builder), include_extras=True)


def _unknown(spec: _Spec, options: Iterable[str]) -> list[str]:
    """Names of the options that an environment does not have."""
    parameters = inspect.signature(spec.build).parameters
    takes_all = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values())
    return [] if takes_all else [name for name in options if name not in parameters]


def _build(env_id: str, spec: _Spec, options: dict[str, Any]) -> Task:
    if unknown := _unknown(spec, options):
        raise UnknownOptionError(_unknown_option(env_id, spec, unknown[0]))
    checked = check_call(f"{env_id}: ", spec.build, options)
    try:
        return spec.build(**checked)
    except TypeError as error:
        given = ", ".join(options) or "no options"
        raise DescriptionError(
            f"{env_id} cannot be made with {given} ({error}); see its description"
        ) from error


_OF_SIMULATIONS = ("batch_size", "device", "kinematics")
"""Arguments of `make` that only kinematic simulations take."""


def _unknown_option(env_id: str, spec: _Spec, option: str) -> str:
    """What is said about an option that an environment does not have: what it has instead."""
    of_task = list(inspect.signature(spec.build).parameters)
    of_all = [
        name
        for name in inspect.signature(make).parameters
        if name not in ("env_id", "options", "named")
    ]
    if spec.kinematics is None:
        of_all = [name for name in of_all if name not in _OF_SIMULATIONS]
        of_all += [field.name for field in fields(EnvOptions) if field.name != "options"]
    else:
        of_all += TRANSFORMS
    own = f"its task has {', '.join(of_task)}" if of_task else "its task has none"
    all_have = f"all environments like it have {', '.join(of_all)}"
    python_message = f"unexpected keyword argument '{option}'"
    return (
        f"{env_id} has no option {option}{hint(option, [*of_task, *of_all])}; {own}, "
        f"{all_have} ({python_message})"
    )


def _spec(env_id: str) -> _Spec:
    check_value("env_id", env_id, str)
    if is_reference(env_id):
        return _Spec(_user_builder(env_id))
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
    found = load_object(reference, Task, missing="`bricksrl new task FILE` writes a file with one")
    if not isinstance(found, Task) and not callable(found):
        raise DescriptionError(
            f"{reference} is a {type(found).__name__} and no task; name a bricksrl.envs.Task"
        )
    builder = (lambda: found) if isinstance(found, Task) else found

    @functools.wraps(builder)
    def build(**options: Any) -> Task:
        with beside(reference):
            task = builder(**options)
            task = task_of(task) if isinstance(task, BaseEnv) else task
        if not isinstance(task, Task):
            raise DescriptionError(
                f"{reference} returns a {type(task).__name__} and no task; let it return a "
                "bricksrl.envs.Task"
            )
        built_in = _BUILT_IN[task.id].build() if task.id in _BUILT_IN else task
        if any(
            getattr(built_in, part) != getattr(task, part)
            for part in ("doc", "robot", "interface", "max_steps", "scene")
        ):
            raise DescriptionError(
                f"{task.id} comes with BricksRL; give your task another name or version"
            )
        return task

    return build


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
    _specs[task.id] = _Spec(lambda: task)
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
