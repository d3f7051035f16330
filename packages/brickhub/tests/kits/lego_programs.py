"""Programs for LEGO's package: eight of our own, and those that LEGO publishes, which whoever runs
the tests has fetched."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

FOLDER = os.environ.get("LEGO_EDUCATION")
"""A clone of github.com/LEGO/LEGOEducation."""

_DEVICES = """
import time
import legoeducation as le
from legoeducation import *
singlemotor, doublemotor, colorsensor, controller = le.SingleMotor(), le.DoubleMotor(), le.ColorSensor(), le.Controller()
def notification_callback(notification):
    global data
    data = notification
for device in (singlemotor, doublemotor, colorsensor, controller):
    device.connect()
    device.set_notification_callback(notification_callback)
time.sleep(0.2)
"""  # noqa: E501
_NAMES = re.compile(r"(\w+( *#.*)?\n?)+")
"""A list of names, as of the fields of a report: no program."""

OWN = {
    "square": """
        m = le.DoubleMotor()
        m.connect(device_notification_delay=15)
        for _ in range(4):
            m.movement_move_for_degrees(180, speed=40)
            m.movement_turn_for_degrees(90, direction=le.MOVEMENT_TURN_DIRECTION_RIGHT)
        time.sleep(0.2)
        assert abs(m.imu_device.yaw) < 20, m.imu_device.yaw
    """,
    "batch": """
        m = le.DoubleMotor()
        m.connect()
        with m.batch():
            m.motor_run_for_degrees(90, motor=le.MOTOR_LEFT, speed=30)
            m.motor_run_for_degrees(360, motor=le.MOTOR_RIGHT, speed=80)
        time.sleep(0.3)
        assert [round(each.position / 90) for each in m.motor] == [1, 4]
    """,
    "without waiting": """
        m = le.SingleMotor()
        m.connect(device_notification_delay=20)
        m.motor_run_for_time(1500, speed=50, blocking=False)
        waits = 0
        while not m.done():
            time.sleep(0.1)
            waits += 1
        assert 14 <= waits <= 17, waits
    """,
    "callback": """
        seen = []
        def note(data):
            seen.extend(item.position for item in le.device_notification_parser(data) if isinstance(item, le.MotorNotification))
        m = le.SingleMotor()
        m.connect(device_notification_delay=50)
        began_s = time.monotonic()
        m.set_notification_callback(note)
        m.motor_run(speed=60)
        time.sleep(1)
        m.motor_stop()
        most = (time.monotonic() - began_s) / 0.05 + 1  # commands wait for the link, too
        assert 19 <= len(seen) <= most < 36 and seen == sorted(seen) and seen[-1] > 300, seen
    """,  # noqa: E501
    "positions": """
        m = le.SingleMotor()
        m.connect(device_notification_delay=15)
        m.motor_reset_relative_position(position=90)
        m.motor_run_to_relative_position(0, speed=70)
        m.motor_run_to_absolute_position(180, direction=le.MOTOR_MOVE_DIRECTION_CLOCKWISE)
        time.sleep(0.3)
        assert abs(m.motor.absolutePosition - 180) < 5, m.motor.absolutePosition
        m.motor_set_end_state(le.MOTOR_END_STATE_HOLD)
        m.motor_run_for_degrees(45)
        time.sleep(0.3)
        assert m.motor.motorState == le.MOTOR_STATE_HOLDING
    """,
    "two devices": """
        m, c = le.DoubleMotor(), le.ColorSensor()
        m.connect(device_notification_delay=15)
        c.connect(device_notification_delay=25)
        counts = {"motor": 0, "color": 0}
        m.set_notification_callback(lambda _: counts.update(motor=counts["motor"] + 1))
        c.set_notification_callback(lambda _: counts.update(color=counts["color"] + 1))
        while c.sensor.color != le.LEGO_COLOR_RED:
            m.movement_move_tank(20, 20)
            time.sleep(0.05)
        m.movement_stop()
        assert 2.4 < time.monotonic() - started < 3.2, time.monotonic() - started
        assert 1.5 < counts["motor"] / counts["color"] < 1.9, counts
    """,
    "waits for a color without a pause": """
        c = le.ColorSensor()
        c.connect()
        while c.sensor.color != le.LEGO_COLOR_RED:
            pass
        assert c.sensor.rawRed > 128 > c.sensor.rawGreen
    """,
    "wrong use": """
        m = le.DoubleMotor()
        assert m.movement_move() is None and not m.connected
        m.connect(card_color=le.LEGO_COLOR_GREEN, card_serial="0049")
        assert m.version_rpc[:2] == (2, 3) and len(m.device_uuid().uuid) == 8
        for call in (lambda: m.motor_run(speed=101), lambda: m.device_notification_request(5), lambda: m.motor_run(motor=3)):
            try:
                call()
            except ValueError:
                continue
            raise AssertionError("accepted")
        m.disconnect()
        assert not m.connected
        m.connect()
        assert m.connected
    """,  # noqa: E501
}
"""Programs after what LEGO's documentation describes. The color sensor sees white, and red after
2.5 s."""


def own(name: str) -> str:
    """One of our programs."""
    return (
        "import time\nimport legoeducation as le\nstarted = time.monotonic()\n"
        f"{textwrap.dedent(OWN[name])}"
    )


def published(folder: Path) -> Iterator[tuple[str, str]]:
    """Names and sources of LEGO's examples, and of the blocks of its pages; a block that is part of
    a program gets devices."""
    for path in sorted(folder.glob("examples/*.py")):
        yield path.name, path.read_text(encoding="utf-8")
    for path in sorted(folder.glob("*.md")):
        for number, block in enumerate(
            re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL)
        ):
            block = textwrap.dedent(block)
            if "import legoeducation" in block and ".connect(" in block:
                yield f"{path.stem}-{number}", block
            elif not _NAMES.fullmatch(block) and not block.startswith("help("):
                yield f"{path.stem}-{number}", _DEVICES + block
