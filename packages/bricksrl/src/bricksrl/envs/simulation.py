"""Kinematic simulation: batched copies of a task without a robot, on any device.

Each commanded motor turns by its command, at once (``angle += command``) or as far as the
firmware's trajectory gets in the task's step time. Endless motors wrap into 0..360 degrees, joints
stop at their range, as on the hub. Other channels read 0.

The firmware's ``run_angle`` starts at the position and speed of the previous command's reference
and follows a trapezoidal speed profile (accelerate, cruise, decelerate) to the target, which is
relative to that position. `turned_angle` is this trajectory in closed form (as in Pybricks'
``pbio/trajectory.c``), without the firmware's integer rounding and the motor's lag behind its
reference: together less than two degrees, which a test checks against the firmware's values.

The state is stored as ``[n, copies]``, so that all arithmetic runs along contiguous memory, which
is twice as fast. Outputs are transposed views.
"""

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from brickhub.hub.interface import RunAngle
from bricksrl.envs.env_interface import BricksEnv
from bricksrl.envs.specs import clamped, set_vector_specs
from bricksrl.envs.task import Kinematics, Task
from bricksrl.errors import BricksError, DescriptionError, RunError

ACCELERATION_DEG_S2 = 2000.0
"""Acceleration and deceleration in Pybricks, for every motor of our robots."""


