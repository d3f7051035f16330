"""Making an environment: a task with its robot, simulation or copies, and the transforms of its
options. Importing it imports neither torch nor MuJoCo; calling it does."""

from __future__ import annotations

import functools
import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, Literal, overload

from brickhub.fields import check_value
from brickhub.hub.link.profiles import profile
from brickhub.hub.transport import Pipe
from brickhub.hub.transports.address import parse_hub
from brickhub.robot import Robot
from brickhub.seed import check_seed
from bricksrl.envs.connection import Connection, Placement
from bricksrl.envs.env_interface import Connect
from bricksrl.envs.host_sensors.host_sensor import World, reader_of
from bricksrl.envs.hub_policy import by_steps_because
from bricksrl.envs.options import TRANSFORMS, EnvOptions
from bricksrl.envs.registry import Registration, is_simulation, registration, task_with
from bricksrl.envs.task import Kinematics, Task
from bricksrl.envs.vision.camera import TwinCamera, VideoCamera
from bricksrl.envs.watched_button import watching
from bricksrl.errors import DescriptionError, RunError, counted
from bricktwin.twin.make_body import check_mujoco, make_body
from bricktwin.twin.physics import RandomPhysics

if TYPE_CHECKING:
    import numpy as np
    from torchrl.envs import EnvBase

    from brickhub.hub.link.robot_link import RobotLink
    from brickhub.hub.transports.address import HubAddress
    from bricksrl.envs.hub_policy import HubPolicy
    from bricksrl.envs.robot_env import RobotEnv

_log = logging.getLogger(__name__)

Calibration = Callable[[Robot], Robot]

COPIES_PER_CORE = 8
"""Largest number of processes of virtual robots for each core; more only share it."""

_OMIT_BATCH = "omit batch_size, device and kinematics"


@overload
def make(
    env_id: str,
    options: EnvOptions | None = None,
    *,
    seed: int | None = None,
    copies: int = 1,
    batch_size: int | Sequence[int] | None = None,
    device: str = "cpu",
    kinematics: Kinematics | None = None,
    place: Placement | None = None,
    watched_button: str | None = None,
    arrays: Literal[False] = False,
    **named: Any,
) -> EnvBase: ...
@overload
def make(
    env_id: str,
    options: EnvOptions | None = None,
    *,
    seed: int | None = None,
    place: Placement | None = None,
    arrays: Literal[True],
    **named: Any,
) -> RobotEnv: ...
def make(
    env_id: str,
    options: EnvOptions | None = None,
    *,
    seed: int | None = None,
    copies: int = 1,
    batch_size: int | Sequence[int] | None = None,
    device: str = "cpu",
    kinematics: Kinematics | None = None,
    place: Placement | None = None,
    watched_button: str | None = None,
    arrays: bool = False,
    **named: Any,
) -> EnvBase | RobotEnv:
    """Make an environment: ``make("RoboArm-v0", hub="ble", sparse=True)``.

    Pickling it, unless it is a real robot's, makes a fresh one with the same options and seed;
    without a seed, with another one.

    Args:
        env_id: one of :func:`list_envs`, or the location of a user's task: ``"my_task.py:TASK"``,
            ``"module:TASK"``.
        options: connection, physics and task options.
        seed: seed of all random numbers; the same seed and actions give the same episodes, bit for
            bit.
        copies: number of environments side by side for training, with batch ``[copies]``: a batched
            simulation, or one process for each virtual robot. They track return and length of their
            episodes by TorchRL's ``RewardSum`` and ``StepCounter``.
        batch_size, device: for a kinematic simulation: number of copies (``8``, or ``[8]`` as in
            TorchRL) without these, by default one without a batch dimension; and the device of its
            tensors.
        kinematics: for a kinematic simulation: parameters in place of the environment's.
        place: places a real robot at the start of an episode and returns when it is there; by
            default the log asks for it.
        watched_button: button of the hub, such as ``"left"``, or of a remote,
            ``"remote.left_plus"``; the environment's ``on_button`` is called when it is pressed.
        arrays: make the robot alone, whose observations and actions are arrays, without TorchRL,
            which takes seconds to load; `has_arrays` tells which environments have one.
        named: single fields of :class:`EnvOptions` by name, such as ``hub`` and ``realtime``, and
            options of the task, such as ``sparse`` and ``threshold_deg`` of the RoboArm.

    Raises:
        UnknownNameError: there is no such environment or no such kind of hub.
        RunError: there is no such device, the environment cannot have so many copies, or their
            processes cannot be started.
        DescriptionError: the environment has no such option, its steps have no fixed time and
            cannot be streamed, or the seed is invalid.
    """
    check_seed(seed)
    check_value("options", options, EnvOptions | None)
    options = (options or EnvOptions()).env_options.changed(**named)
    is_plain = batch_size is None and device == "cpu" and kinematics is None
    if arrays:
        if copies != 1 or watched_button is not None or not is_plain:
            raise DescriptionError(f"{env_id} with arrays is one robot; omit arrays, or the rest")
        return _make_robot(env_id, options, seed, place)
    if copies != 1:
        if watched_button is not None:
            raise DescriptionError("copies have no buttons that anybody watches; omit the button")
        if copies < 1 or batch_size is not None:
            raise DescriptionError("copies are 1 or more; give either copies or batch_size")
        return _make_copies(
            env_id,
            options,
            copies,
            seed,
            device,
            kinematics,
        )
    # Wrong options are refused before anything is loaded that takes seconds.
    address = parse_hub(options.hub)
    spec = registration(env_id)
    task = task_with(env_id, options)
    if watched_button is not None:
        if spec.kinematics is not None:
            raise DescriptionError(f"{env_id} is simulated without a hub; omit its button")
        task = watching(task, watched_button)
    # TorchRL imports MuJoCo, whatever the environment.
    check_mujoco()
    if spec.kinematics is not None:
        simulation = _make_simulation(
            env_id,
            spec,
            task,
            options,
            seed,
            batch_size,
            device,
            kinematics,
        )
        return _transformed(simulation, options)
    if not is_plain:
        raise DescriptionError(f"{env_id} is one robot; {_OMIT_BATCH}")
    described, connect = _connected(task, options, place)
    from bricksrl.envs.env import HubEnv
    from bricksrl.envs.own_env import OwnEnv

    env_type = HubEnv if task.base_env is None else OwnEnv
    env = env_type(described, connect, seed=seed)
    env.by_steps_because = by_steps_because(task, options)
    if not env.by_steps_because:
        env.connect_to = functools.partial(_connections_to, task, options, place)
    if address.is_virtual:
        # A real robot's environment has no `remake`, because there cannot be two links to one hub.
        env.remake = functools.partial(make, env_id, options.as_it_is())
    return _transformed(env, options)


