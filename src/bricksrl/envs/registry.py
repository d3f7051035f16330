"""Environments by name. Importing this imports neither torch nor MuJoCo; making an environment does."""

from __future__ import annotations

import difflib
import functools
import inspect
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import gymnasium

from bricksrl.envs import own
from bricksrl.envs.kinematics import Kinematics
from bricksrl.envs.task import Task
from bricksrl.envs.tasks.robo_arm import robo_arm
from bricksrl.envs.tasks.robo_arm_mixed import robo_arm_mixed
from bricksrl.envs.tasks.run_away import RUN_AWAY
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.envs.tasks.walker import walker
from bricksrl.envs.tasks.walker_forward import WALKER_FORWARD
from bricksrl.errors import DescriptionError, UnknownNameError
from bricksrl.hub.address import parse_hub
from bricksrl.hub.transport import Pipe, Transport
from bricksrl.robots import Robot
from bricksrl.seed import check_seed
from bricksrl.twin.bodies import check_mujoco

if TYPE_CHECKING:
    import numpy as np
    from torchrl.envs import EnvBase

    from bricksrl.envs.env import HubEnv, Placement
    from bricksrl.hub.link import HubLink
    from bricksrl.hub.profile_transport import ProfileTransport
    from bricksrl.twin.physics import Physics, RandomPhysics

_log = logging.getLogger(__name__)

Calibration = Callable[[Robot], Robot]
MakeLink = Callable[..., "HubLink"]
"""The link over a transport, and with a calibration where the robot is real."""


@dataclass(frozen=True)
class _Offer:
    """An environment that can be made.

    Attributes:
        build: the task, from its options.
        kinematics: how it is simulated without a robot; ``None`` where a robot, real or virtual, carries it out.
        episodes: how long to train for: the paper's budget, where it has one.
    """

    build: Callable[..., Task]
    kinematics: Kinematics | None = None
    episodes: int = 40


_OWN = {
    "RunAway-v0": _Offer(lambda: RUN_AWAY),
    "Spinning-v0": _Offer(lambda: SPINNING, episodes=15),
    "Walker-v0": _Offer(functools.partial(walker, "Walker-v0"), episodes=75),
    "Walker-v1": _Offer(lambda: WALKER_FORWARD, episodes=75),
    "WalkerSim-v0": _Offer(functools.partial(walker, "WalkerSim-v0"), Kinematics(noise=0.1), episodes=75),
    "WalkerSim-v1": _Offer(functools.partial(walker, "WalkerSim-v1"), Kinematics(noise=0.02, motion="firmware"), episodes=75),
    "RoboArm-v0": _Offer(functools.partial(robo_arm, "RoboArm-v0"), episodes=250),
    "RoboArm_mixed-v0": _Offer(functools.partial(robo_arm_mixed, "RoboArm_mixed-v0"), episodes=250),
    "RoboArmSim-v0": _Offer(functools.partial(robo_arm, "RoboArmSim-v0"), Kinematics(noise=0.05), episodes=250),
}
_offers = dict(_OWN)


def make(
    env_id: str,
    hub: str = "virtual",
    *,
    seed: int | None = None,
    realtime: bool = False,
    physics: Physics | RandomPhysics | None = None,
    batch_size: int | Sequence[int] = 0,
    device: str = "cpu",
    kinematics: Kinematics | None = None,
    streaming: bool = False,
    app_data: bool = False,
    place: Placement | None = None,
    **options: Any,
) -> EnvBase:
    """An environment, ready to be reset.

    Args:
        env_id: one of :func:`list_envs`, or where a task of your own is written: ``"my_task.py:TASK"``, ``"module:TASK"``.
        hub: how to reach the robot; ``"virtual"`` runs the hub program on a simulated one, ``"ble"`` finds a real one over
            Bluetooth, ``"ble:NAME"`` or ``"ble:ADDRESS"`` that one, and ``"usb"`` or ``"usb:PORT"`` one on a cable.
        seed: of everything random; the same seed and actions give the same episodes, bit for bit.
        realtime: let a virtual robot take as long as a real one.
        physics: of the virtual robot: ``None`` for a freshly charged one on a smooth floor; a ``RandomPhysics`` draws
            another one for every episode.
        batch_size, device: of a simulation without a robot: number of copies (``8``, or ``[8]`` as TorchRL writes it), 0 for one
            without a batch dimension, and where its tensors live.
        kinematics: of a simulation without a robot: its noise, in place of the task's own.
        streaming: have the hub send its observations all the time, and take the latest command; steps then follow one another
            at a fixed rate, and the age of each observation is in the link's readings and statistics.
        app_data: speak to the program over AppData instead of its standard input.
        place: puts a real robot where an episode starts and returns when it is there; by default the log asks for it.
        options: of the task, such as ``sparse`` and ``threshold_deg`` of the RoboArm or ``camera`` of the one that sees.

    Raises:
        UnknownNameError: there is no such environment or no such kind of hub.
        DescriptionError: the environment has no such option, a step of it has no fixed time and cannot be streamed, or the seed
            cannot be one.
    """
    check_seed(seed)
    address = parse_hub(hub)
    offer = _offer(env_id)
    task = _build(env_id, offer, options)
    check_mujoco()  # TorchRL imports it, whatever the environment
    if offer.kinematics is not None:
        if not address.is_virtual or realtime or physics is not None or streaming or app_data:
            raise DescriptionError(f"{env_id} is simulated without a robot; leave hub, realtime, physics and the like away")
        from bricksrl.envs.simulation import SimulatedEnv

        return SimulatedEnv(task, kinematics or offer.kinematics, batch_size=batch_size, device=device, seed=seed)
    if batch_size or device != "cpu" or kinematics is not None:
        raise DescriptionError(f"{env_id} is one robot; leave batch_size, device and kinematics away")
    if not address.is_virtual and (realtime or physics is not None):
        raise DescriptionError("a real robot has a time and a physics of its own; leave realtime and physics away")

    def link_to(transport: Transport, calibrate: Calibration | None = None) -> HubLink:
        from bricksrl.hub.link import HubLink
        from bricksrl.hub.streaming import StreamingLink

        kind = StreamingLink if streaming else HubLink
        pipe = Pipe.APP_DATA if app_data else Pipe.STDIN
        return kind(transport, task.robot, task.interface, pipe=pipe, calibrate=calibrate)

    if address.is_virtual:
        return _on_twin(task, link_to, seed, realtime, physics)
    if "calibration" not in options:
        task = _with_saved_red(task)
    return _on_robot(task, address.transport(), link_to, seed, place)


