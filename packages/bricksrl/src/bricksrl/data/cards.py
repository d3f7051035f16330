"""Cards of datasets and policies for the Hugging Face hub."""

from __future__ import annotations

import json
from typing import Any

from bricksrl.data.summary import Summary
from bricksrl.errors import counted, percent


def dataset_card(summary: Summary, licence: str) -> str:
    """Card of a dataset, as Markdown."""
    robot = summary.robot or "no robot"
    success = "" if summary.success_rate is None else f"| success | {percent(summary.success_rate)} |\n"
    camera = f"\nImages of the camera `{summary.camera}` are in `videos`, without loss.\n" if summary.camera else ""
    return f"""---
license: {licence}
task_categories:
- robotics
tags:
- LeRobot
- BricksRL
- reinforcement-learning
configs:
- config_name: default
  data_files: data/*/*.parquet
---

# {summary.env} on {robot}

Recorded with BricksRL, in LeRobot's dataset format v3.0.

| | |
|---|---|
| environment | {summary.env} |
| robot | {robot} |
| episodes | {summary.episodes} |
| transitions | {summary.transitions} |
| return | {summary.return_mean:.4g} ± {summary.return_std:.4g} |
{success}| policy | {", ".join(f"{name} ({count})" for name, count in summary.policies.items())} |
| steps by hand | {summary.interventions} |
| steps a second | {summary.rate_hz:g} |

- `observation.state`: {", ".join(summary.observation)}
- `action`, in -1..1: {", ".join(summary.action)}
- `next.observation.state`, `next.reward`, `next.terminated`, `next.truncated`: what followed
- `intervention`: a human chose the action
- `age_s`, `hub_time_s`: age of the observation when the action left, and the hub's clock
{camera}
Units, ranges and the description of the robot are in `meta/bricksrl.json`.

```python
from bricksrl import data

episodes = data.load("folder")
```
"""


def policy_card(env: str, agent: str, episodes: int, evaluation: dict[str, Any] | None, licence: str) -> str:
    """Card of a policy, as Markdown, with the results of an evaluation if there is one."""
    result = "It has not been evaluated yet."
    if evaluation is not None:
        mean, std, count = evaluation["return_mean"], evaluation["return_std"], evaluation["episodes"]
        result = f"Return {mean:.4g} ± {std:.4g} in {counted(count, 'episode')} of evaluation."
    return f"""---
license: {licence}
library_name: bricksrl
pipeline_tag: reinforcement-learning
tags:
- BricksRL
- reinforcement-learning
- robotics
---

# {agent} for {env}

Trained with BricksRL on {json.dumps(env)} for {counted(episodes, "episode")}. {result}

`policy.safetensors` holds the tensors that the policy acts with, `policy.json` what they belong to.

```
bricksrl data pull <this repository> --policy --out policy
bricksrl record {env} --policy policy --out dataset
```
"""
