"""An environment's robot, without TorchRL: connection, emergency stop and pause, sensors and
commands as arrays."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from bricksrl.envs.connection import Connection, Reconnect
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.episode_state import EpisodeState, Floats
from bricksrl.envs.hub_policy import HubPolicy, most_steps
from bricksrl.envs.odometry import Odometer, SonarOdometer, TargetTracker, TrueOdometer, start_pose
from bricksrl.envs.task import Task
from bricksrl.envs.vision.camera import Camera, Watch
from bricksrl.errors import BricksError, CameraError, HubError, StoppedError

if TYPE_CHECKING:
    from brickhub.hub.link.robot_link import Reading, RobotLink
    from brickhub.hub.link.trial_link import TrialLink
    from brickhub.kits.virtual_kit import VirtualRobot

PAUSE_PERIOD_S = 0.2
"""Period of the reads during a pause, which keep the hub program's watchdog from ending it."""

_T = TypeVar("_T")


class Chance(NamedTuple):
    """What an environment draws: generators of what this computer draws and of the robot's place,
    and the seed of a virtual robot."""

    host: np.random.Generator
    place: np.random.Generator
    twin_seed: int


def chance_of(seed: int | None) -> Chance:
    """What an environment of a seed draws. Each part has a stream of its own, so that a place that
    draws more changes neither goal nor twin."""
    host, place, twin = np.random.SeedSequence(seed).spawn(3)
    return Chance(
        np.random.default_rng(host),
        np.random.default_rng(place),
        int(twin.generate_state(1)[0]),
    )


