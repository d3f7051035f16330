"""The reference names every name that a user's file may import, and `llms.txt` every page."""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path

import pytest

from brickhub.robot import Direction, HubKind, MotorKind, SensorKind

DOCS = Path(__file__).parents[2] / "docs"
REFERENCE = (DOCS / "reference" / "api.md").read_text(encoding="utf-8")
DOCUMENTED = {
    place.rpartition(".")[2] for place in re.findall(r"auto(?:class|function):: (\S+)", REFERENCE)
}
DOCUMENTED |= {
    name.strip() for names in re.findall(r":members: (.+)", REFERENCE) for name in names.split(",")
}
OF_USERS = (
    "bricksrl.agents.features.encoder",
    "bricksrl.agents.networks",
    "bricksrl.agents.operators",
    "bricksrl.agents.settings",
    "bricksrl.envs",
    "bricksrl.interfaces.gymnasium",
    "bricksrl.hub.interface",
    "bricksrl.robots",
    "bricksrl.twin.objects",
    "bricksrl.twin.scene",
)
"""Modules that files of users import from."""
INTERNAL = {
    "BatchNorm",
    "Critic",
    "Dropout",
    "Encoder",
    "HubModel",
    "Keyed",
    "Presets",
    "Sense",
    "Sensor",
    "WireNumber",
    "drive_base",
    "drive_base_setup",
    "get",
}
"""Public names of these modules that no file of a user needs."""


def importable(module_name: str) -> set[str]:
    """Public classes and functions of ours in a module, also those that it passes on from another
    house."""
    module = importlib.import_module(module_name)
    home = getattr(module, "__all__", None)
    names = set()
    for name, value in vars(module).items():
        if name.startswith("_") or not (inspect.isclass(value) or inspect.isfunction(value)):
            continue
        place = value.__module__
        if place.endswith((".errors", ".fields")):
            continue
        passes_on = module_name.startswith(("bricksrl.robots", "bricksrl.hub.", "bricksrl.twin."))
        is_of = place == module_name or (
            place.startswith(("brickhub.", "bricktwin.")) and passes_on
        )
        if is_of or (home is not None and name in home and place.startswith("brick")):
            names.add(name)
    return names


@pytest.mark.parametrize("module", OF_USERS)
def test_reference_names_all_that_users_import(module):
    names = importable(module)
    assert names
    assert not names - DOCUMENTED - INTERNAL


def test_documented_places_exist():
    for place in re.findall(r"auto(?:class|function):: (\S+)", REFERENCE):
        module, _, name = place.rpartition(".")
        assert hasattr(importlib.import_module(module), name), place


def test_imports_of_the_pages_are_in_the_reference():
    pattern = re.compile(
        r"^ *from (bricksrl\.(?:robots|hub\.interface|twin\.\w+|envs(?:\.\w+)*)) import (.+)$",
        re.MULTILINE,
    )
    for page in DOCS.glob("*.md"):
        for _, names in pattern.findall(page.read_text(encoding="utf-8")):
            classes = {name.strip() for name in names.split(",") if not name.strip().isupper()}
            assert classes - {"ARENAS", "encode_images"} <= DOCUMENTED, page.name


@pytest.mark.parametrize("kind", [HubKind, MotorKind, SensorKind, Direction])
def test_wrong_kind_is_answered_with_all_kinds(kind):
    with pytest.raises(
        AttributeError, match=f"there is no {kind.__name__}.BLUE; choose .*{list(kind)[-1].name}"
    ):
        kind.BLUE  # noqa: B018


def test_examples_of_the_reference_run():
    for block in re.findall(r"```python\n(.*?)```", REFERENCE, re.DOTALL):
        exec(compile(block, "api.md", "exec"), {})  # noqa: S102  our own examples


def test_llms_txt_names_every_page():
    text = (DOCS / "llms.txt").read_text(encoding="utf-8")
    linked = set(re.findall(r"\]\(([\w/]+)\.html\)", text))
    pages = {path.stem for path in DOCS.glob("*.md")} - {"index"}
    assert pages <= linked, pages - linked
    assert all(
        (DOCS / f"{name}.md").exists() or name in ("reference/cli", "reference/environments")
        for name in linked
    )
