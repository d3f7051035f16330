"""Small networks for a hub: distilled from any policy, and written as MicroPython.

Their features need no more than sines: what is observed, scaled to -1..1; of angles that wrap sine
and cosine, and those of their differences. The student acts, the policy says what it would have
done (DAgger, Ross et al., 2011).
"""

import itertools
import math
from collections.abc import Sequence
from typing import Any, Protocol

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.envs import EnvBase

from brickhub.entry import Entry
from brickhub.seed import derive_seed
from bricksrl.envs.rollout import play, seed_episode

HIDDEN = (16, 16)
"""Units of the hidden layers."""
ROUNDS = 4
"""Rounds of collection: the first one of the policy's steps, the others of the student's."""
STEPS = 600
"""Steps of each round."""
UPDATES = 1500
"""Updates of each round."""
BATCH = 256
LEARNING_RATE = 5e-3
"""Rate at the beginning of each round; it falls to 0 within it."""
_ANYTHING = 1e30
LEAK = 0.01
"""Share of what is beyond -1..1 that the loss sees."""


class Acting(Protocol):
    """A policy that is distilled: for TorchRL's environments, and for observations alone."""

    def __call__(self, state: Any, /) -> Any:
        """Write the action into a state."""

    def act(self, observation: Any, /) -> Any:
        """Action ``[*batch, m]`` for an observation ``[*batch, n]``."""

    def reset(self) -> None:
        """Forget the episode so far."""


class HubNetwork(nn.Module):
    """A network ``[*batch, n]`` to actions ``[*batch, m]``: features, rectified layers, a linear
    one that is clamped. What is no angle is held within what it was taught on.

    Args:
        entries: those of the observation that the hub observes, its first ones.
        size: m.
    """

    def __init__(
        self,
        entries: Sequence[Entry],
        size: int,
        hidden: Sequence[int] = HIDDEN,
    ) -> None:
        super().__init__()
        self.count = len(entries)
        angles = [index for index, entry in enumerate(entries) if entry.wraps]
        # Each feature is a difference of two values. An angle alone is one to a 0, which follows
        # the last value.
        alone = [(index, self.count) for index in angles]
        self.angles = [*alone, *itertools.combinations(angles, 2)]
        self.linear = []
        for index, entry in enumerate(entries):
            if not entry.wraps:
                self.linear.append((index, *_scale(entry)))
        self.held = [(-_ANYTHING, _ANYTHING)] * len(self.linear)
        sizes = (len(self.linear) + 2 * len(self.angles), *hidden, size)
        self.layers = [nn.Linear(before, after) for before, after in itertools.pairwise(sizes)]
        self.network = nn.ModuleList(self.layers)

    def forward(self, observation: Tensor) -> Tensor:
        return self.outputs(observation).clamp(-1.0, 1.0)

    def outputs(self, observation: Tensor) -> Tensor:
        """The outputs before they are clamped."""
        values = nn.functional.pad(observation[..., : self.count], (0, 1)).unbind(-1)
        angles = [(values[plus] - values[minus]).deg2rad() for plus, minus in self.angles]
        parts = []
        for (index, scale, offset), held in zip(self.linear, self.held, strict=True):
            parts.append(values[index].clamp(*held) * scale + offset)
        parts += [angle.sin() for angle in angles]
        parts += [angle.cos() for angle in angles]
        x = torch.stack(parts, -1)  # [*batch, features]
        for layer in self.layers[:-1]:
            x = layer(x).relu()
        out: Tensor = self.layers[-1](x)
        return out

    def hold(self, observations: Tensor) -> None:
        """Hold what is no angle within these observations ``[rows, n]``."""
        self.held = []
        for index, _, _ in self.linear:
            column = observations[:, index]
            # As they are written into the program, so that both act alike.
            least = float(_text(float(column.min())))
            greatest = float(_text(float(column.max())))
            self.held.append((least, greatest))

    @torch.no_grad()
    def round(self) -> None:
        """Round all weights to the digits that `hub_source` writes."""
        for parameter in self.parameters():
            rounded = [float(_text(value)) for value in parameter.flatten().tolist()]
            parameter.copy_(torch.tensor(rounded).view_as(parameter))

    def hub_source(self) -> str:
        """MicroPython that acts as the network: ``act(observed)``."""
        layers = ""
        for layer in self.layers:
            units = torch.cat((layer.weight, layer.bias[:, None]), 1)  # [out, in + 1]
            layers += "    (\n"
            for row in units.tolist():
                layers += f"        ({', '.join(map(_text, row))}),\n"
            layers += "    ),\n"
        linear = ""
        for (index, scale, offset), held in zip(self.linear, self.held, strict=True):
            numbers = ", ".join(map(_text, (scale, offset, *held)))
            linear += f"    ({index}, {numbers}),\n"
        return (
            "LINEAR = (  # index, factor and offset of what is no angle; its least and its "
            f"greatest value\n{linear})\n"
            f"ANGLES = {tuple(self.angles)}  # indices of two angles, or of one and of a 0 that "
            "follows the last\n"
            f"LAYERS = (  # a row for each unit: its weights, then its offset\n{layers})\n"
            f"{_HUB_SOURCE}"
        )


