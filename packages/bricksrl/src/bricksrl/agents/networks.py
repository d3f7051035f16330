"""Networks and policies: multilayer perceptrons or the user's networks, and actors."""

import copy
import itertools
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import NormalParamExtractor, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Composite, TensorSpec
from torchrl.envs import EnvBase
from torchrl.modules import AdditiveGaussianModule, ProbabilisticActor, TanhNormal

from brickhub.user_files import calling, is_reference, load_object
from bricksrl.agents.features.encoder import encoder_keys
from bricksrl.agents.settings import Norm, Settings
from bricksrl.errors import DescriptionError, UnknownNameError, message_of


class Dropout(nn.Dropout):
    """``nn.Dropout`` that draws 16 bits a unit on the CPU, in a third of the time. Its rate is
    rounded to a multiple of 2^-16."""

    def forward(self, x: Tensor) -> Tensor:
        if not self.training or x.device.type != "cpu":
            return super().forward(x)
        # units dropped of 2^16; never all, as what is kept is divided by its share
        dropped = min(round(self.p * 2**16), 2**16 - 1)
        # 64 bits serve four units: two int32, each of which serves once as it is and once shifted,
        # so that its other half leads
        count = -(-x.numel() // 4)
        halves = torch.randint(-(2**63), 2**63 - 1, (count,)).view(torch.int32)
        drawn = torch.cat((halves, halves << 16))[: x.numel()]
        bits = drawn.view(x.shape)
        # int32 begin at -2^31: `dropped` of 2^16 values of the leading half lie below this
        bound = dropped * 2**16 - 2**31
        kept = bits.to(x.dtype).ge_(bound)
        # the expected value of a unit stays the same
        return x * kept.mul_(2**16 / (2**16 - dropped))


class BatchNorm(nn.BatchNorm1d):
    """Batch normalisation of the last dimension of ``[*batch, size]``; in evaluation mode by
    running statistics."""

    def forward(self, x: Tensor) -> Tensor:
        # torch's own takes the channels of ``[batch, size, length]`` for what it normalises
        flat = x.reshape(-1, x.shape[-1])
        normalised = super().forward(flat)
        return normalised.view(x.shape)


_NORMS: dict[str, type[nn.Module]] = {"layer": nn.LayerNorm, "rms": nn.RMSNorm, "batch": BatchNorm}


def mlp(
    in_size: int,
    out_size: int,
    hidden: tuple[int, ...],
    *,
    norm: Norm = "none",
    dropout: float = 0.0,
) -> nn.Sequential:
    """A multilayer perceptron ``[*batch, in_size]`` to ``[*batch, out_size]`` with ReLU. ``norm,
    dropout``: after each hidden layer, before its ReLU, as in DroQ (Hiraoka et al., 2022)."""
    sizes = (in_size, *hidden)
    layers = list[nn.Module]()
    for size, units in itertools.pairwise(sizes):
        layers.append(nn.Linear(size, units))
        if dropout:
            layers.append(Dropout(dropout))
        if norm != "none":
            layers.append(_NORMS[norm](units))
        layers.append(nn.ReLU(inplace=True))
    return nn.Sequential(*layers, nn.Linear(sizes[-1], out_size))


def make_body(
    settings: Settings,
    in_size: int,
    out_size: int,
    **kwargs: Any,
) -> nn.Module:
    """The network of the settings: an `mlp`, or the result of the user's factory, tried once before
    it learns. Raises DescriptionError if that cannot be loaded, raises, or returns no network of
    these sizes."""
    reference = settings.network
    if kwargs.get("norm") == "batch" and settings.batch_size < 2:
        raise DescriptionError(
            "a batch of 1 has no statistics; give a batch_size of 2 or more, or another norm"
        )
    if not reference:
        return mlp(
            in_size,
            out_size,
            settings.hidden,
            **kwargs,
        )
    if not is_reference(reference):
        raise UnknownNameError(f"there is no network '{reference}'; give FILE.py:NAME")
    factory = load_object(reference, default="make_network")
    with calling(reference, "makes no network"):
        network = factory(in_size, out_size)
    if not isinstance(network, nn.Module):
        raise DescriptionError(
            f"{reference} makes a {type(network).__name__}; let it return a torch.nn.Module"
        )
    _try_network(
        network,
        reference,
        in_size,
        out_size,
    )
    return network


def _try_network(
    network: nn.Module,
    reference: str,
    in_size: int,
    out_size: int,
) -> None:
    """Raise DescriptionError if a user's network fails or has other sizes."""
    # an update passes a batch, a robot one observation without a batch
    for batch in ((2,), ()):
        size = [*batch, in_size]
        wanted = [*batch, out_size]
        try:
            # a copy, and random numbers that are put back: to have been tried changes no run
            with torch.no_grad(), torch.random.fork_rng(devices=[]):
                tried = copy.deepcopy(network).eval()
                out = tried(torch.zeros(size))
        except Exception as error:
            fault = f"makes a network that fails on {size} ({message_of(error, typed=True)})"
            if batch:
                remedy = "correct it"
            else:
                # such as ``nn.BatchNorm1d``, which takes nothing without a batch
                remedy = "a policy acts on one observation at a time; normalise with LayerNorm"
            raise DescriptionError(f"{reference} {fault}; {remedy}") from error
        actual = list(out.shape) if isinstance(out, Tensor) else type(out).__name__
        if actual != wanted:
            raise DescriptionError(
                f"{reference} makes a network from {size} to {actual}; let it give {wanted}"
            )


class Actor(nn.Module):
    """Encoder, body and head in sequence."""

    def __init__(
        self,
        encoder: nn.Module,
        body: nn.Module,
        head: nn.Module,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.body = body
        self.head = head

    def forward(self, *inputs: Tensor) -> Any:
        features = self.encoder(*inputs)
        return self.head(self.body(features))


class Keyed(TensorDictModuleBase):  # type: ignore[misc]
    """A module of tensors between keys: a ``TensorDictModule`` that does not import pandas to see
    whether a tensor is a table, which takes as long as the first 30 updates."""

    def __init__(
        self,
        module: nn.Module,
        in_keys: list[str],
        out_keys: list[str],
    ) -> None:
        super().__init__()
        self.module = module
        self.in_keys = in_keys
        self.out_keys = out_keys

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        inputs = [tensordict[key] for key in self.in_keys]
        out = self.module(*inputs)
        values = out if isinstance(out, tuple) else (out,)
        for key, value in zip(self.out_keys, values, strict=True):
            tensordict[key] = value
        return tensordict


def action_size(env: EnvBase) -> int:
    """Size of one robot's action."""
    return int(env.full_action_spec_unbatched["action"].shape[-1])


def action_spec(env: EnvBase) -> TensorSpec:
    """Spec of one robot's action, -1..1."""
    return env.full_action_spec_unbatched["action"].cpu()


def gaussian_policy(
    encoder: nn.Module,
    body: nn.Module,
    spec: TensorSpec,
    *,
    min_scale: float = 0.1,
    log_prob: bool = False,
) -> ProbabilisticActor:
    """A tanh-squashed normal policy. ``body``: features to location and raw scale, twice the
    action's size; ``min_scale``: least standard deviation before the tanh; ``log_prob``: write the
    action's log-probability too."""
    head = NormalParamExtractor(scale_lb=min_scale)
    actor = Keyed(Actor(encoder, body, head), encoder_keys(encoder), ["loc", "scale"])
    return ProbabilisticActor(
        actor,
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        spec=Composite(action=spec),
        return_log_prob=log_prob,
    )


def deterministic_policy(
    encoder: nn.Module,
    body: nn.Module,
    spec: TensorSpec,
    *,
    noise: float,
) -> tuple[Keyed, TensorDictSequential]:
    """A deterministic actor ``tanh(body)``, and the policy that adds normal exploration noise."""
    actor = Keyed(Actor(encoder, body, nn.Tanh()), encoder_keys(encoder), ["action"])
    # the same at both ends, so that TorchRL anneals nothing
    exploration = AdditiveGaussianModule(spec, sigma_init=noise, sigma_end=noise)
    return actor, TensorDictSequential(actor, exploration)
