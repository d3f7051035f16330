"""Networks and policies, from ordinary layers: multilayer perceptrons, actors, critics, and the policies made of them."""

from __future__ import annotations

import copy
from typing import Any, TypeVar

import torch
from tensordict.nn import NormalParamExtractor, TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Composite, TensorSpec
from torchrl.envs import EnvBase
from torchrl.modules import AdditiveGaussianModule, ProbabilisticActor, TanhNormal, ValueOperator

from bricksrl.agents.encoder import encoder_keys
from bricksrl.agents.settings import Settings
from bricksrl.errors import DescriptionError

M = TypeVar("M", bound=nn.Module)


class BatchNorm(nn.BatchNorm1d):
    """Batch normalisation of the last dimension of ``[*batch, size]``; with the running statistics unless it trains.

    The momentum and epsilon of CrossQ's authors (Bhatt et al., 2024).
    """

    def __init__(self, size: int, momentum: float = 0.01) -> None:
        super().__init__(size, eps=1e-3, momentum=momentum)

    def forward(self, x: Tensor) -> Tensor:
        return super().forward(x.reshape(-1, x.shape[-1])).view(x.shape)


def mlp(
    in_size: int,
    out_size: int,
    hidden: tuple[int, ...],
    *,
    layer_norm: bool = False,
    dropout: float = 0.0,
    batch_norm: float | None = None,
) -> nn.Sequential:
    """A multilayer perceptron ``[*batch, in_size]`` to ``[*batch, out_size]`` with ReLU between its layers.

    Args:
        layer_norm, dropout: after each hidden layer, before its ReLU, as in DroQ (Hiraoka et al., 2022).
        batch_norm: momentum of batch normalisations before each layer, as in CrossQ; ``None`` for none.
    """
    layers: list[nn.Module] = [] if batch_norm is None else [BatchNorm(in_size, batch_norm)]
    size = in_size
    for units in hidden:
        layers.append(nn.Linear(size, units))
        if dropout > 0:
            layers.append(nn.Dropout(dropout))
        if layer_norm:
            layers.append(nn.LayerNorm(units))
        layers.append(nn.ReLU(inplace=True))
        if batch_norm is not None:
            layers.append(BatchNorm(units, batch_norm))
        size = units
    return nn.Sequential(*layers, nn.Linear(size, out_size))


def make_body(settings: Settings, in_size: int, out_size: int, **kind: Any) -> nn.Module:
    """The network between features and outputs that settings ask for: `mlp`, or what the user's factory makes.

    Raises:
        DescriptionError: the user's factory cannot be loaded, raises, or makes no network.
    """
    if not settings.network:
        return mlp(in_size, out_size, settings.hidden, **kind)
    from bricksrl.envs.user_files import load_object

    factory = load_object(settings.network, default="make_network")
    try:
        made = factory(in_size, out_size)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        raise DescriptionError(f"{settings.network} makes no network ({reason}); correct it") from error
    if not isinstance(made, nn.Module):
        raise DescriptionError(f"{settings.network} makes a {type(made).__name__}; let it return a torch.nn.Module")
    return made


class Actor(nn.Module):
    """An encoder, a body and a head in a row: observations, and images where it sees, to what the head makes of them."""

    def __init__(self, encoder: nn.Module, body: nn.Module, head: nn.Module) -> None:
        super().__init__()
        self.encoder, self.body, self.head = encoder, body, head

    def forward(self, *inputs: Tensor) -> Any:
        return self.head(self.body(self.encoder(*inputs)))


class Critic(nn.Module):
    """An action value ``[*batch, out]`` of what is observed and an action, the action last: for TorchRL's losses."""

    def __init__(self, encoder: nn.Module, body: nn.Module) -> None:
        super().__init__()
        self.encoder, self.body = encoder, body

    def forward(self, *inputs: Tensor) -> Tensor:
        value: Tensor = self.body(torch.cat((self.encoder(*inputs[:-1]), inputs[-1]), -1))
        return value


def acting_copy(policy: M) -> M:
    """A policy of the same parameters that acts without dropout while a loss trains them with it."""
    shared = {id(parameter): parameter for parameter in policy.parameters()}
    return copy.deepcopy(policy, shared).eval()


def action_size(env: EnvBase) -> int:
    """Entries of an action of one robot."""
    return int(env.full_action_spec_unbatched["action"].shape[-1])


def action_spec(env: EnvBase) -> TensorSpec:
    """Spec of an action of one robot, -1..1."""
    return env.full_action_spec_unbatched["action"].cpu()


def gaussian_policy(
    encoder: nn.Module, body: nn.Module, spec: TensorSpec, *, min_scale: float = 0.1, log_prob: bool = False
) -> ProbabilisticActor:
    """A policy that draws from a tanh-squashed normal, whose mode is its best action.

    Args:
        body: from features to twice as many numbers as an action has: location and raw scale.
        min_scale: lower limit of the standard deviation before the tanh.
        log_prob: write the log-probability of the action too.
    """
    actor = Actor(encoder, body, NormalParamExtractor(scale_lb=min_scale))
    return ProbabilisticActor(
        TensorDictModule(actor, in_keys=encoder_keys(encoder), out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        spec=Composite(action=spec),
        return_log_prob=log_prob,
    )


def deterministic_policy(
    encoder: nn.Module, body: nn.Module, spec: TensorSpec, *, noise: float
) -> tuple[TensorDictModule, TensorDictSequential]:
    """A deterministic actor ``tanh(body)``, and the policy that adds normal noise to it while it explores."""
    actor = TensorDictModule(Actor(encoder, body, nn.Tanh()), in_keys=encoder_keys(encoder), out_keys=["action"])
    exploration = AdditiveGaussianModule(spec, sigma_init=noise, sigma_end=noise, annealing_num_steps=1)
    return actor, TensorDictSequential(actor, exploration)


def value_operator(encoder: nn.Module, body: nn.Module) -> ValueOperator:
    """A state value for TorchRL's losses."""
    return ValueOperator(Actor(encoder, body, nn.Identity()), in_keys=encoder_keys(encoder))


def critic_operator(encoder: nn.Module, body: nn.Module) -> ValueOperator:
    """An action value for TorchRL's losses."""
    return ValueOperator(Critic(encoder, body), in_keys=[*encoder_keys(encoder), "action"])
