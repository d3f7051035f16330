"""Reference returns of our environments: random actions, a scripted controller, and the paper's
SAC.

The first two are from `benchmarks/results/baselines.json`, over 20 to 50 episodes on virtual
robots. The paper's are the means of its SAC on real robots (BricksRL, arXiv:2406.17490), as in
`benchmarks/results/robots.json`.
"""

from brickhub.tables import read_table

_LABELS = {"random": "random", "scripted": "by hand", "paper": "paper's SAC"}
REFERENCES = {
    row["env"]: {label: float(row[column]) for column, label in _LABELS.items() if row[column]}
    for row in read_table(__package__, "tasks/reference_returns")
}
"""Mean returns to compare a learning curve with, by environment and the label of their line."""


def reference_lines(env: str, options: dict[str, object] | None = None) -> dict[str, float]:
    """Reference returns of an environment by label; empty where its task has options, or is not one
    of ours."""
    return {} if options else REFERENCES.get(env, {})
