"""A camera for any task, with TorchRL transforms: stack the last two images, repeat each action for
two steps."""

from dataclasses import replace

import torch
from torchrl.envs import (
    CatFrames,
    Compose,
    FrameSkipTransform,
    ObservationNorm,
    ToTensorImage,
    TransformedEnv,
)

import bricksrl
from bricksrl.agents.frozen_encoders import encode_images
from bricksrl.envs import get_task
from bricksrl.envs.vision.camera import CameraView
from bricksrl.errors import EncoderError

TASK = replace(
    get_task("Spinning-v0"),
    id="SeenSpinning-v0",
    camera=CameraView("chase", width_px=128, height_px=96, image_px=64),
)


def main() -> None:
    bricksrl.register(TASK)
    env = bricksrl.make("SeenSpinning-v0", seed=0)
    print(
        "on the robot:",
        env.observation_spec["image"].dtype,
        list(env.observation_spec["image"].shape),
    )

    transformed = TransformedEnv(
        env,
        Compose(
            FrameSkipTransform(2),
            ToTensorImage(in_keys=["image"], unsqueeze=False),
            ObservationNorm(loc=0.5, scale=0.25, in_keys=["image"], standard_normal=True),
            CatFrames(2, dim=-3, in_keys=["image"], out_keys=["stack"]),
        ),
    )
    steps = transformed.rollout(6)
    print("stacked:", list(steps["stack"].shape), "of mean", round(steps["stack"].mean().item(), 2))
    assert torch.equal(steps["stack"][3, :3], steps["image"][2])

    try:  # an encoder pretrained on millions of images; its weights are downloaded once
        encoded = encode_images(env, "r3m").rollout(2)["embedding"]
        print("encoded:", list(encoded.shape))
    except EncoderError as error:
        print("encoded: no,", error)
    env.close()


if __name__ == "__main__":
    main()
