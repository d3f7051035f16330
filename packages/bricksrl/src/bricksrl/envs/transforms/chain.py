"""Chain of transforms between an environment and its agent."""

from torchrl.envs import Compose, EnvBase, Transform, TransformedEnv


def base_of(env: EnvBase) -> EnvBase:
    """The environment under all transforms."""
    while isinstance(env, TransformedEnv):
        env = env.base_env
    return env


def transforms_of(env: EnvBase) -> list[Transform]:
    """The transforms of an environment, innermost first."""
    chain: list[Transform] = []
    while isinstance(env, TransformedEnv):
        chain = [*transforms_at(env), *chain]
        env = env.base_env
    return chain


def transforms_at(env: TransformedEnv) -> list[Transform]:
    """The transforms of the outermost level."""
    return list(env.transform.transforms) if isinstance(env.transform, Compose) else [env.transform]


def insert(
    env: TransformedEnv,
    place: int,
    transform: Transform,
) -> None:
    """TorchRL's insertion, which copies a transform that is alone, so that its owner's is none of
    the environment any more."""
    if not isinstance(env.transform, Compose):
        alone = env.transform
        alone.reset_parent()
        env.transform = Compose(alone)
    env.insert_transform(place, transform)