class SimulatedEnv(BricksEnv, EnvBase):  # type: ignore[misc]
    """``batch_size`` independent copies of a task; keys and specs are those of
    :class:`~bricksrl.envs.env.HubEnv`, without ``link_lost`` and ``image``. Raises DescriptionError
    if the task has commands, motors or entries that kinematics do not know, or the batch size is
    invalid; RunError if there is no such device.

    Args:
        task: a task whose commands all turn motors, and whose motor channels are all commanded.
        kinematics: motion and noise.
        batch_size: number of copies, as an integer or as in TorchRL (``[8]``); 0 or ``[]`` for one
            without a batch dimension.
        device: device of the tensors, as for `resolve_device`.
        seed: seed of starts, goals and noise.
    """

    task: Task

    def __init__(
        self,
        task: Task,
        kinematics: Kinematics,
        *,
        batch_size: int | Sequence[int] = 0,
        device: str | torch.device = "cpu",
        seed: int | None = None,
    ) -> None:
        shape = batch_shape(batch_size)
        super().__init__(batch_size=shape, device=resolve_device(device))
        motors = len(task.interface.commands)
        self.task = task
        self._action_shape = torch.Size((*shape, motors))
        self._kinematics = kinematics
        self._rng = torch.Generator(self.device)
        indices = self._commanded_channels(task)
        self._plan_motion(task, indices)
        self._plan_starts(task, indices)
        set_vector_specs(self, task)
        self._set_seed(seed)
        self._copies = shape.numel()
        self._state = torch.zeros(len(task.entries), self._copies, device=self.device)
        self._steps = torch.zeros(
            self._copies,
            1,
            dtype=torch.int32,
            device=self.device,
        )
        self._speed = torch.zeros(motors, self._copies, device=self.device)

    @staticmethod
    def _commanded_channels(task: Task) -> list[int]:
        """Index of the angle channel of each command's motor. Raises DescriptionError for what
        kinematics do not know."""
        commands = task.interface.commands
        if task.measured_entries or task.observes_commands or task.has_hidden_entries:
            unknown = "distances, last commands, targets and cameras"
            raise DescriptionError(
                f"{task.id} cannot be simulated; kinematics know nothing of {unknown}"
            )
        angle_index = task.interface.angle_indices
        turns = [command for command in commands if isinstance(command, RunAngle)]
        motors = {turn.motor for turn in turns}
        if len(turns) < len(commands) or motors != set(angle_index):
            raise DescriptionError(
                f"{task.id} cannot be simulated; every motor needs a RunAngle command and an "
                "angle channel"
            )
        return [angle_index[turn.motor] for turn in turns]

    def _column(self, values: list[float]) -> Tensor:
        """Values of commands or entries as ``[n, 1]``, which go along with all copies."""
        return torch.tensor(values, dtype=torch.float32, device=self.device)[:, None]

    def _plan_motion(
        self,
        task: Task,
        indices: list[int],
    ) -> None:
        """Convert the task's commands and their channels into tensors, with one row per command."""
        commands = task.interface.commands
        angles = [task.interface.channels[index] for index in indices]
        self._middle = self._column([(command.low + command.high) / 2 for command in commands])
        self._half = self._column([(command.high - command.low) / 2 for command in commands])
        self._noise = self._kinematics.noise * self._half
        speeds_deg_s: list[float] = [
            turn.speed_deg_s for turn in commands if isinstance(turn, RunAngle)
        ]
        self._limit = self._column(speeds_deg_s)
        step_ms = task.interface.settle.fixed_ms
        is_instant = self._kinematics.motion == "instant"
        is_endless = all(angle.wraps for angle in angles)
        # End stops are not modelled, and at an end stop the motion differs from the firmware's
        # trajectory.
        if not is_instant and (step_ms is None or not is_endless):
            raise DescriptionError(
                f"{task.id} cannot be simulated with the firmware's motion; it needs a Wait, and "
                "motors without ends"
            )
        # Without a fixed time, a motion lasts until the next command.
        self._time_s = None if is_instant or step_ms is None else step_ms / 1000
        self._low = self._column([angle.low for angle in angles])
        self._high = self._column([angle.high for angle in angles])
        # Wrapping and stopping are one formula, to need no branch for each motor: whole turns are
        # subtracted for endless ones, and then all angles are clamped.
        wraps = self._column([float(angle.wraps) for angle in angles])
        self._turns_per_deg = wraps / 360.0
        self._deg_per_turn = wraps * 360.0
        # If the commanded motors are contiguous, a slice selects them without a copy.
        first = indices[0]
        end = first + len(indices)
        is_contiguous = indices == list(range(first, end))
        self._angles: slice | Tensor = (
            slice(first, end) if is_contiguous else torch.tensor(indices, device=self.device)
        )

    def _plan_starts(
        self,
        task: Task,
        indices: list[int],
    ) -> None:
        """Ranges of the entries that a reset draws uniformly; the others read 0."""
        channels = len(task.interface.channels)
        drawn = {*indices, *range(channels, len(task.entries))}
        is_whole = [False] * channels + [entry.whole for entry in task.sampled_entries]
        lows = []
        spans = []
        for index, entry in enumerate(task.entries):
            # Integers are rounded down, so their range ends at high + 1.
            end = entry.high + is_whole[index]
            lows.append(entry.low if index in drawn else 0.0)
            spans.append(end - entry.low if index in drawn else 0.0)
        self._whole = torch.tensor(is_whole, device=self.device)[:, None]
        self._start_low = self._column(lows)
        self._start_span = self._column(spans)

    def _set_seed(self, seed: int | None) -> None:
        self._seed = seed
        reseed(self._rng, seed)

    def maybe_reset(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Reset the copies that are done, and only those: resetting all would dominate the time of
        a step."""
        done = tensordict.get("done").view(-1)
        ended = done.nonzero().squeeze(1)
        if len(ended):
            self._start(ended)
            tensordict.set("observation", self._out(self._state.t()))
            for key in self.done_keys:
                tensordict.set(key, torch.zeros_like(tensordict.get(key)))
        return tensordict

    def _reset(
        self,
        tensordict: TensorDictBase | None = None,
        **_kwargs: Any,
    ) -> TensorDictBase:
        self.is_closed = False
        mask = tensordict.get("_reset", None) if tensordict is not None else None
        if mask is None:
            copies = torch.arange(self._copies, device=self.device)
        else:
            copies = mask.view(-1).nonzero().squeeze(1)
        self._start(copies)
        observation = self._out(self._state.t())
        return TensorDict({"observation": observation}, self.batch_size, device=self.device)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        if self.is_closed:
            raise BricksError(f"{self.task.id} has no episode to step; reset the environment first")
        given = clamped(tensordict["action"], self._action_shape, self.task.id)
        action = given.view(self._copies, -1).t().contiguous()  # [m, copies]
        before = self._state
        # New tensors replace the old ones, because a caller may keep what an earlier step returned.
        (self._state, self._speed) = self._move(self._state, action)
        self._steps = self._steps + 1
        observation = self._state.t()
        terminated = self.task.terminated(observation)
        truncated = self._steps >= self.task.max_steps
        out = {
            "observation": observation,
            "reward": self.task.reward(before.t(), action.t(), observation),
            "terminated": terminated,
            "truncated": truncated,
            "done": terminated | truncated,
        }
        copied = {key: self._out(value) for key, value in out.items()}
        return TensorDict(copied, self.batch_size, device=self.device)

    def _move(
        self,
        state: Tensor,
        action: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Next state ``[n, copies]`` and speeds ``[m, copies]``; ``state`` and ``action [m,
        copies]`` are not changed."""
        noise = torch.randn(action.shape, generator=self._rng, device=self.device)
        noise = noise.mul_(self._noise)
        turn = torch.addcmul(self._middle, action, self._half)
        on_action = self._kinematics.noise_on == "action"
        if on_action:
            turn = turn.add_(noise)
        speed = self._speed
        if self._time_s is not None:
            turn, speed = turned_angle(
                turn,
                speed,
                self._limit,
                self._time_s,
            )
        angles = self._bounded(turn.add_(state[self._angles]))
        if not on_action:
            angles = self._bounded(angles.add_(noise))
        # The state is copied, because the one before the step is still needed for the reward.
        moved = state.clone()
        moved[self._angles] = angles
        return moved, speed

    def _bounded(self, angles: Tensor) -> Tensor:
        """Wrap endless motors and clamp joints; changes ``angles`` in place and returns it."""
        turns = (angles * self._turns_per_deg).floor_()
        return angles.addcmul_(turns, self._deg_per_turn, value=-1.0).clamp_(self._low, self._high)

    def _start(self, copies: Tensor) -> None:
        """Draw new start states for ``copies``; tensors returned earlier are not changed."""
        shape = (self._state.shape[0], len(copies))
        share = torch.rand(shape, generator=self._rng, device=self.device)
        drawn = torch.addcmul(self._start_low, share, self._start_span)
        drawn = torch.where(self._whole, drawn.floor(), drawn)
        self._state = self._state.index_copy(1, copies, drawn)
        self._steps = self._steps.index_fill(0, copies, 0)
        self._speed = self._speed.index_fill(1, copies, 0.0)

    def _out(self, batch: Tensor) -> Tensor:
        # The values of one robot are copied, so that a caller cannot change the state. Those of a
        # batch are a view, which is faster.
        return batch if self.batch_size else batch[0].clone()


def reseed(generator: torch.Generator, seed: int | None) -> None:
    """Seed a generator; with ``None`` with a fresh seed."""
    if seed is None:
        generator.seed()
    else:
        # torch takes no NumPy integers.
        generator.manual_seed(int(seed))


def resolve_device(name: str | torch.device) -> torch.device:
    """A device by name; "auto" is the best one here. Raises RunError if there is no such device."""
    if name == "auto":
        name = next(iter(_accelerators()), "cpu")
    try:
        # Only making a tensor on it shows that there is such a device, and gives it its number.
        return torch.empty(0, device=torch.device(name)).device
    except (RuntimeError, AssertionError, NotImplementedError, TypeError):
        here = ", ".join(["cpu", *_accelerators()])
        raise RunError(f"there is no device '{name}' here; choose {here} or auto") from None


def _accelerators() -> list[str]:
    """Names of the devices here beside the processor, the best one first."""
    found = {
        "cuda": torch.cuda.is_available(),
        "mps": torch.backends.mps.is_available(),
    }
    return [name for name, is_here in found.items() if is_here]


def batch_shape(batch_size: int | Sequence[int]) -> torch.Size:
    """Shape of a number of copies, as an integer or as in TorchRL. Raises DescriptionError if it is
    no number of copies."""
    if isinstance(batch_size, Sequence):
        sizes = list(batch_size)
    else:
        sizes = [batch_size] if batch_size else []
    # A NumPy integer has an index too, but a float has none.
    are_counts = all(hasattr(size, "__index__") and size > 0 for size in sizes)
    if len(sizes) > 1 or not are_counts:
        raise DescriptionError(
            f"batch_size is {batch_size!r}; give a number of copies, or 0 for one without a batch "
            "dimension"
        )
    return torch.Size([int(size) for size in sizes])


def turned_angle(
    turn_deg: Tensor,
    speed_deg_s: Tensor,
    limit_deg_s: Tensor,
    time_s: float,
) -> tuple[Tensor, Tensor]:
    """Angle turned after ``time_s`` (deg) and the speed then (deg/s).

    Args:
        turn_deg: commanded angle ``[*batch]``, relative to the present position; signed.
        speed_deg_s: speed when the command arrives ``[*batch]``.
        limit_deg_s: speed limit of the command, above 0; broadcast against the others.
    """
    a = ACCELERATION_DEG_S2
    sign = turn_deg.sign()
    distance = turn_deg.abs()
    # A start speed that is too high to stop in time is reduced to the highest one that allows it.
    start = torch.minimum(sign * speed_deg_s, (2.0 * a * distance).sqrt())
    back = torch.where(start < 0, start.square() / (2.0 * a), 0.0)
    top = torch.minimum((2.0 * a * (distance + back)).sqrt(), limit_deg_s)
    # A command with a lower limit than the present speed begins by braking.
    first = torch.where(start < top, a, -a)
    # The first ramp, extrapolated, would have speed zero at this position.
    origin = -start.square() / (2.0 * first)
    ramped = origin + top.square() / (2.0 * first)
    braking = distance - top.square() / (2.0 * a)
    # If the way is too short to reach the limit, the profile is a triangle without a cruise.
    is_triangular = braking < ramped
    ramped = torch.where(is_triangular, (origin + distance) / 2.0, ramped)
    braking = torch.where(is_triangular, ramped, braking)
    peak_squared = 2.0 * first * (ramped - origin)
    top = torch.where(is_triangular, peak_squared.clamp_min(0.0).sqrt(), top)
    # The first ramp ends and the braking begins at these times.
    t1 = (top - start) / first
    cruise_s = (braking - ramped) / top.clamp_min(1e-6)
    t2 = t1 + torch.where(top > 0, cruise_s, 0.0)
    # `time_s` is divided into its parts in the first ramp, at constant speed, and in braking.
    u1 = t1.clamp_max(time_s)
    u3 = (time_s - t2).clamp_min(0.0).minimum(top / a)
    cruise = (time_s - t1).clamp_min(0.0).minimum(t2 - t1)
    in_ramp = start * u1 + first * u1.square() / 2.0
    turned = in_ramp + top * (cruise + u3) - a * u3.square() / 2.0
    ramp_speed = start + first * u1
    end_speed = top - a * u3
    speed = torch.where(time_s < t1, ramp_speed, end_speed)
    return sign * turned, sign * speed
