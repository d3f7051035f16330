"""A run that was interrupted and resumed several times, compared with an uninterrupted one.

    python -m benchmarks resume

Trains SAC on `WalkerSim-v0` twice with one seed: uninterrupted, and stopped within an episode three
times. The returns must be equal to the last bit; `results/resume.png` shows both curves.
"""

from __future__ import annotations

import tempfile
import threading
from pathlib import Path

import torch

from benchmarks.session import Session
from bricksrl.plotting import new_figure, save
from bricksrl.training import Callback, Phase, TrainConfig, resume, train
from bricksrl.training.checkpoint import load_checkpoint

ENV, EPISODES = "WalkerSim-v0", 10
STOPS = ((3, 57), (5, 2), (8, 99))


class StopAt(Callback):
    """Callback that interrupts a run at a step."""

    def __init__(self, at: tuple[int, int] | None) -> None:
        self.stop = threading.Event()
        self._at = at

    def on_step(self, episode: int, step: int, phase: Phase) -> None:
        if (episode, step) == self._at:
            self.stop.set()


def weights(run_dir: Path) -> list[torch.Tensor]:
    """Final tensors of the actor."""
    actor = load_checkpoint(run_dir / "checkpoint.bin")["agent"]["policy"]
    return [tensor for tensor in actor.values() if isinstance(tensor, torch.Tensor)]


def draw(path: Path, whole: list[float], parts: list[float]) -> None:
    """Plot both curves, and the interruptions of the second."""
    figure = new_figure()
    axes = figure.add_subplot()
    episodes = range(1, len(whole) + 1)
    axes.plot(episodes, whole, color="#9fb8dc", linewidth=6, label="uninterrupted")
    axes.plot(
        episodes,
        parts,
        "o-",
        color="#0b5cad",
        linewidth=1.2,
        markersize=4,
        label="interrupted and resumed",
    )
    for number, (episode, step) in enumerate(STOPS):
        axes.axvline(
            episode - 1 + step / 100,
            color="#6b7280",
            linestyle=":",
            label=None if number else "interruption",
        )
    axes.set_xlabel("episode")
    axes.set_ylabel("return (sum of rewards)")
    axes.set_title(f"{ENV} · sac", loc="left", fontweight="bold")
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    save(figure, path)


def main(session: Session) -> None:
    """Train both and write the results."""
    session.parse()
    with tempfile.TemporaryDirectory() as folder:
        whole_dir, parts_dir = Path(folder) / "whole", Path(folder) / "parts"
        config = {"env": ENV, "episodes": EPISODES, "record": False}
        whole = train(TrainConfig(**config, run_dir=whole_dir))  # type: ignore[arg-type]
        first = StopAt(STOPS[0])
        train(TrainConfig(**config, run_dir=parts_dir), first, stop=first.stop)  # type: ignore[arg-type]
        for at in (*STOPS[1:], None):
            callback = StopAt(at)
            parts = resume(parts_dir, callback, stop=callback.stop)
        returns = [[episode.return_ for episode in result.episodes] for result in (whole, parts)]
        same = all(
            torch.equal(a, b) for a, b in zip(weights(whole_dir), weights(parts_dir), strict=True)
        )
    difference = max(abs(a - b) for a, b in zip(*returns, strict=True))
    result = {"environment": ENV, "episodes": EPISODES, "interrupted_at": STOPS}
    outcome = {"largest_difference_of_returns": difference, "weights_are_equal": same}
    print(outcome)
    session.write({**result, **outcome, "returns": returns})
    draw(session.path().with_suffix(".png"), *returns)
    assert same and difference == 0.0
