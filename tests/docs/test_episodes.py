"""Recorded episodes of the documentation, opened as files in a browser."""

from __future__ import annotations

from pathlib import Path

import pytest
from browser import chromium, tab

from benchmarks.episodes import FOLDER, MAX_BYTES, page_of
from bricksrl.envs.registry import is_simulation, list_envs


def test_every_robot_has_a_small_one() -> None:
    sizes = {path.stem: path.stat().st_size for path in FOLDER.glob("*.json")}
    assert sizes.keys() == {env_id for env_id in list_envs() if not is_simulation(env_id)}
    assert max(sizes.values()) < MAX_BYTES


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.json")), ids=lambda path: path.stem)
def test_episode_plays_is_turned_and_scrubbed(path: Path, tmp_path: Path) -> None:
    (tmp_path / "episode.html").write_text(page_of(path), encoding="utf-8")
    with (
        chromium() as browser,
        tab(browser, (tmp_path / "episode.html").as_uri(), 640, 400) as page,
    ):
        page.wait_for_function("document.getElementById('scene').dataset.frames > 3")
        page.get_by_role("button", name="Pause").click()
        page.get_by_role("slider", name="time").fill("2000")
        page.wait_for_function("document.getElementById('now').textContent === '2.0 s'")
        page.wait_for_timeout(1_500)
        still = page.screenshot()
        page.mouse.move(320, 200)
        page.mouse.down()
        page.mouse.move(420, 180, steps=4)
        page.mouse.up()
        page.wait_for_timeout(1_500)
        turned = page.screenshot()
        page.get_by_role("slider", name="time").fill("3000")
        page.wait_for_timeout(1_500)
        assert still != turned != page.screenshot()
