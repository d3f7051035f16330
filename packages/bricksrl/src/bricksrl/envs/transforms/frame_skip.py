"""Frame skip: an action that is repeated."""

from tensordict import TensorDictBase
from torchrl.envs import FrameSkipTransform


class FrameSkip(FrameSkipTransform):  # type: ignore[misc]
    """TorchRL's frame skip, which repeats an action, that stops where the episode ends: of copies,
    each at its own end. Each of the steps follows from the one before, also for what transforms
    before it count."""

    def _step(
        self,
        tensordict: TensorDictBase,
        next_tensordict: TensorDictBase,
    ) -> TensorDictBase:
        # The environment before this transform, of which TorchRL makes a view.
        parent = self.parent
        state = tensordict
        outcome = next_tensordict
        reward = outcome["reward"]
        for _ in range(self.frame_skip - 1):
            done = outcome["done"]
            if bool(done.all()):
                break
            state = parent.step_mdp(state.clone(False).set("next", outcome))
            goes_on = ~done.squeeze(-1)
            if state.batch_dims:
                # robots in processes: those that have ended wait
                state["_step"] = goes_on
            after = parent._step(state)
            reward = reward + after["reward"].masked_fill(done, 0.0)
            # A copy that has ended keeps the outcome of its last step.
            outcome = after.where(goes_on, outcome) if state.batch_dims else after
        return outcome.set("reward", reward)