_HUB_SOURCE = '''
import umath


def features(observed):
    values = observed + [0]
    angles = [umath.radians(values[plus] - values[minus]) for plus, minus in ANGLES]
    scaled = [max(least, min(most, values[index])) * scale + offset for index, scale, offset, least, most in LINEAR]
    return scaled + [umath.sin(angle) for angle in angles] + [umath.cos(angle) for angle in angles]


def outputs(layer, values):
    result = []
    for row in layer:
        total = row[-1]
        for index in range(len(values)):
            total += row[index] * values[index]
        result.append(total)
    return result


def act(observed):
    """The network: layers of rectified units, and a linear one."""
    values = features(observed)
    for layer in LAYERS[:-1]:
        values = [max(0.0, value) for value in outputs(layer, values)]
    return [max(-1.0, min(1.0, value)) for value in outputs(LAYERS[-1], values)]
'''  # noqa: E501


def distil(
    env: EnvBase,
    policy: Acting,
    network: HubNetwork,
    seed: int,
) -> TensorDictModule:
    """Teach the network the policy's actions where the policy, and then the network, goes. Returns
    it as a policy."""
    student = TensorDictModule(network, in_keys=["observation"], out_keys=["action"])
    acting = torch.no_grad()(student.forward)
    optimizer = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    seen = list[Tensor]()
    said = list[Tensor]()
    episode = 0
    for number in range(ROUNDS):
        steps = 0
        while steps < STEPS:
            episode += 1
            seed_episode(env, derive_seed(seed, "distil", episode))
            for frame in play(env, policy if number == 0 else acting, reset_policy=policy.reset):
                seen.append(frame["observation"])
                said.append(frame["action"] if number == 0 else policy.act(frame["observation"]))
                steps += 1
        observations = torch.stack(seen)
        actions = torch.stack(said)
        for update in range(UPDATES):
            optimizer.param_groups[0]["lr"] = LEARNING_RATE * (1.0 - update / UPDATES)
            rows = torch.randint(len(seen), (BATCH,))
            out = network.outputs(observations[rows])
            clamped = out.clamp(-1.0, 1.0)
            # Clamped, as the hub acts; with a leak, as else nothing would bring back an output that
            # is out of range.
            leaking = clamped + LEAK * (out - clamped)
            loss = (leaking - actions[rows]).square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    # At the end, as it learns better from what is not held.
    network.hold(torch.stack(seen))
    network.round()
    return student


def _scale(entry: Entry) -> tuple[float, float]:
    """Factor and offset that bring an entry with a range to -1..1."""
    if not (math.isfinite(entry.low) and math.isfinite(entry.high)):
        return 1.0, 0.0
    return 2.0 / (entry.high - entry.low), -(entry.high + entry.low) / (entry.high - entry.low)


def _text(value: float) -> str:
    return f"{value:.4g}"