def _on_twin(
    task: Task,
    link_to: MakeLink,
    seed: int | None,
    realtime: bool,
    physics: Physics | RandomPhysics | None,
) -> HubEnv:
    from bricksrl.envs.camera import TwinCamera
    from bricksrl.envs.env import Connection, HubEnv
    from bricksrl.envs.odometer import SonarOdometer, TrueOdometer
    from bricksrl.twin.virtual_hub import VirtualHub

    def connect(twin_seed: int) -> Connection:
        twin = VirtualHub(task.robot, scene=task.scene, physics=physics, seed=twin_seed, realtime=realtime)
        pose = getattr(twin.body, "pose", None)
        odometer = SonarOdometer(task.interface) if pose is None else TrueOdometer(pose)
        camera = None if task.camera is None else TwinCamera(twin.body, task.camera)
        return Connection(link_to(twin), twin.reset, odometer, twin, camera)

    return HubEnv(task, connect, seed=seed)


def _with_saved_red(task: Task) -> Task:
    """The task with what counts as red before its camera, where that was calibrated."""
    from bricksrl.envs.red import saved_red

    view = task.camera
    if view is None or view.goal is None:
        return task
    red = saved_red(view.device)
    return task if red is None else replace(task, camera=replace(view, goal=replace(view.goal, red=red)))


def _on_robot(task: Task, transport: ProfileTransport, link_to: MakeLink, seed: int | None, place: Placement | None) -> HubEnv:
    from bricksrl.envs.camera import VideoCamera
    from bricksrl.envs.env import Connection, HubEnv
    from bricksrl.envs.odometer import SonarOdometer
    from bricksrl.hub.calibration import calibration_of

    def put_back(_rng: np.random.Generator) -> None:
        _log.warning("%s: put the robot where an episode starts", task.id)

    camera = None if task.camera is None else VideoCamera(task.camera)
    calibrate = calibration_of(lambda: transport.identity.address if transport.identity else "")
    link = link_to(transport, calibrate)
    connection = Connection(link, place or put_back, SonarOdometer(task.interface), camera=camera)
    return HubEnv(task, lambda _seed: connection, seed=seed)


def training_episodes(env_id: str) -> int:
    """For how many episodes to train there, unless somebody knows better.

    Raises:
        UnknownNameError: there is no environment of that name.
    """
    return _offer(env_id).episodes


def list_envs() -> dict[str, str]:
    """Each environment's id and what it is about, in one line."""
    return {env_id: _build(env_id, offer, {}).summary for env_id, offer in sorted(_offers.items())}


def get_task(env_id: str, **options: Any) -> Task:
    """The task behind an environment.

    Raises:
        UnknownNameError: there is none of that name.
        DescriptionError: it has no such option.
    """
    return _build(env_id, _offer(env_id), options)


def _build(env_id: str, offer: _Offer, options: dict[str, Any]) -> Task:
    parameters = inspect.signature(offer.build).parameters
    unknown = [name for name in options if name not in parameters]
    if unknown and not any(one.kind is one.VAR_KEYWORD for one in parameters.values()):
        raise DescriptionError(f"{env_id} has no option {', '.join(unknown)}; it has {', '.join(parameters) or 'none'}")
    try:
        return offer.build(**options)
    except TypeError as error:
        raise DescriptionError(f"{env_id} cannot be made with {options} ({error}); see its description") from error


def _offer(env_id: str) -> _Offer:
    if own.is_reference(env_id):
        return _Offer(own.load_builder(env_id))
    try:
        return _offers[env_id]
    except KeyError:
        known = ", ".join(sorted(_offers))
        by_lower = {name.lower(): name for name in _offers}
        close = difflib.get_close_matches(env_id.lower(), by_lower, n=1)
        hint = f"did you mean '{by_lower[close[0]]}'? There are" if close else "there are"
        raise UnknownNameError(f"there is no environment '{env_id}'; {hint} {known}") from None


def register(task: Task) -> None:
    """Make a task of your own available by its id: to :func:`make` and, as ``bricksrl/<id>``, to Gymnasium.

    Registering the same id again replaces the earlier task.

    Raises:
        DescriptionError: the id is one of the environments that come with BricksRL.
    """
    if task.id in _OWN:
        raise DescriptionError(f"{task.id} comes with BricksRL; give your task another name or version")
    _offers[task.id] = _Offer(lambda: task)
    _offer_to_gymnasium(task.id)


def _offer_to_gymnasium(env_id: str) -> None:
    gym_id = f"bricksrl/{env_id}"
    gymnasium.registry.pop(gym_id, None)
    gymnasium.register(
        id=gym_id,
        entry_point="bricksrl.envs.gymnasium_env:GymnasiumEnv",
        max_episode_steps=get_task(env_id).max_steps,
        kwargs={"env_id": env_id},
    )


for _id in _OWN:
    _offer_to_gymnasium(_id)
