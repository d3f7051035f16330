"""Files of a site: names for the editor, robots in their worlds, and how they are stored."""

from __future__ import annotations

import gzip
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from brickhub.hub.transports import profile
from brickhub.robot import HubKind, MotorKind, Sense, SensorKind
from bricktwin.robots import TWO_WHEELER
from bricktwin.site import robots
from bricktwin.site.names import device_table, link_names, pybricks_names
from bricktwin.site.robots import write_robots
from bricktwin.site.storing import PACKED, pack, undated, write_json, write_packed_json
from bricktwin.twin.objects import Line
from bricktwin.twin.scene import Scene


def unpacked(path: Path) -> Any:
    return json.loads(gzip.decompress(path.with_name(path.name + PACKED).read_bytes()))


def test_the_same_content_makes_the_same_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = {"name": "Größe", "values": [1, 2.5, None]}
    write_packed_json(tmp_path / "a.json", content)
    first = (tmp_path / "a.json.packed").read_bytes()
    monkeypatch.setattr(time, "time", lambda: 4e9)
    write_packed_json(tmp_path / "a.json", content)
    assert (tmp_path / "a.json.packed").read_bytes() == first
    assert unpacked(tmp_path / "a.json") == content
    write_json(tmp_path / "b.json", content)
    assert (tmp_path / "b.json").read_text("utf-8") == '{"name":"Größe","values":[1,2.5,null]}'
    (tmp_path / "big.txt").write_text("x" * 10_000)
    (tmp_path / "out").mkdir()
    pack(tmp_path / "big.txt", tmp_path / "out")
    packed = (tmp_path / "out" / "big.txt.packed").read_bytes()
    assert gzip.decompress(packed) == b"x" * 10_000 and len(packed) < 100
    entry = undated("a/b.py")
    assert (entry.filename, entry.date_time) == ("a/b.py", (1980, 1, 1, 0, 0, 0))


def test_the_editor_knows_what_a_program_can_name() -> None:
    names = pybricks_names()
    assert {"pybricks.hubs", "pybricks.pupdevices", "pybricks.tools", "umath"} <= set(
        names["modules"]
    )
    assert "PrimeHub" in names["modules"]["pybricks.hubs"]
    assert {"wait", "StopWatch"} <= set(names["modules"]["pybricks.tools"])
    assert {"run", "run_angle", "angle"} <= set(names["members"]["Motor"])
    assert {"RED", "NONE"} <= set(names["members"]["Color"])
    assert {"CLOCKWISE"} <= set(names["members"]["Direction"])
    # Functions have no members, and modules of MicroPython no classes.
    assert "wait" not in names["members"]
    assert {"imu", "speaker"} <= set(names["members"]["PrimeHub"])
    assert {"tilt", "heading"} <= set(names["parts"]["imu"])
    for listed in (names["modules"], names["members"], names["parts"]):
        assert not [name for one in listed.values() for name in one if name.startswith("_")]


def test_the_bench_knows_all_devices() -> None:
    table = device_table()
    assert {"Motor", "DCMotor", *(kind.model.class_name for kind in MotorKind)} == set(
        table["motors"]
    )
    assert table["motors"] == sorted(table["motors"])
    assert set(table["sensors"]) == {kind.value for kind in SensorKind}
    assert str(Sense.DISTANCE) in table["sensors"][SensorKind.ULTRASONIC.value]
    prime = table["hubs"][HubKind.PRIME.model.class_name]
    assert prime == {"buttons": list(HubKind.PRIME.model.buttons), "display": True, "screen": None}
    brick = table["hubs"][HubKind.EV3.model.class_name]
    assert brick["screen"] == HubKind.EV3.model.screen_pixels and not brick["display"]


def test_the_page_names_hubs_to_the_browser() -> None:
    names = link_names()
    assert names["bluetooth"] == {
        "filters": [{"services": [profile.SERVICE_UUID]}],
        "optionalServices": [profile.DEVICE_INFORMATION_UUID],
    }
    assert {"usbVendorId": 0x0694, "usbProductId": 0x0005} in names["cable"]["filters"]
    assert names["command"] == profile.COMMAND_EVENT_UUID


MINE = Scene(objects=(Line(((0, 0), (300, 0))),))
WALL = Scene(wall_distance_mm=(300.0, 300.0))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, Any]]]:
    folder = tmp_path_factory.mktemp("site")
    # Without a model they get bodies that are made of their numbers, which takes no time.
    driver = replace(TWO_WHEELER, model=None)
    blind = replace(driver, name="blind", sensors=())
    index = write_robots(
        folder, (driver, blind), {"wall": WALL, "my_mat": MINE}, {"blind": {"desk": MINE}}
    )
    return folder, index


def test_each_robot_is_in_the_worlds_that_it_can_be_in(
    site: tuple[Path, list[dict[str, Any]]],
) -> None:
    _, index = site
    found = {robot["name"]: [world["name"] for world in robot["worlds"]] for robot in index}
    assert found == {
        "two-wheeler": ["open floor", "wall", "my_mat"],
        # Before a wall it is put by what its sensor sees.
        "blind": ["open floor", "my_mat", "desk"],
    }
    assert [(robot["title"], robot["drives"]) for robot in index] == [
        ("2Wheeler", True),
        ("blind", True),
    ]
    assert index[0]["worlds"][2]["title"] == "my mat"


def test_a_world_s_file_has_physics_and_drawing(site: tuple[Path, list[dict[str, Any]]]) -> None:
    folder, index = site
    driver = index[0]
    meshes = unpacked(folder / driver["meshes"])
    assert meshes
    files = [unpacked(folder / world["file"]) for world in driver["worlds"]]
    for file, world in zip(files, driver["worlds"], strict=True):
        assert set(file) == {"robot", "drawing", "start"}
        assert len(file["start"]) % 7 == 0 and len(file["start"]) > 14
        numbers = [mesh for mesh in file["drawing"]["meshes"] if isinstance(mesh, int)]
        assert all(0 <= number < len(meshes) for number in numbers) and numbers
        is_behind = file["drawing"]["view"]["yaw_deg"] == -150.0
        assert is_behind is (world["name"] != "open floor")
    # Meshes of the robot itself are stored once.
    assert all(isinstance(mesh, int) for mesh in files[0]["drawing"]["meshes"])
    # What it can learn there; nobody has to hold it upright.
    goals = {
        (robot["name"], world["name"]): world["lesson"] and world["lesson"]["goal"]
        for robot in index
        for world in robot["worlds"]
    }
    assert {place: goal for place, goal in goals.items() if goal} == {
        ("two-wheeler", "wall"): "stop"
    }


def test_fewer_worlds_of_a_robot_are_ours_alone() -> None:
    fewer = robots._FEWER_WORLDS["ev3-driver"]
    assert set(fewer) <= set(robots.WORLDS)
    assert robots._can_be_in(TWO_WHEELER, WALL)
    assert robots._can_be_in(replace(TWO_WHEELER, sensors=()), MINE)
    assert robots._held(TWO_WHEELER, MINE) is MINE
