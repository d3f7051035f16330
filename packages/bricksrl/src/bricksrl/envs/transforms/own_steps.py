"""Own steps of an environment, behind transforms that change or join them."""

from typing import Any

from tensordict import TensorDictBase
from torchrl.envs import EnvBase, Transform

from bricksrl.envs.transforms.chain import transforms_of


class Tap(Transform):  # type: ignore[misc]
    """Innermost transform, which changes nothing: it notes what the environment itself observes and
    pays in each of its steps."""

    def __init__(self) -> None:
        super().__init__()
        self.noted: dict[str, Any] = {"frames": []}  # shared with TorchRL's copies of a chain

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.noted["action"] = tensordict.get("action", None)
        return tensordict

    def _reset(
        self,
        _tensordict: TensorDictBase,
        tensordict_reset: TensorDictBase,
    ) -> TensorDictBase:
        self.noted |= {"frames": [], "state": tensordict_reset.clone()}
        return tensordict_reset

    def _step(
        self,
        _tensordict: TensorDictBase,
        next_tensordict: TensorDictBase,
    ) -> TensorDictBase:
        if next_tensordict.batch_dims:  # copies are judged by their task's kinematics
            return next_tensordict
        before = self.noted["state"]
        # A clone: transforms after this one write into the tensordict.
        after = next_tensordict.clone()
        ends = ("done", "terminated", "truncated")
        state = before.exclude("reward", *ends).set("action", self.noted["action"])
        self.noted["frames"].append(state.set("next", after))
        self.noted["state"] = after
        return next_tensordict


def own_state(env: EnvBase, state: TensorDictBase) -> TensorDictBase:
    """The environment's own observation behind a state of its transforms."""
    tap = _tap_of(env)
    return state if tap is None else tap.noted["state"]


def own_frames(env: EnvBase, frame: TensorDictBase) -> list[TensorDictBase]:
    """The environment's own steps behind the last step of its transforms: with its observations,
    actions and rewards."""
    tap = _tap_of(env)
    if tap is None:
        return [frame]
    frames = tap.noted["frames"]
    tap.noted["frames"] = []
    if "intervention" in frame:  # which is written behind the transforms
        for own_frame in frames:
            own_frame["intervention"] = frame["intervention"]
    return list(frames)


def _tap_of(env: EnvBase) -> Tap | None:
    """The tap of an environment that has been prepared, which is the innermost transform."""
    chain = transforms_of(env)
    return chain[0] if chain and isinstance(chain[0], Tap) else None
