"""Action chunking with transformers (ACT, Zhao et al. 2023): imitation of what was done over several steps.

TorchRL's ``ACTLoss`` is its oracle, but for the steps after an episode's end, which count nothing here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from bricksrl.agents.agent import Transition
from bricksrl.agents.chunk_networks import ChunkActor, ChunkReader
from bricksrl.agents.layout import ObservationLayout
from bricksrl.agents.learner import step
from bricksrl.agents.plan import Plan
from bricksrl.agents.presets import ACTSettings
from bricksrl.agents.student import Student

if TYPE_CHECKING:
    from bricksrl.envs.task import Task


@dataclass(frozen=True)
class Chunks:
    """What was seen, and done from there on: ``features`` ``[batch, f]``, ``action`` ``[batch, k, m]``.

    ``known`` ``[batch, k]`` is true before the end of the episode; after it ``action`` is zero.
    """

    features: Tensor
    action: Tensor
    known: Tensor


class ACTAgent(Student):
    """ACT for one robot; see `ACTSettings`. What it does itself teaches it nothing.

    It acts by a plan, so `start_acting` must be called wherever an episode starts. It acts for many robots at once too, whose
    episodes then start together.
    """

    loss_names = ("actor_loss", "kl")

    def __init__(self, layout: ObservationLayout, action_size: int, settings: ACTSettings, task: Task | None = None) -> None:
        del task  # its goals cannot be exchanged: what was done, was done for the one that there was
        super().__init__(layout, action_size, settings)
        self.settings = settings
        sizes = self.encoder.size, action_size, settings
        self.actor = ChunkActor(*sizes).eval()
        self.reader = ChunkReader(*sizes).eval() if settings.latent else None
        self._parameters: list[Tensor] = [*self.actor.parameters(), *(self.reader.parameters() if self.reader else ())]
        rates: dict[str, Any] = {"lr": settings.learning_rate, "weight_decay": settings.weight_decay}
        self._optimiser = torch.optim.AdamW(self._parameters, betas=(settings.adam_beta, 0.999), fused=True, **rates)
        self._plan = Plan(settings.executed, settings.ensemble)

    def start_acting(self) -> None:
        """Forget the plan."""
        self._plan.forget()

    def act(self, observation: Tensor, *, explore: bool) -> Tensor:
        """The action ``[*batch, m]`` that the plan has for this step; it never explores."""
        with torch.no_grad():
            return self._plan.next(lambda: self.predict(observation)).clamp(-1.0, 1.0)

    def predict(self, observation: Tensor) -> Tensor:
        """The chunk ``[*batch, k, m]`` that follows observations ``[*batch, n]``; not yet within -1..1."""
        features = self.encoder(observation)
        chunk: Tensor = self.actor(features.reshape(-1, features.shape[-1]))
        return chunk.view(*features.shape[:-1], *chunk.shape[1:])

    def remember(self, transition: Transition) -> None:
        """Forget it: there is nothing to imitate in what the imitator did."""

    def make_updates(self, count: int) -> list[tuple[Tensor, ...]]:
        """``count`` updates."""
        modules = [self.actor] if self.reader is None else [self.actor, self.reader]
        for module in modules:
            module.train()
        found: list[tuple[Tensor, ...]] = []
        for _ in range(count):
            distance, kl = self.losses(self.draw())
            step(self._optimiser, (distance + self.settings.kl_weight * kl, self._parameters))
            found.append((distance.detach(), kl.detach()))
        for module in modules:
            module.eval()
        self._updates += count
        return found

    def draw(self) -> Chunks:
        """A batch out of the dataset; chunks start at any step, and none reaches into another episode."""
        (data,) = self._sources()
        places = data.draw(self.settings.batch_size)
        there, known = data.after(places[:, None], torch.arange(self.settings.chunk))
        observation = data.rows(places).split(self._widths, -1)[0]
        action = data.rows(torch.where(known, there, places[:, None])).split(self._widths, -1)[1]
        return Chunks(self.encoder(observation), action * known[..., None], known)

    def losses(self, chunks: Chunks) -> tuple[Tensor, Tensor]:
        """Mean absolute distance of what would be done from what was done, and what the latent tells beyond a normal one."""
        latent, kl = None, torch.zeros(())
        if self.reader is not None:
            mean, log_variance = self.reader(chunks.features, chunks.action, chunks.known)
            latent = mean + (0.5 * log_variance).exp() * torch.randn_like(mean)
            kl = 0.5 * (mean.square() + log_variance.exp() - log_variance - 1.0).sum(-1).mean()
        away = (self.actor(chunks.features, latent) - chunks.action).abs().mean(-1)
        return away[chunks.known].mean(), kl

    def _parts(self) -> dict[str, Any]:
        parts = {"actor": self.actor, "optimiser": self._optimiser}
        return parts if self.reader is None else {**parts, "reader": self.reader}
