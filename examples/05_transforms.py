"""TorchRL transforms on a robot: repeat actions, normalise observations, stack the last three
frames."""

import torch
from torchrl.envs import (
    CatFrames,
    Compose,
    FrameSkipTransform,
    ObservationNorm,
    RewardSum,
    StepCounter,
    TransformedEnv,
)

import bricksrl


def main() -> None:
    env = bricksrl.make("Spinning-v0", seed=0)
    spec = env.observation_spec["observation"]
    middle, half = (spec.high + spec.low) / 2, (spec.high - spec.low) / 2

    env = TransformedEnv(
        env,
        Compose(
            FrameSkipTransform(2),
            ObservationNorm(loc=middle, scale=half, in_keys=["observation"], standard_normal=True),
            CatFrames(3, dim=-1, in_keys=["observation"], out_keys=["frames"]),
            StepCounter(),
            RewardSum(),
        ),
    )
    episode = env.rollout(100)
    print("steps:", episode.shape[0], "of 50 on the robot")
    print(
        "frames:",
        list(episode["frames"].shape),
        "observation within:",
        episode["observation"].abs().max().item(),
    )
    print("return:", episode["next", "episode_reward"][-1].item())
    assert torch.equal(episode["frames"][5, -6:], episode["observation"][5])
    env.close()


if __name__ == "__main__":
    main()
