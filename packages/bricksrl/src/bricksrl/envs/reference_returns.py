"""Reference returns of our environments: random actions, a scripted controller, and the paper's SAC.

The first two are from `benchmarks/results/baselines.json`, over 20 to 50 episodes on virtual robots. The paper's are the means
of its SAC on real robots (BricksRL, arXiv:2406.17490), as in `benchmarks/results/robots.json`.
"""

from __future__ import annotations

from dataclasses import dataclass

from brickhub.tables import read_table


@dataclass(frozen=True)
class ReferenceReturns:
    """Mean returns to compare a learning curve with; ``None`` where the paper has none."""

    random: float
    scripted: float
    paper: float | None = None

    def lines(self) -> dict[str, float]:
        """Each return by the label of its line."""
        lines = {"random": self.random, "by hand": self.scripted}
        return lines if self.paper is None else {**lines, "paper's SAC": self.paper}


def _reference(row: dict[str, str]) -> ReferenceReturns:
    return ReferenceReturns(float(row["random"]), float(row["scripted"]), float(row["paper"]) if row["paper"] else None)


REFERENCES = {row["env"]: _reference(row) for row in read_table(__package__, "reference_returns")}


def reference_lines(env: str, options: dict[str, object] | None = None) -> dict[str, float]:
    """Reference returns of an environment by label; empty where its task has options, or is not one of ours."""
    return {} if options or env not in REFERENCES else REFERENCES[env].lines()
