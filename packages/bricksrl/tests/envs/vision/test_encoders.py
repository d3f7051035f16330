"""Pretrained encoders, without network access."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.error import URLError

import pytest
import torch
import torchrl.envs
from torch import nn
from torch.nn.functional import interpolate
from torchrl.data import Unbounded
from torchrl.envs import Transform

import bricksrl
from bricksrl.agents.frozen_encoders import encode_images
from bricksrl.envs.registry import register
from bricksrl.envs.tasks.spinning import SPINNING
from bricksrl.envs.transforms import layout_of
from bricksrl.envs.vision.camera import CameraView
from bricksrl.errors import EncoderError

SEEN = dataclasses.replace(
    SPINNING,
    id="SeenSpinning-v0",
    camera=CameraView("chase", width_px=96, height_px=72, image_px=32, spot_px=6),
)


@pytest.fixture
def env() -> Any:
    register(SEEN)
    return bricksrl.make("SeenSpinning-v0", seed=0)


class MeanColour(Transform):
    """Replaces TorchRL's transforms."""

    told: dict[str, Any]

    def __init__(self, model_name: str, **told: Any) -> None:
        super().__init__(in_keys=told["in_keys"], out_keys=told["out_keys"])
        type(self).told = {"model_name": model_name, **told}

    def _apply_transform(self, image: torch.Tensor) -> torch.Tensor:
        return image.float().mean((-3, -2))

    def _reset(self, tensordict: Any, tensordict_reset: Any) -> Any:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, spec: Any) -> Any:
        spec["embedding"] = Unbounded((3,))
        return spec


@pytest.mark.parametrize(
    ("encoder", "name", "network"),
    [("vip", "VIPTransform", "resnet50"), ("r3m", "R3MTransform", "resnet18")],
)
def test_images_become_embeddings(
    encoder: Any, name: str, network: str, env: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(torchrl.envs, name, MeanColour)
    steps = encode_images(env, encoder, weights_dir=tmp_path).rollout(2)
    assert steps["embedding"].shape == (2, 3)
    assert (steps["next", "embedding"] > 0).all()
    assert MeanColour.told == {
        "model_name": network,
        "in_keys": ["image"],
        "out_keys": ["embedding"],
        "download": True,
        "download_path": str(tmp_path),
    }
    env.close()


@pytest.mark.parametrize(
    "failure",
    [URLError("no name of that host"), OSError(28, "no space\nleft"), RuntimeError("not a zip")],
)
def test_unavailable_weights_raise(
    failure: Exception, env: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fetch(*_args: object, **_kwargs: object) -> None:
        raise failure

    monkeypatch.setattr(torchrl.envs, "VIPTransform", fetch)
    with pytest.raises(
        EncoderError, match=r"weights of vip cannot be fetched \(.*go online once"
    ) as caught:
        encode_images(env, "vip")
    assert "\n" not in str(caught.value)


def test_torchvision_of_another_torch_is_told(env: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_args: object, **_kwargs: object) -> None:
        raise RuntimeError("operator torchvision::nms does not exist")

    monkeypatch.setattr(torchrl.envs, "VIPTransform", broken)
    with pytest.raises(EncoderError, match=r"needs a torchvision for this torch \(operator"):
        encode_images(env, "vip")


def test_missing_torchvision_names_extra(env: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("torchvision")] or ["torchvision"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr("torchrl.envs.transforms._observation._has_tv", False, raising=False)
    for encoder in ("vip", "r3m"):
        with pytest.raises(EncoderError, match=r"bricksrl\[encoders\]"):
            encode_images(env, encoder)  # type: ignore[arg-type]


class PooledColour(nn.Module):
    """In place of torchvision's ResNet: mean colours, before the last layer that VIP gives it."""

    fc: nn.Module

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        colours: torch.Tensor = self.fc(images.mean((-2, -1)).repeat(1, 683)[:, :2048])
        return colours


def test_weights_of_a_file_need_no_connection(
    env: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    names = (
        "torchvision",
        "torchvision.models",
        "torchvision.transforms",
        "torchvision.transforms.functional",
    )
    vision, models, _, functional = (ModuleType(name) for name in names)
    for name, module in zip(
        names, (vision, models, ModuleType("transforms"), functional), strict=True
    ):
        monkeypatch.setitem(sys.modules, name, module)
    vision.models, models.resnet50, models.ResNet50_Weights = models, PooledColour, None  # type: ignore[attr-defined]
    functional.InterpolationMode = str  # type: ignore[attr-defined]
    functional.resize = (
        lambda image, size, **_: interpolate(image.view(-1, *image.shape[-3:]), size).view(  # type: ignore[attr-defined]
            *image.shape[:-2], *size
        )
    )
    for module_name in ("vip", "_observation"):
        monkeypatch.setattr(f"torchrl.envs.transforms.{module_name}._has_tv", True)
    monkeypatch.setattr(
        torch.hub, "download_url_to_file", lambda *_, **__: pytest.fail("nothing is downloaded")
    )
    made_up = {
        "module.convnet.fc.weight": torch.zeros(1024, 2048),
        "module.convnet.fc.bias": torch.arange(1024.0),
    }
    torch.save({"vip": made_up}, tmp_path / "model.pt")
    encoded = encode_images(env, "vip", weights_dir=tmp_path)
    assert encoded.reset()["embedding"].flatten().equal(torch.arange(1024.0))
    assert layout_of(encoded).keys == ["observation", "embedding"]


def test_mistakes_raise(env: Any) -> None:
    with pytest.raises(EncoderError, match="choose one of vip, r3m"):
        encode_images(env, "clip")  # type: ignore[arg-type]
    with pytest.raises(EncoderError, match="has no image"):
        encode_images(bricksrl.make("WalkerSim-v0"), "vip")
