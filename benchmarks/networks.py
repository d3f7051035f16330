"""Networks from the literature, as functions of the sizes in and out for ``--set
network=networks.py:NAME``."""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn.utils.parametrizations import weight_norm

UNITS = 256
BLOCK_UNITS = 128


def first_normalized(in_size: int, out_size: int) -> nn.Module:
    """Layer normalisation in the critics' first hidden layer only."""
    return _mlp(in_size, out_size, (out_size == 1, False))


def last_normalized(in_size: int, out_size: int) -> nn.Module:
    """Layer normalisation in the critics' last hidden layer only."""
    return _mlp(in_size, out_size, (False, out_size == 1))


def weight_normalized(in_size: int, out_size: int) -> nn.Module:
    """Weight normalisation (Salimans and Kingma, 2016) in all hidden layers, in the critics with
    layer normalisation."""
    network = _mlp(in_size, out_size, (out_size == 1, out_size == 1))
    for layer in [layer for layer in network if isinstance(layer, nn.Linear)][:-1]:
        weight_norm(layer)
    return network


def simba(in_size: int, out_size: int) -> nn.Module:
    """SimBa (Lee et al., 2025): residual blocks with layer normalisation; one block in the actor,
    two in the critics, all of 128 units. Its normalisation of observations is left out, as features
    are in -1..1."""
    blocks = [_Residual() for _ in range(2 if out_size == 1 else 1)]
    return nn.Sequential(
        nn.Linear(in_size, BLOCK_UNITS),
        *blocks,
        nn.LayerNorm(BLOCK_UNITS),
        nn.Linear(BLOCK_UNITS, out_size),
    )


class _Residual(nn.Module):
    """A residual block with a bottleneck of four times its width."""

    def __init__(self) -> None:
        super().__init__()
        wide = 4 * BLOCK_UNITS
        self.layers = nn.Sequential(
            nn.LayerNorm(BLOCK_UNITS),
            nn.Linear(BLOCK_UNITS, wide),
            nn.ReLU(),
            nn.Linear(wide, BLOCK_UNITS),
        )

    def forward(self, x: Tensor) -> Tensor:
        return x + self.layers(x)  # type: ignore[no-any-return]


def _mlp(in_size: int, out_size: int, normalized: tuple[bool, bool]) -> nn.Sequential:
    """Two hidden layers, each with layer normalisation or not."""
    layers: list[nn.Module] = []
    for size, is_normalized in zip((in_size, UNITS), normalized, strict=True):
        layers += [
            nn.Linear(size, UNITS),
            *([nn.LayerNorm(UNITS)] if is_normalized else []),
            nn.ReLU(),
        ]
    return nn.Sequential(*layers, nn.Linear(UNITS, out_size))