class RobotEnv(BricksEnv):
    """A task on a robot, whose observations and actions are arrays. `HubEnv` makes a TorchRL
    environment of it.

    Args:
        task: the task to run.
        connect: returns the connection, given a seed for a virtual robot. Called when the robot is
            first needed, and for a virtual robot again after each new seed, so that it starts from
            the same state.
        seed: seed of all random numbers; ``None`` for a fresh one.
    """

    task: Task
    robots = 1
    batch_size: Sequence[int] = ()
    reconnect: Reconnect

    def __init__(
        self,
        task: Task,
        connect: Callable[[int], Connection],
        *,
        seed: int | None = None,
        **of_base: Any,
    ) -> None:
        super().__init__(**of_base)
        self.task = task
        self._connect = connect
        self._connection: Connection | None = None
        self._hub_policy: HubPolicy | None = None
        self._watchers: list[Callable[[Connection], None]] = []
        self._episode: EpisodeState | None = None
        # This keeps the episode even when the link has broken.
        self._timed: EpisodeState | None = None
        self._spans: list[tuple[float, float]] = []
        """Middle and half of the range of each command."""
        for command in task.interface.commands:
            middle = (command.high + command.low) / 2
            half = (command.high - command.low) / 2
            self._spans.append((middle, half))
        self._observed = task.observed_channels
        self._buttons: list[int] = []
        """Indices of the channels of watched buttons."""
        for index, channel in enumerate(task.interface.channels):
            if channel.is_aside:
                self._buttons.append(index)
        self._is_button_down = False
        # These are the last images of the sensors.
        self._images: dict[str, NDArray[np.uint8]] = {}
        self.reconnect = Reconnect()
        # The condition guards the flags below, because any thread may stop or pause.
        self._changed = threading.Condition()
        self._is_stopped = False
        self._is_paused = False
        # A stop is only confirmed once the motors of a real robot are known to stand still.
        self._is_confirmed = False
        self._set_seed(seed)

    def close(self, **_: Any) -> None:
        """Stop the robot and close the link; `begin` opens it again."""
        self._close_link()

    @property
    def twin(self) -> VirtualRobot | None:
        return self._connected().twin

    def watch(self, watcher: Callable[[Connection], None]) -> Callable[[], None]:
        self._watchers.append(watcher)
        if self._connection is not None:
            watcher(self._connection)
        return lambda: self._watchers.remove(watcher)

    def stop(self) -> None:
        # The flag is set first. It ends a wait, and keeps a link that is just opening from moving.
        with self._changed:
            self._is_stopped = True
            self._is_confirmed = False
            self._changed.notify_all()
        connection = self._connection
        if connection is None:
            # Without a connection nothing moves.
            self._is_confirmed = True
            return
        was_open = connection.link.is_open
        # This returns when a real hub says that the program has ended.
        connection.link.emergency_stop()
        self._is_confirmed = was_open

    @property
    def has_stopped(self) -> bool:
        connection = self._connection
        if connection is None or connection.twin is None:
            return self._is_confirmed
        return not connection.twin.machine.is_driven

    def pause(self) -> None:
        with self._changed:
            self._is_paused = True

    def resume(self) -> None:
        if self._connection is not None:
            self._connection.link.release()
        with self._changed:
            self._is_stopped = self._is_paused = False
            self._changed.notify_all()

    @property
    def is_paused(self) -> bool:
        return self._is_paused

    @property
    def episode(self) -> EpisodeState | None:
        return self._episode

    @property
    def is_cut(self) -> bool:
        return self._episode is not None and self._episode.is_cut

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
        self._host_rng, self._place_rng, self._twin_seed = chance_of(seed)
        if self._connection is not None and self._connection.twin is not None:
            self._close_link()
            self._connection = None

    def begin(self) -> EpisodeState:
        """Begin an episode: place the robot and read its sensors. Raises HubError if it cannot be
        reached."""
        reading = self._guarded(self._start)
        link = self._connected().link
        true_pose = self._connected().true_pose
        task = self.task
        measured_s = link.now_s() - reading.age_s
        # The order of the draws (entries, target, camera) must not change, because seeded runs rely
        # on it.
        drawn = [entry.draw(self._host_rng) for entry in task.sampled_entries]
        tracker = None
        if task.target is not None:
            start = start_pose(
                task.scene,
                task.id,
                true_pose,
                self._host_rng,
            )
            tracker = TargetTracker(
                task.target,
                task.robot,
                task.interface,
                true_pose,
                start,
                reading.values,
            )
        odometer: Odometer
        if true_pose is None:
            odometer = SonarOdometer(task.interface)
        else:
            odometer = TrueOdometer(true_pose, link.now_s())
        # The first call only notes where the episode starts.
        odometer.forward_mm(link.now_s(), reading.values)
        episode = EpisodeState(
            drawn=drawn,
            commands=[0.0] * len(task.command_entries),
            measured_s=measured_s,
            odometer=odometer,
            zeros=self._zeros(reading),
            tracker=tracker,
        )
        if task.camera is not None:
            frame = self._guarded(self._camera.frame)
            episode.watch = Watch(task.camera, self._host_rng, frame)
        self._episode = self._timed = episode
        # A button that is still held means what was before this episode.
        self._is_button_down = self._is_down(reading)
        episode.observation = self._observation_at_start(episode, reading)
        episode.images = self.image()
        return episode

    def _zeros(self, reading: Reading) -> list[float]:
        """Numbers that are subtracted from the observed channels, because an accumulating one
        starts at 0."""
        zeros = []
        for index in self._observed:
            accumulates = self.task.interface.channels[index].accumulates
            zeros.append(reading.values[index] if accumulates else 0.0)
        return zeros

    def _observation_at_start(
        self,
        episode: EpisodeState,
        reading: Reading,
    ) -> Floats:
        """Hook: the first observation of an episode."""
        nothing_measured = [0.0] * len(self.task.measured_entries)
        return episode.observe(self._channels(reading, episode), nothing_measured)

    def move(self, shares: Sequence[float]) -> Floats:
        """The observation ``[n]`` after a step with the action ``[m]``, in -1..1. Raises
        BricksError without an episode, HubError if the link broke."""
        episode = self._episode
        link = self._connected().link
        if episode is None:
            raise BricksError(f"{self.task.id} has no episode to step; reset the environment first")
        commands = self._commanded(episode, shares)
        return self._measure(self._guarded(lambda: self._acted(link, commands, episode)), episode)

    def _acted(
        self,
        link: RobotLink,
        commands: Sequence[float],
        episode: EpisodeState,
    ) -> Reading:
        """The reading after a step: of these commands, or of a trial that the hub makes by
        itself."""
        policy = self._hub_policy
        if policy is None:
            return link.act(commands)
        numbers, steps = policy.next_trial()
        most = most_steps(self.task.interface)
        # A trial ends with its episode: what came after it would be of no episode.
        left = self.task.max_steps - episode.step_count
        of_hub = cast("TrialLink", link)
        return of_hub.step(numbers, min(steps or most, most, left))

    def act_by_trials(self, policy: HubPolicy | None) -> None:
        # There is nothing to undo either.
        if self.connect_to is None or policy is self._hub_policy:
            return
        self._close_link()
        self._connection = None
        self._connect = self.connect_to(policy)
        self._hub_policy = policy

    def _commanded(
        self,
        episode: EpisodeState,
        shares: Sequence[float],
    ) -> list[float]:
        """The commands of an action, in their units; notes when they are given."""
        commands = [
            middle + half * share for (middle, half), share in zip(self._spans, shares, strict=True)
        ]
        episode.age_s = self._connected().link.now_s() - episode.measured_s
        if self.task.observes_commands:
            episode.commands = commands
        return commands

    def image(self) -> dict[str, NDArray[np.uint8]]:
        """The last images ``[side, side, 3]``: the camera's as ``image``, and those of sensors by
        their names."""
        images = dict(self._images)
        watch = None if self._episode is None else self._episode.watch
        if watch is not None:
            images["image"] = watch.image
        return images

    def _measure(
        self,
        reading: Reading,
        episode: EpisodeState,
    ) -> Floats:
        """The observation for the task's functions after a step; reads odometer and camera only
        where the task uses them."""
        was_down = self._is_button_down
        self._is_button_down = self._is_down(reading)
        if self._is_button_down and not was_down:
            self.on_button()
        episode.measured_s = self._connected().link.now_s() - reading.age_s
        episode.hub_time_s = reading.hub_time_ms / 1000
        forward_mm: list[float] = []
        if self.task.walks or self.task.measured_entries:
            now_s = self._connected().link.now_s()
            forward_mm = [episode.odometer.forward_mm(now_s, reading.values)]
        if episode.tracker is not None:
            episode.tracker.follow(reading.values)
        if episode.watch is not None:
            episode.watch.see(self._guarded(self._camera.frame))
        # A task may report the distance without observing it.
        measured = forward_mm[: len(self.task.measured_entries)]
        return episode.observe(self._channels(reading, episode), measured)

    def _is_down(self, reading: Reading) -> bool:
        """Whether a watched button is down."""
        return any(reading.values[index] > 0.0 for index in self._buttons)

    def _channels(
        self,
        reading: Reading,
        episode: EpisodeState,
    ) -> list[float]:
        """The channels that are in the observation, and the readings of sensors on the computer;
        notes their images."""
        values = [
            reading.values[index] - zero
            for index, zero in zip(self._observed, episode.zeros, strict=True)
        ]
        for reader in self._connected().sensors:
            sensor = reader.sensor
            (sensed, age_s) = self._guarded(reader.latest)
            if sensor.image_px:
                self._images[sensor.name] = np.array(sensed, dtype=np.uint8)
            else:
                values += sensed
            if sensor.observes_age:
                values.append(age_s)
        return values

    @property
    def timing(self) -> EpisodeState:
        if self._timed is None or not self._timed.step_count:
            raise BricksError(f"{self.task.id} has made no step yet; make one first")
        return self._timed

    def walk_metrics(self) -> dict[str, float]:
        if self._episode is None:
            return {}
        metrics: dict[str, float] = {}
        if self.task.walks:
            metrics |= self._episode.odometer.metrics()
        if self._episode.tracker is not None:
            metrics |= self._episode.tracker.metrics()
        return metrics

    @property
    def _camera(self) -> Camera:
        camera = self._connected().camera
        if camera is None:
            raise CameraError(
                f"{self.task.id} needs a camera, and the connection to the robot has none; "
                "give it one"
            )
        return camera

    def _connected(self) -> Connection:
        if self._connection is None:
            self._connection = self._connect(self._twin_seed)
            for watcher in self._watchers:
                watcher(self._connection)
            twin = self._connection.twin
            if twin is not None:
                # The twin may break its link by itself, by a fault of the robot, and a test may
                # take it out of reach as well.
                by_itself = twin.in_reach
                twin.in_reach = lambda: by_itself() and self.in_reach()
            # A stop that was requested before this had no link to act on.
            self._check_stop()
        return self._connection

    def _start(self) -> Reading:
        """Place the robot and read its sensors, after the end of a pause, in which reading feeds
        the hub program's watchdog."""
        connection = self._connected()
        with self.reconnect.by_hand():
            while not self._waited(PAUSE_PERIOD_S):
                if connection.link.is_open:
                    connection.link.read()
        # A stop may have come during the pause.
        self._check_stop()
        # This has no effect on a link that is already open.
        connection.link.open()
        for reader in connection.sensors:
            reader.open()
        with self.reconnect.by_hand():
            connection.place(self._place_rng)
        return connection.link.read()

    def _waited(self, timeout_s: float) -> bool:
        """Wait for the end of a pause, or a stop; True if there is no pause or there is a stop."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._is_stopped or not self._is_paused,
                timeout_s,
            )

    def _check_stop(self) -> None:
        """Raise StoppedError if a stop is requested."""
        if self._is_stopped:
            raise StoppedError(
                "the robot was stopped by hand; call resume() when it may move again"
            )

    def _guarded(self, exchange: Callable[[], _T]) -> _T:
        """Run an exchange with hub or camera; on failure close the link: the motors stop, and the
        next reset reopens it."""
        try:
            return exchange()
        except (HubError, CameraError, StoppedError):
            self._close_link()
            raise

    def _close_link(self) -> None:
        self._episode = None
        if self._connection is not None:
            self._connection.link.close()
            for reader in self._connection.sensors:
                reader.close()
            if self._connection.camera is not None:
                self._connection.camera.close()
