"""Export of a trained policy, from observation to action, to one file that is independent of
BricksRL, and verified.

A policy that learned behind transforms takes what they made: whoever runs the file stacks frames or
skips steps.
"""

import importlib.util
import io
import logging
import math
import warnings
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, Literal

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from brickhub.files import check_writable, refuse_existing, write_durably
from bricksrl.agents.features.observed import SeenInputs
from bricksrl.envs.specs import ObservationLayout
from bricksrl.envs.transforms import layout_of
from bricksrl.errors import RunError, message_of
from bricksrl.policies import load_policy, make_env_of
from bricksrl.policies.policy import Policy
from bricksrl.training.restore import Which

Format = Literal["torch-export", "onnx"]
"""File format: a program of ``torch.export``, or ONNX."""
TOLERANCE = 1e-4
"""Largest allowed difference between an action of the file and the policy's; actions are in
-1..1."""
_OBSERVATIONS = 64
_ONNX = ("onnx", "onnxscript")


class BestAction(nn.Module):
    """Deterministic action ``[batch, m]`` of a policy, as a function of observations ``[batch, n]``
    and images, if used."""

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.module = policy.module
        self.names = [str(key) for key in policy.in_keys]

    def forward(self, *inputs: Tensor) -> Tensor:
        observed = TensorDict(dict(zip(self.names, inputs, strict=True)), inputs[0].shape[:1])
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            action: Tensor = self.module(observed)["action"]
        return action


def export_model(
    path: Path | str,
    out: Path,
    format_: Format = "torch-export",
    *,
    which: Which = "last",
) -> float:
    """Export the policy of a run, or a shared one, to the file ``out``; read it back, and compare.

    Returns:
        The largest difference of its actions from the policy's, over random observations.

    Raises:
        RunError: ``out`` exists, packages are missing, or the policy is no function of its
            observation.
        WriteError: ``out`` cannot be written.
        CheckpointError: the policy is damaged.
    """
    refuse_existing(out, RunError)
    check_writable(out)
    needed = _ONNX if format_ == "onnx" else ()
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        names = " and ".join(missing)
        raise RunError(
            f'export as onnx needs {names}; run `pip install "bricksrl[onnx]"`, or export as '
            "torch-export"
        )
    with closing(make_env_of(Path(path))) as env:
        policy = load_policy(path, env, which=which)
        layout = layout_of(env)
        named = _observations(env, layout)
        inputs = tuple(named[key] for key in policy.in_keys)
    acting = BestAction(policy).eval().requires_grad_(False)
    for module in acting.modules():
        if isinstance(module, SeenInputs):
            module.says = False
    with torch.no_grad():
        expected = _best(policy, acting, inputs)
        data = _program(acting, inputs, format_)
    write_durably(out, data)
    # What counts is the file: it is read back as its user would.
    with torch.no_grad():
        actions = _reader(out, format_)(inputs)
        difference = float((actions - expected).abs().max())
    # This way round, so that NaN is too much as well.
    if not difference <= TOLERANCE:
        out.unlink()
        raise RunError(
            f"what was written acts otherwise, by {difference:.2g} of 2; export in another format"
        )
    return difference


def _best(
    policy: Policy,
    acting: BestAction,
    inputs: tuple[Tensor, ...],
) -> Tensor:
    """The policy's actions, computed twice in different order. Raises RunError if the results
    differ."""
    first: Tensor = acting(*inputs)
    policy.reset()
    # A policy that draws, or remembers what came before, acts otherwise in another order.
    reversed_inputs = [value.flip(0) for value in inputs]
    flipped = acting(*reversed_inputs).flip(0)
    if not torch.allclose(first, flipped, atol=TOLERANCE):
        raise RunError(
            "the policy's action depends on more than what it observes; export one that acts at "
            "once and not by chance"
        )
    return first


def _observations(env: EnvBase, layout: ObservationLayout) -> dict[str, Tensor]:
    """Random vectors ``[batch, n]`` within their bounds, and images, if there are any."""
    generator = torch.Generator().manual_seed(0)
    # What has no bound is drawn within -1..1.
    low = torch.tensor(layout.low).nan_to_num(posinf=1.0, neginf=-1.0)
    high = torch.tensor(layout.high).nan_to_num(posinf=1.0, neginf=-1.0)
    numbers = low + (high - low) * torch.rand(_OBSERVATIONS, len(low), generator=generator)
    if layout.scale:
        numbers = numbers * torch.tensor(layout.scale) + torch.tensor(layout.offset)
    shapes = dict(layout.vectors)
    vectors = numbers.split([math.prod(shape) for shape in shapes.values()], -1)
    drawn = {}
    for (key, shape), values in zip(shapes.items(), vectors, strict=True):
        drawn[key] = values.view(_OBSERVATIONS, *shape)
    for image in layout.images:
        spec = env.full_observation_spec_unbatched[image.key]
        pixels = torch.rand(_OBSERVATIONS, *spec.shape, generator=generator)
        drawn[image.key] = pixels.mul(image.high).to(spec.dtype)
    return drawn


def _program(
    acting: BestAction,
    inputs: tuple[Tensor, ...],
    format_: Format,
) -> bytes:
    """Content of the file, for any batch size. Raises RunError if torch cannot export the
    policy."""
    any_batch = tuple({0: torch.export.Dim.DYNAMIC} for _ in inputs)
    buffer = io.BytesIO()
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(action="ignore"):  # torch's warnings
            program = torch.export.export(acting, inputs, dynamic_shapes=(any_batch,))
            if format_ == "torch-export":
                torch.export.save(program, buffer)
            else:
                # It accepts buffers too, contrary to its annotations.
                write: Any = torch.onnx.export
                write(
                    program,
                    (),
                    buffer,
                    input_names=acting.names,
                    output_names=["action"],
                    verbose=False,
                )
    except Exception as error:  # noqa: BLE001  torch may raise anything on a user's network
        raise RunError(
            f"torch cannot export this policy ({message_of(error)}); use it through "
            "bricksrl.load_policy"
        ) from None
    finally:
        logger.setLevel(level)
    return buffer.getvalue()


def _reader(path: Path, format_: Format) -> Callable[[tuple[Tensor, ...]], Tensor]:
    """The exported file as a function."""
    if format_ == "torch-export":
        module: Any = torch.export.load(path).module()
        return lambda inputs: module(*inputs)
    from onnx.reference import ReferenceEvaluator

    evaluator = ReferenceEvaluator(str(path))

    def evaluate(inputs: tuple[Tensor, ...]) -> Tensor:
        arrays = [value.numpy() for value in inputs]
        feed = dict(zip(evaluator.input_names, arrays, strict=True))
        outputs: Any = evaluator.run(None, feed)
        return torch.from_numpy(outputs[0])

    return evaluate