def has_arrays(env_id: str, options: EnvOptions | None = None) -> bool:
    """Whether `make` gives the robot of an environment alone, with ``arrays``: not where there is
    no robot, nor where transforms or the task's own resets and steps need TorchRL. Raises
    UnknownNameError and DescriptionError as `make`."""
    options = options or EnvOptions()
    spec = registration(env_id)
    task = task_with(env_id, options)
    return spec.kinematics is None and not options.is_transformed and task.base_env is None


def _make_robot(
    env_id: str,
    options: EnvOptions,
    seed: int | None,
    place: Placement | None,
) -> RobotEnv:
    from bricksrl.envs.robot_env import RobotEnv

    task = task_with(env_id, options)
    if not has_arrays(env_id, options):
        raise DescriptionError(f"{env_id} has no robot that works with arrays alone; omit arrays")
    described, connect = _connected(task, options, place)
    return RobotEnv(described, connect, seed=seed)


def _make_simulation(
    env_id: str,
    spec: Registration,
    task: Task,
    options: EnvOptions,
    seed: int | None,
    batch_size: int | Sequence[int] | None,
    device: str,
    kinematics: Kinematics | None,
) -> EnvBase:
    """A kinematic simulation, without transforms."""
    of_robots = [
        field.name for field in fields(EnvOptions) if field.name not in ("options", *TRANSFORMS)
    ]
    options.refuse(
        of_robots,
        f"{env_id} is simulated without a robot; omit hub, realtime, physics and the like",
    )
    from bricksrl.envs.simulation import SimulatedEnv

    chosen = kinematics or spec.kinematics
    if chosen is None:
        raise DescriptionError(f"{env_id} has no kinematic simulation; choose another environment")
    simulation = SimulatedEnv(
        task,
        chosen,
        batch_size=() if batch_size is None else batch_size,
        device=device,
        seed=seed,
    )
    # The pickled environment has no transforms of its own, because TorchRL pickles those around it.
    simulation.remake = functools.partial(
        make,
        env_id,
        options.as_it_is(),
        batch_size=batch_size,
        device=device,
        kinematics=kinematics,
    )
    return simulation


