"""``bricksrl doctor``."""

from __future__ import annotations

import errno
import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from brickhub.finding import Outcome
from bricksrl.cli import doctor, main
from bricksrl.errors import TwinError


def test_doctor_answers_on_this_computer(capfd) -> None:
    code = main(("doctor",))
    written = capfd.readouterr()
    lines = written.out.splitlines()
    assert (code, written.err) == (0, "")
    assert [line.split()[1] for line in lines] == list(doctor.CHECKS)
    assert {line.split()[0] for line in lines} <= {"ok", "warning"}
    assert lines[0].startswith("ok ") and lines[1].startswith("ok ")


def test_json(capfd, monkeypatch) -> None:
    monkeypatch.setattr(
        doctor.Doctor,
        "checks",
        {"disk": doctor.check_disk, "bad": lambda: (Outcome.ERROR, "it is; mend it")},
    )
    assert main(("doctor", "--json")) == 1
    told = json.loads(capfd.readouterr().out)
    assert told["ok"] is False
    assert told["findings"][1] == {"name": "bad", "outcome": "error", "detail": "it is; mend it"}


def test_invalid_time_limit(fails) -> None:
    fails("doctor", "--timeout-s", "0", says="give a positive number")


def test_packages_of_all_houses_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr("importlib.metadata.requires", asked.append)
    outcome, detail = doctor.CHECKS["packages"]()
    assert asked == ["bricksrl", "bricktwin", "brickhub"]
    assert outcome is Outcome.OK and all(
        name in detail for name in ("bricksrl ", "torch ", "torchrl ", "mujoco ", "bleak ")
    )


def test_crashing_driver_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "_DRAW", "import os, signal; os.kill(os.getpid(), signal.SIGTERM)")
    outcome, detail = doctor.check_opengl()
    assert outcome is Outcome.WARNING and "all the rest works" in detail
    monkeypatch.setattr(doctor, "_DRAW", "import time; time.sleep(20)")
    monkeypatch.setattr(doctor, "_DRAW_S", 0.3)
    assert "nothing was drawn within 0.3 s" in doctor.check_opengl()[1]


def test_physics_and_cameras_are_told_with_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    outcome, detail = doctor.check_physics()
    assert outcome is Outcome.OK and re.fullmatch(r"MuJoCo \d+\.\d+\.\d+", detail)
    monkeypatch.setattr("mujoco.mj_step", lambda *_: None)
    assert doctor.check_physics() == (
        Outcome.ERROR,
        "MuJoCo loads, but nothing falls; install mujoco again",
    )

    def refuse() -> None:
        raise TwinError("MuJoCo cannot be loaded")

    monkeypatch.setattr(doctor, "check_mujoco", refuse)
    with pytest.raises(TwinError, match="cannot be loaded"):
        doctor.check_physics()
    monkeypatch.setitem(sys.modules, "cv2", None)
    outcome, detail = doctor.check_opencv()
    assert outcome is Outcome.WARNING
    assert detail.startswith("none (") and 'pip install "bricksrl[vision]"' in detail
    monkeypatch.setitem(sys.modules, "cv2", SimpleNamespace(__version__="4.1"))
    assert doctor.check_opencv() == (Outcome.OK, "OpenCV 4.1")


@pytest.mark.parametrize(
    ("free", "outcome"),
    [
        (499_999_999, Outcome.ERROR),
        (500_000_000, Outcome.WARNING),
        (4_999_999_999, Outcome.WARNING),
        (5_000_000_000, Outcome.OK),
    ],
)
def test_disk_space(monkeypatch: pytest.MonkeyPatch, free: int, outcome: Outcome) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": free}))
    found, detail = doctor.check_disk()
    assert found is outcome
    assert detail.startswith(f"{free / 10**9:.1f} GB free in ")


def test_folder_that_takes_no_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Windows says of every folder that it can be written to."""

    def refuse(*_: object) -> None:
        raise PermissionError(errno.EACCES, "Access is denied")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Path, "open", refuse)
    outcome, detail = doctor.check_disk()
    assert outcome is Outcome.WARNING and "cannot be written to" in detail
