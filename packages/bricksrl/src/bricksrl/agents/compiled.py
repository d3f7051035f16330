"""Compiled updates: forward and backward pass of a loss as one graph, for long runs.

Adam and target updates stay outside. The first compilation takes about a minute, cached ones
seconds; it needs a C++ compiler. On CUDA the graph is a CUDA graph. On the CPU noise comes from
torch's generator, which is faster than the graph's own. Runs are reproducible, but differ from
eager ones.
"""

import traceback
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torch.func import functional_call, grad

from bricksrl.agents.actor_critic import ActorCriticLoss, Batch
from bricksrl.agents.crossq import CrossQLoss
from bricksrl.agents.gradient_descent import GradientLearner
from bricksrl.agents.learner import Learner
from bricksrl.agents.offline.cql import CQLLoss
from bricksrl.errors import RunError


class _Parts(nn.Module):
    """The parts of a loss as one forward pass for `functional_call`."""

    def __init__(self, loss: ActorCriticLoss) -> None:
        super().__init__()
        self.loss = loss

    def forward(
        self,
        transitions: Any,
        batch: Batch | None = None,
    ) -> Any:
        # `functional_call` knows one forward pass for a module: it tells the parts by the arguments
        if batch is not None:
            return self.loss.actor_loss(batch)
        batch = self.loss.encode(transitions)
        return batch, self.loss.qvalue_loss(batch)


class CompiledGradients:
    """Losses and gradients of a batch from a compiled graph; see `GradientDescent`. ``backend``:
    of ``torch.compile``."""

    def __init__(
        self,
        loss: ActorCriticLoss,
        device: torch.device,
        backend: str = "inductor",
    ) -> None:
        self._parts = _Parts(loss)
        self._device = device
        self._keys = loss.in_keys
        params: dict[str, Tensor] = {}
        critic_params: dict[str, Tensor] = {}
        for name, value in self._parts.named_parameters():
            if not value.requires_grad:
                continue
            params[name] = value
            # an update without the actor trains the encoder too, through the critics' loss
            if name.startswith(("loss.critics.", "loss.encoder.")):
                critic_params[name] = value
        # by whether an update includes the actor
        self._params = {True: params, False: critic_params}
        # graphs of earlier learners in this process count towards a limit
        torch.compiler.reset()
        options: dict[str, Any]
        if device.type == "cuda":
            options = {"triton.cudagraphs": True}
        else:
            options = {"fallback_random": True}
        # nothing changes the modules, so that no update has to check whether something did
        options["guard_filter_fn"] = torch.compiler.skip_guard_on_all_nn_modules_unsafe
        self._graph = torch.compile(
            self._gradients,
            fullgraph=True,
            dynamic=False,
            options=options,
            backend=backend,
        )

    def _gradients(
        self,
        params: dict[str, Tensor],
        transitions: Any,
        with_actor: bool,
    ) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        def total(params: dict[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
            batch, losses = functional_call(self._parts, params, (transitions,))
            if with_actor:
                # the actor's loss passes through the critics, which must not learn from it
                held_params = dict(params)
                for name, value in params.items():
                    if name.startswith("loss.critics."):
                        held_params[name] = value.detach()
                actor_losses = functional_call(self._parts, held_params, (transitions, batch))
                losses = losses | actor_losses
            # the others are metrics, such as the temperature
            minimised = [value for name, value in losses.items() if name.startswith("loss")]
            summed = torch.stack(minimised).sum()
            reported = {name: value.detach() for name, value in losses.items()}
            return summed, reported

        result: tuple[dict[str, Tensor], dict[str, Tensor]] = grad(total, has_aux=True)(params)
        return result

    def __call__(
        self,
        batch: TensorDictBase,
        with_actor: bool,
    ) -> TensorDict:
        """Losses of a batch; their gradients are written to the parameters. Raises RunError without
        a compiler."""
        # the count of steps is there with n-step returns only
        selected = batch.select(*self._keys, "steps_to_next_obs", strict=False)
        # plain dictionaries: the graph is of tensors alone
        transitions = selected.to_dict()
        params: dict[str, Tensor] = {**self._params[with_actor]}
        try:
            # otherwise the graph also keeps tensors for second derivatives
            with torch.no_grad():
                gradients, losses = self._graph(params, transitions, with_actor)
        except Exception as error:
            # what went wrong stands anywhere in the chain of torch's errors
            causes = "".join(traceback.format_exception(error))
            if "InvalidCxxCompiler" in causes or "No working C++ compiler" in causes:
                remedy = "install one (such as g++ or clang), or omit --compile"
                raise RunError(f"there is no C++ compiler; {remedy}") from None
            raise
        for name, parameter in params.items():
            parameter.grad = gradients[name]
        # the next replay of a CUDA graph overwrites its outputs
        if self._device.type == "cuda":
            losses = {name: value.clone() for name, value in losses.items()}
        return TensorDict(losses)


def compile_updates(learner: Learner) -> None:
    """Compile a learner's updates. Raises RunError if its algorithm cannot be compiled."""
    not_ours = RunError("only SAC, DroQ, REDQ and TD3 can be compiled; omit --compile")
    if not isinstance(learner, GradientLearner):
        raise not_ours
    loss = learner.loss
    if not isinstance(loss, ActorCriticLoss) or isinstance(loss, CrossQLoss | CQLLoss):
        raise not_ours
    # a graph of gradients changes no running statistics
    if any(isinstance(module, nn.BatchNorm1d) for module in loss.modules()):
        raise RunError(
            "batch normalisation cannot be compiled; choose layer or rms, or omit --compile"
        )
    # an anchor counts updates in Python, where a graph would keep the first count
    if loss.anchor is not None:
        raise RunError("an anchored policy cannot be compiled; omit --compile")
    loss.is_compiled = True
    learner.descent.gradients = CompiledGradients(loss, learner.device)
