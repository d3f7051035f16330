"""Pretrained image encoders VIP and R3M, through TorchRL's transforms."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from bricksrl.errors import EncoderError, message_of

if TYPE_CHECKING:
    from torchrl.envs import EnvBase

_NETWORKS = {"vip": ("VIPTransform", "resnet50"), "r3m": ("R3MTransform", "resnet18")}


def encode_images(
    env: EnvBase,
    encoder: Literal["vip", "r3m"],
    *,
    weights_dir: Path | None = None,
) -> Any:
    """Replace an environment's ``image`` by a vector ``embedding`` of 1024 (VIP) or 512 (R3M)
    numbers. Raises EncoderError if torchvision is not installed, the weights cannot be downloaded,
    or the environment has no image.

    The weights are downloaded once and cached.

    Args:
        weights_dir: folder of the weights, by default that of ``torch.hub``; ``model.pt`` (VIP) and
            ``r3m_18.pt`` (R3M) are not downloaded if they are there.
    """
    from torchrl import envs

    if encoder not in _NETWORKS:
        raise EncoderError(f"there is no encoder '{encoder}'; choose one of {', '.join(_NETWORKS)}")
    if "image" not in set(env.observation_spec.keys()):
        raise EncoderError(
            f"the environment has no image to encode with {encoder}; take one with a camera"
        )
    transform, network = _NETWORKS[encoder]
    folder = None if weights_dir is None else str(weights_dir)
    make_transform = getattr(envs, transform)
    try:
        encode = make_transform(
            network,
            in_keys=["image"],
            out_keys=["embedding"],
            download=True,
            download_path=folder,
        )
    except (ImportError, OSError, RuntimeError) as error:
        # torchvision is missing or of another torch, there is no connection or no disk space, or
        # the weights are invalid; torchvision's errors name it, and have another remedy
        reason = message_of(error, 120)
        if "torchvision" in reason:
            message = (
                f"{encoder} needs a torchvision for this torch ({reason}); install it: pip "
                'install "bricksrl[encoders]"'
            )
        else:
            message = (
                f"the weights of {encoder} cannot be fetched ({reason}); go online once, or "
                "name a weights_dir"
            )
        raise EncoderError(message) from error
    return envs.TransformedEnv(env, encode)
