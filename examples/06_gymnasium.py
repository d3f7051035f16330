"""The environments through the Gymnasium API."""

import gymnasium

import bricksrl  # noqa: F401  registers the environments


def main() -> None:
    env = gymnasium.make("bricksrl/Spinning-v0")
    observation, _ = env.reset(seed=0)
    print("observation:", observation.round(1).tolist())
    total, done = 0.0, False
    while not done:
        towards_left = observation[5] == 0
        action = [-1.0, 1.0] if towards_left else [1.0, -1.0]
        observation, reward, terminated, truncated, info = env.step(
            env.action_space.dtype.type(action)
        )
        total, done = total + reward, terminated or truncated
    print(f"return: {total:.0f}, {info}")
    env.close()


if __name__ == "__main__":
    main()
