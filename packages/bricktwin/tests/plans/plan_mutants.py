"""Plans with one mistake each."""

from __future__ import annotations

import random
from dataclasses import dataclass

import numpy as np

from bricktwin.plans import catalogue

KINDS = (
    "pin removed",
    "part removed",
    "part shifted",
    "two in one place",
    "part turned",
    "steps swapped",
    "port",
    "number",
)


@dataclass(frozen=True)
class Mutant:
    """A changed text, and the change."""

    kind: str
    what: str
    text: str


def mutant(text: str, seed: int) -> Mutant:
    """A plan's text with a mistake; kinds alternate."""
    rng = random.Random(seed)
    kind = KINDS[seed % len(KINDS)]
    lines = text.splitlines()
    places = [i for i, line in enumerate(lines) if line.startswith("1 ") and line.endswith(".dat")]
    if kind == "steps swapped":
        return _steps_swapped(lines, rng)
    if kind == "pin removed":
        places = [i for i in places if catalogue.get(lines[i].split()[14]).family == "pins"]
    if kind == "port":
        places = [i for i, line in enumerate(lines) if "!BRICKSRL PORT" in line]
    at = rng.choice(places)
    words, before = lines[at].split(), lines[at]
    if kind in ("pin removed", "part removed"):
        lines[at] = ""
    elif kind == "two in one place":
        lines.insert(at, lines[at])
    elif kind == "number":
        lines[at] = " ".join([*words[:14], "99999.dat"])
    elif kind == "port":
        others = [
            line.split()[3]
            for line in lines
            if "!BRICKSRL PORT" in line and line.split()[3] != words[3]
        ]
        lines[at] = (
            "" if rng.random() < 0.5 else " ".join([*words[:3], rng.choice(others), *words[4:]])
        )
    elif kind == "part shifted":
        axis, far = rng.randrange(3), rng.choice((-20, -10, 10, 20))
        words[2 + axis] = str(float(words[2 + axis]) + far)
        lines[at] = " ".join(words)
    else:
        turn = (
            np.roll(np.eye(3), 1, axis=0)
            if rng.random() < 0.5
            else np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        )
        matrix = turn @ np.array([float(word) for word in words[5:14]]).reshape(3, 3)
        lines[at] = " ".join([*words[:5], *(f"{value:g}" for value in matrix.ravel()), words[14]])
    return Mutant(kind, f"line {at + 1}: {before}", "\n".join(lines))


def _steps_swapped(lines: list[str], rng: random.Random) -> Mutant:
    """Swap two steps of the first model."""
    end = next(i for i, line in enumerate(lines) if line.startswith("0 NOFILE"))
    marks = [i for i in range(end) if lines[i] == "0 STEP"]
    start = next(i for i, line in enumerate(lines) if line.startswith("1 "))
    while lines[start - 1].startswith(("0 //", "0 !BRICKSRL PORT", "0 !BRICKSRL FREE")):
        start -= 1
    bounds = [start, *(mark + 1 for mark in marks)]
    blocks = [lines[a:b] for a, b in zip(bounds, bounds[1:], strict=False)]
    first, second = sorted(rng.sample(range(len(blocks)), 2))
    blocks[first], blocks[second] = blocks[second], blocks[first]
    text = [*lines[:start], *(line for block in blocks for line in block), *lines[bounds[-1] :]]
    return Mutant("steps swapped", f"steps {first + 1} and {second + 1}", "\n".join(text))