def _make_copies(
    env_id: str,
    options: EnvOptions,
    copies: int,
    seed: int | None,
    device: str,
    kinematics: Kinematics | None,
) -> EnvBase:
    """Copies that count: a batched simulation or processes, then the counters, then the transforms
    of the options, so that the counters hold the environment's own rewards and steps."""
    from torchrl.envs import Compose, RewardSum, StepCounter, TransformedEnv

    plain = options.as_it_is()
    try:
        if is_simulation(env_id):
            env = make(
                env_id,
                plain,
                batch_size=copies,
                seed=seed,
                device=device,
                kinematics=kinematics,
            )
        elif device != "cpu" or kinematics is not None:
            raise DescriptionError(f"{env_id} is a robot; {_OMIT_BATCH}")
        else:
            env = _make_processes(env_id, plain, copies, seed)
    except DescriptionError as error:
        raise RunError(f"cannot make {copies} copies of {env_id}: {error}") from None
    except EOFError:
        # A process ended at once, because it imports the script that starts it.
        raise RunError(
            f"the {copies} processes cannot start; put your script under `if __name__ == "
            "'__main__':`"
        ) from None
    return _transformed(TransformedEnv(env, Compose(RewardSum(), StepCounter())), options)


def _make_processes(
    env_id: str,
    plain: EnvOptions,
    copies: int,
    seed: int | None,
) -> EnvBase:
    from bricksrl.envs.env import Processes

    cores = os.cpu_count() or 1
    most = COPIES_PER_CORE * cores
    if copies > most:
        reason = f"each is a process, and this computer has {counted(cores, 'core')}"
        raise RunError(
            f"{copies} copies of {env_id} are too many: {reason}; give num_envs {most} or fewer"
        )
    make_one = functools.partial(
        make,
        env_id,
        plain,
        seed=seed,
    )
    # Processes are spawned and not forked, because threads of torch and MuJoCo do not survive a
    # fork.
    env = Processes(copies, make_one, mp_start_method="spawn")
    env.start()
    # Attributes do not cross process boundaries, so the task is built here as well.
    env.task = task_with(env_id, plain)
    return env


def _transformed(env: EnvBase, options: EnvOptions) -> EnvBase:
    if not options.is_transformed:
        return env
    from bricksrl.envs.transforms import transformed

    return transformed(env, options)


def _connected(
    task: Task,
    options: EnvOptions,
    place: Placement | None,
    policy: HubPolicy | None = None,
) -> tuple[Task, Callable[[int], Connection]]:
    """The task, with this computer's colours for a real robot, and connections to its robot, by a
    virtual one's seed. ``policy``: what its hub acts by; by default the computer acts."""
    address = parse_hub(options.hub)
    if address.is_virtual:
        return task, _virtual(task, options, policy)
    unreal = ("realtime", "randomize", "physics", "link", "scene", "fault")
    options.refuse(
        unreal,
        "a real robot has its own time, physics, link, surroundings and faults; omit realtime, "
        "physics, link, scene and fault",
    )
    return _real(
        task,
        options,
        address,
        place,
        policy,
    )


def _connections_to(
    task: Task,
    options: EnvOptions,
    place: Placement | None,
    policy: HubPolicy | None,
) -> Connect:
    """Connections to a robot whose hub acts by a policy, or by none."""
    _, connect = _connected(task, options, place, policy)
    return connect


