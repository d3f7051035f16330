"""Reference returns of our environments: random actions, a scripted controller, and the paper's SAC.

The first two are from `benchmarks/results/baselines.json`, over 20 to 50 episodes on virtual robots. The paper's are the means
of its SAC on real robots (BricksRL, arXiv:2406.17490), as in `benchmarks/results/robots.json`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reference:
    """Mean returns to compare a learning curve with; ``None`` where the paper has none."""

    random: float
    scripted: float
    paper: float | None = None

    def lines(self) -> dict[str, float]:
        """Each return by the label of its line."""
        lines = {"random": self.random, "by hand": self.scripted}
        return lines if self.paper is None else {**lines, "paper's SAC": self.paper}


REFERENCES = {
    "RunAway-v0": Reference(0.44, 17.96, 8.72),
    "Spinning-v0": Reference(75.12, 8519.5, 7407.2),
    "Walker-v0": Reference(-197.09, -12.89, -52.04),
    "Walker-v1": Reference(15.62, 93.22),
    "WalkerSim-v0": Reference(-198.51, -4.95),
    "WalkerSim-v1": Reference(-197.18, 5.53),
    "LineFollow-v0": Reference(-42.91, 50.93),
    "Park-v0": Reference(-62.93, 9.13),
    "RoboArm-v0": Reference(-152.87, -1.47, -27.77),
    "RoboArmSim-v0": Reference(-162.96, -0.55),
    "RoboArm_mixed-v0": Reference(-57.36, -1.36),
}


def reference_lines(env: str, options: dict[str, object] | None = None) -> dict[str, float]:
    """Reference returns of an environment by label; empty where its task has options, or is not one of ours."""
    return {} if options or env not in REFERENCES else REFERENCES[env].lines()
