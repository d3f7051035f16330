"""``bricksrl list``."""

from __future__ import annotations

import json

from bricksrl import agents, envs, robots

SHIPPED = ("RunAway-v0", "Spinning-v0", "Walker-v0", "RoboArm-v0")


def test_table_lists_all_environments(bricksrl):
    done = bricksrl("list")
    assert (done.returncode, done.stderr) == (0, "")
    for name in (*SHIPPED, *agents.AGENTS, *agents.PRESETS, *robots.ROBOTS):
        assert name in done.stdout


def test_json_is_one_object(bricksrl):
    done = bricksrl("list", "--json")
    listed = json.loads(done.stdout)
    ids = [env["id"] for env in listed["environments"]]
    # other tests register more, in this process
    assert set(SHIPPED) <= set(ids) <= set(envs.list_envs())
    assert ids == sorted(ids)
    assert listed["agents"] == list(agents.AGENTS)
    run_away = next(env for env in listed["environments"] if env["id"] == "RunAway-v0")
    assert run_away["observation"] == ["left_angle", "right_angle", "pitch", "roll", "distance"]
    assert run_away["action"] == ["straight"]
    assert run_away["max_steps"] == 20