def _virtual(
    task: Task,
    options: EnvOptions,
    policy: HubPolicy | None,
) -> Callable[[int], Connection]:
    """Connections to virtual robots, by their seed."""
    import numpy as np

    from brickhub.hub.diagnostics.calibration import calibration_of
    from brickhub.kits.virtual_kit import virtual_robot
    from brickhub.virtual.faults import with_faults
    from brickhub.virtual.virtual_transport import VirtualHub

    physics = RandomPhysics() if options.randomize else options.known_physics
    link = None if options.link is None else profile(options.link)
    # Only the first robot's link warns. Each episode has its own robot, and so its own link.
    warns = True

    def connect(twin_seed: int) -> Connection:
        nonlocal warns
        body = make_body(
            task.robot,
            scene=task.scene,
            physics=physics,
            seed=twin_seed,
        )
        faulty = with_faults(body, options.fault)
        twin = virtual_robot(
            faulty,
            realtime=options.realtime,
            link=link,
            seed=twin_seed,
        )
        if isinstance(twin, VirtualHub):
            # The devices that the task's channels read by radio are near, so that the program can
            # connect to them.
            twin.machine.panel.near |= {
                channel.wireless for channel in task.interface.channels if channel.wireless
            }
        camera = None if task.camera is None else TwinCamera(body, task.camera)
        # A body on a bench goes nowhere, and so has no pose.
        pose = getattr(body, "pose", None)
        world = World(
            pose,
            body,
            task.scene,
            np.random.default_rng(twin_seed),
            twin.now_s,
        )
        readers = tuple(reader_of(sensor, world) for sensor in task.sensors)
        # A robot with faults stands for somebody's own one, so the calibration that was saved for
        # the virtual hub applies to it.
        calibrate = calibration_of(twin) if options.fault and isinstance(twin, VirtualHub) else None
        robot_link = _link(
            task,
            options,
            twin,
            calibrate,
            policy,
            warns=warns,
        )
        warns = False
        return Connection(
            robot_link,
            twin.reset,
            twin,
            camera,
            pose,
            readers,
        )

    return connect


def _real(
    task: Task,
    options: EnvOptions,
    address: HubAddress,
    place: Placement | None,
    policy: HubPolicy | None,
) -> tuple[Task, Callable[[int], Connection]]:
    from brickhub.hub.diagnostics.calibration import calibration_of
    from brickhub.kits.radio import real_radio

    def ask_to_place(_rng: np.random.Generator) -> None:
        _log.warning("%s: put the robot where an episode starts", task.id)

    camera = None if task.camera is None else VideoCamera(task.camera)
    # A calibration that is given goes before the one that was saved here.
    if "calibration" not in options.options:
        task = _with_saved_red(task)
    if task.robot.hub.model.runs_programs:
        transport = address.transport(task.robot.hub)
        link = _link(
            task,
            options,
            transport,
            calibration_of(transport),
            policy,
        )
    else:
        link = _link(task, options, real_radio(address))
    readers = tuple(reader_of(sensor, None) for sensor in task.sensors)
    connection = Connection(
        link,
        place or ask_to_place,
        camera=camera,
        sensors=readers,
    )
    return task, lambda _seed: connection


def _with_saved_red(task: Task) -> Task:
    """The task with the red that was calibrated for its camera on this computer, if any was."""
    from bricksrl.envs.vision.color_calibration import saved_red

    if task.camera is None or task.camera.goal is None:
        return task
    red = saved_red(task.camera.device)
    goal = task.camera.goal if red is None else replace(task.camera.goal, red=red)
    return replace(task, camera=replace(task.camera, goal=goal))


def _link(
    task: Task,
    options: EnvOptions,
    transport: Any,
    calibrate: Calibration | None = None,
    policy: HubPolicy | None = None,
    *,
    warns: bool = True,
) -> RobotLink:
    """Link over a transport to a hub, or over a radio to devices of LEGO's kits, as the robot has
    them. ``policy`` is what the hub acts by itself; ``warns`` is whether the link says what it
    lacks."""
    from brickhub.hub.link.lockstep import HubLink
    from brickhub.hub.link.own_client import ClientLink
    from brickhub.hub.link.streaming import StreamingLink
    from brickhub.hub.link.trial_link import TrialLink
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
        return ClientLink(
            transport,
            task.robot,
            task.interface,
            task.client,
            warns=warns,
        )
    pipe = Pipe.APP_DATA if options.app_data else Pipe.STDIN
    if policy is not None:
        return TrialLink(
            transport,
            task.robot,
            task.interface,
            policy.numbers,
            policy.source,
            tilt_deg=policy.tilt_deg,
            pipe=pipe,
            calibrate=calibrate,
        )
    link_type = StreamingLink if options.streaming or task.streams else HubLink
    return link_type(
        transport,
        task.robot,
        task.interface,
        pipe=pipe,
        calibrate=calibrate,
    )
