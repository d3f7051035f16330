"""Programs of hubs that broadcast and observe, drawn at random."""

from __future__ import annotations

import random

HEAD = """
from pybricks.messaging import BLERadio
from pybricks.tools import StopWatch, wait
"""


def random_program(rng: random.Random, own: int) -> str:
    other = 1 - own
    lines = [f"{HEAD}radio = BLERadio({own}, [{other}])\nx = 0\n"]
    for _ in range(rng.randint(3, 9)):
        lines.append(
            rng.choice(
                (
                    f"wait({rng.randint(1, 400)})\n",
                    f"radio.broadcast(({rng.randint(-9, 9)}, x))\n",
                    f"print(radio.observe({other}), radio.signal_strength({other}))\n",
                    "for i in range(50):\n    x += i\n    wait(1)\n",
                    f"while radio.observe({other}) is None and x < 200:\n    x += 1\n    wait(3)\n",
                )
            )
        )
    return "".join(lines)
