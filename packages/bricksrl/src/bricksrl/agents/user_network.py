"""Networks from the user's code, checked once before they learn."""

from __future__ import annotations

import copy

import torch
from torch import Tensor, nn

from brickhub.user_files import load_object
from bricksrl.errors import DescriptionError, message_of


def user_network(reference: str, in_size: int, out_size: int) -> nn.Module:
    """The result of the user's factory. Raises DescriptionError if it cannot be loaded, raises, or returns no network of these
    sizes."""
    factory = load_object(reference, default="make_network")
    try:
        network = factory(in_size, out_size)
    except Exception as error:
        raise DescriptionError(f"{reference} makes no network ({message_of(error, typed=True)}); correct it") from error
    if not isinstance(network, nn.Module):
        raise DescriptionError(f"{reference} makes a {type(network).__name__}; let it return a torch.nn.Module")
    for batch in ((2,), ()):
        size, wanted = [*batch, in_size], [*batch, out_size]
        try:
            with torch.no_grad(), torch.random.fork_rng(devices=[]):
                out = copy.deepcopy(network).eval()(torch.zeros(size))
        except Exception as error:
            fault = f"makes a network that fails on {size} ({message_of(error, typed=True)})"
            remedy = "correct it" if batch else "a policy acts on one observation at a time; normalise with LayerNorm"
            raise DescriptionError(f"{reference} {fault}; {remedy}") from error
        actual = list(out.shape) if isinstance(out, Tensor) else type(out).__name__
        if actual != wanted:
            raise DescriptionError(f"{reference} makes a network from {size} to {actual}; let it give {wanted}")
    return network
