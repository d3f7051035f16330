"""``brickhub doctor``."""

from __future__ import annotations

import json
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from brickhub.cli import doctor, main
from brickhub.errors import BluetoothUnavailableError, HubError
from brickhub.finding import Outcome
from brickhub.hub.transports import ble


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
        {"python": doctor.check_python, "bad": lambda: (Outcome.ERROR, "it is; mend it")},
    )
    assert main(("doctor", "--json")) == 1
    told = json.loads(capfd.readouterr().out)
    assert told["ok"] is False
    assert told["findings"][1] == {"name": "bad", "outcome": "error", "detail": "it is; mend it"}


def test_doctor_never_hangs_or_raises(capfd, monkeypatch) -> None:
    def broken() -> doctor.Answer:
        raise RuntimeError("a library\nof another time")

    monkeypatch.setattr(doctor.Doctor, "checks", {"slow": lambda: time.sleep(20), "broken": broken})
    start_s = time.monotonic()
    assert main(("doctor", "--timeout-s", "0.3")) == 1
    assert time.monotonic() - start_s < 5.0
    slow, bad = capfd.readouterr().out.splitlines()
    assert slow.startswith("warning") and "no answer within 0.3 s" in slow
    assert bad.startswith("error") and "RuntimeError: a library of another time; install" in bad


def test_invalid_time_limit(fails) -> None:
    fails("doctor", "--timeout-s", "0", says="give a positive number")


@pytest.fixture
def linux(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A computer with everything."""
    for folder in ("bluetooth/hci0", "rfkill/rfkill0"):
        (tmp_path / folder).mkdir(parents=True)
    for name, text in (("type", "bluetooth"), ("soft", "0"), ("hard", "0")):
        (tmp_path / "rfkill/rfkill0" / name).write_text(f"{text}\n")
    (tmp_path / "bus").write_text("")
    monkeypatch.setattr(ble, "_BLUETOOTH_FOLDER", tmp_path / "bluetooth")
    monkeypatch.setattr(ble, "_RFKILL_FOLDER", tmp_path / "rfkill")
    monkeypatch.setattr(ble, "_SYSTEM_BUS", tmp_path / "bus")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DBUS_SYSTEM_BUS_ADDRESS", raising=False)
    return tmp_path


def fail(error: HubError):
    def scan(seconds: float) -> None:
        raise error

    return scan


def test_bluetooth_checks_go_from_system_to_hub(
    linux: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("brickhub.hub.transports.ble.scan", lambda seconds: [])
    assert doctor.check_bluetooth() == (Outcome.OK, "can look for hubs: no hub in reach right now")
    monkeypatch.setattr(
        "brickhub.hub.transports.ble.scan",
        fail(BluetoothUnavailableError("access denied; join the group bluetooth")),
    )
    outcome, detail = doctor.check_bluetooth()
    assert outcome is Outcome.WARNING and "access denied" in detail and "virtual hub" in detail
    (linux / "bus").unlink()
    assert "start dbus" in doctor.check_bluetooth()[1]
    (linux / "rfkill/rfkill0/soft").write_text("1\n")
    assert "rfkill unblock bluetooth" in doctor.check_bluetooth()[1]
    (linux / "bluetooth/hci0").rmdir()
    assert "no Bluetooth adapter" in doctor.check_bluetooth()[1]


def test_missing_or_old_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "importlib.metadata.requires",
        lambda name: ["greenlet>=99", "nowhere-to-be-found", "extra-thing; extra == 'x'"],
    )
    outcome, detail = doctor.check_packages()
    assert outcome is Outcome.ERROR
    assert "is not >=99; nowhere-to-be-found is missing; run `pip install" in detail
    assert detail.startswith("greenlet ") and "extra-thing" not in detail


def test_longest_timeout_is_allowed(capfd, fails, monkeypatch) -> None:
    monkeypatch.setattr(doctor.Doctor, "checks", {"python": doctor.check_python})
    longest_s = doctor._MAX_TIMEOUT_S
    assert main(("doctor", "--timeout-s", f"{longest_s}", "--json")) == 0
    capfd.readouterr()
    fails("doctor", "--timeout-s", f"{2 * longest_s}", says="give a positive number of up to")


def test_checks_are_told_in_columns_and_have_a_minute_each(capfd, monkeypatch) -> None:
    limits_s = []
    run_check = doctor.run_check

    def noted(name: str, check, timeout_s: float):
        limits_s.append(timeout_s)
        return run_check(name, check, timeout_s)

    monkeypatch.setattr(doctor, "run_check", noted)
    checks = {"one": lambda: (Outcome.OK, "good"), "two": lambda: (Outcome.WARNING, "old; renew")}
    monkeypatch.setattr(doctor.Doctor, "checks", checks)
    assert main(("doctor",)) == 0
    lines = capfd.readouterr().out.splitlines()
    assert lines == ["ok       one         good", "warning  two         old; renew"]
    assert limits_s == [60.0, 60.0]


def test_hubs_in_reach_are_named_after_a_second(linux: Path, monkeypatch) -> None:
    heard = []

    def scan(seconds: float) -> list[ble.FoundHub]:
        heard.append(seconds)
        return [ble.FoundHub("Rover", "C0:01", -60), ble.FoundHub("Crane", "C0:02", -70)]

    monkeypatch.setattr(ble, "scan", scan)
    assert doctor.check_bluetooth() == (Outcome.OK, "can look for hubs: Rover, Crane")
    assert heard == [1.0]


def test_serial_ports_are_named(monkeypatch) -> None:
    ports = [SimpleNamespace(device="COM7"), SimpleNamespace(device="COM3")]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)
    assert doctor.check_usb() == (Outcome.OK, "serial ports: COM3, COM7")
    ports.clear()
    assert doctor.check_usb() == (Outcome.OK, "serial ports: none")
