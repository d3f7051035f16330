"""The hub object and its parts."""

from __future__ import annotations

import pytest
from hub_programs import output

from bricksrl.robots import HubKind, Robot

HEAD = """
from pybricks.hubs import PrimeHub
from pybricks.parameters import Axis, Button, Color, Icon, Side
from pybricks.tools import wait, StopWatch, Matrix, run_task
hub = PrimeHub()
watch = StopWatch()
"""


def hub(source: str) -> str:
    return output(HEAD + source)


@pytest.mark.parametrize("kind", list(HubKind))
def test_only_the_hub_that_is_there(kind: HubKind) -> None:
    robot = Robot("it", kind)
    own = {kind.model.class_name, "ThisHub"} | ({"InventorHub"} if kind is HubKind.PRIME else set())
    for name in ("PrimeHub", "InventorHub", "EssentialHub", "TechnicHub", "CityHub", "MoveHub", "ThisHub", "EV3Brick"):
        source = f"from pybricks.hubs import {name}\nhub = {name}()\nprint(hub.battery.voltage() > 6000)"
        if name in own:
            assert output(source, robot=robot) == "True"
        else:
            with pytest.raises(ImportError, match=f"can't import name {name}"):
                output(source, robot=robot)


@pytest.mark.parametrize(
    ("kind", "missing"),
    [(HubKind.CITY, "imu"), (HubKind.TECHNIC, "display"), (HubKind.ESSENTIAL, "speaker"), (HubKind.TECHNIC, "charger")],
)
def test_a_hub_has_only_its_own_parts(kind: HubKind, missing: str) -> None:
    with pytest.raises(AttributeError, match=missing):
        output(f"from pybricks.hubs import ThisHub\nThisHub().{missing}", robot=Robot("it", kind))


def test_ports_are_those_of_the_hub() -> None:
    with pytest.raises(AttributeError, match="'Port' has no attribute 'C'"):
        output("from pybricks.parameters import Port\nPort.C", robot=Robot("it", HubKind.CITY))


def test_imu_at_rest() -> None:
    source = """
imu = hub.imu
print(imu.tilt(), imu.up(), imu.heading(), imu.ready(), imu.stationary())
print(imu.acceleration(Axis.Z), imu.angular_velocity(Axis.Z), imu.angular_velocity().shape, imu.rotation(-Axis.Z))
print(imu.acceleration(), imu.orientation()[0, 0])
imu.reset_heading(90)
print(imu.heading(), imu.settings()[0], imu.settings(heading_correction=359.5), imu.settings()[-1])
"""
    assert hub(source) == (
        "(0.0, 0.0) Side.TOP 0.0 True True\n9810.0 0.0 (3, 1) 0.0\n"
        "Matrix([\n    [   0.000],\n    [   0.000],\n    [ 999.999],\n]) 1.0\n90.0 2.0 None 359.5"
    )


def test_a_hub_on_its_side_reports_in_the_frame_of_the_robot() -> None:
    source = """
hub = PrimeHub(top_side=Axis.X, front_side=-Axis.Z)
print(hub.imu.up(), round(hub.imu.acceleration(Axis.X)), hub.imu.acceleration(Axis.Z) == 0, round(hub.imu.tilt()[0]))
"""
    assert hub(source) == "Side.TOP 9810 True -90"


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("PrimeHub(Axis.Z, Axis.Z)", "ValueError Invalid argument"),
        ("PrimeHub(5)", "TypeError Axis must be Matrix."),
        ("hub.imu.acceleration(Matrix([[1, 2]]))", "ValueError Axis must be 1x3 or 3x1 matrix."),
        ("hub.imu.reset_heading()", "TypeError 'angle' argument required"),
        ("hub.imu.settings(angular_velocity_bias=(1, 2))", "ValueError Angular velocity bias must be a 3-element tuple."),
        ("hub.light.on('red')", "TypeError can't convert str to Color"),
        ("hub.display.char('ab')", "ValueError Invalid argument"),
        ("hub.display.orientation(Side.FRONT)", "ValueError Invalid argument"),
        ("hub.speaker.play_notes(['X4/4'])", "ValueError Missing note name A-G or R"),
        ("hub.system.storage(500, read=20)", "ValueError Invalid argument"),
        ("hub.speaker.sing()", "AttributeError 'Speaker' object has no attribute 'sing'"),
    ],
)
def test_refusals(call: str, error: str) -> None:
    kind, _, message = error.partition(" ")
    assert hub(f"try:\n    {call}\nexcept {kind} as e:\n    print(e)") == message


def test_the_radio_sends_and_hears_nobody() -> None:
    source = """
from pybricks.messaging import BLERadio
hub = PrimeHub(broadcast_channel=5, observe_channels=[7])
for radio in (hub.ble, BLERadio(5, [7])):
    print(radio.broadcast((1, 2.5, 'a', True)), radio.broadcast(None), radio.observe(7), radio.signal_strength(7))
    for call in (lambda: radio.observe(8), lambda: radio.broadcast(bytes(25)), lambda: radio.broadcast({})):
        try:
            call()
        except (ValueError, TypeError) as e:
            print(type(e))
try:
    BLERadio().broadcast(1)
except RuntimeError as e:
    print(e)
"""
    one = "None None None -128\n<class 'ValueError'>\n<class 'ValueError'>\n<class 'TypeError'>\n"
    assert hub(source) == one + one + "broadcast channel not configured"


def test_display_sounds_and_lights_take_their_time() -> None:
    source = """
hub.display.text('Hi!')
print(watch.time())
hub.display.text('Hi', on=100, off=0)
print(watch.time())
hub.speaker.beep()
hub.speaker.beep(440, 300)
print(watch.time())
hub.speaker.play_notes(['C4/4', 'R/8', 'G#3/4.', 'Ab5/16_'], tempo=120)
print(watch.time())
hub.light.on(Color.RED)
hub.light.blink(Color.RED, [100, 50])
hub.light.animate([Color.RED, Color.BLUE * 0.5], 100)
hub.light.off()
hub.display.icon(Icon.HAPPY)
hub.display.icon(Icon.HEART / 2)
hub.display.number(42)
hub.display.char('A')
hub.display.pixel(1, 2, 50)
hub.display.animate([Icon.UP, Icon.DOWN], 100)
hub.display.orientation(Side.LEFT)
hub.display.off()
hub.speaker.volume(50)
print(watch.time(), hub.speaker.volume())
"""
    assert hub(source) == "1650\n1850\n2250\n3875\n3875 50"


def test_sounds_can_be_awaited() -> None:
    source = """
async def main():
    await hub.speaker.beep(500, 120)
    print(watch.time())
    await hub.speaker.play_notes(['C4/4'])
    print(watch.time())
run_task(main())
"""
    assert hub(source) == "120\n620"


def test_buttons_battery_charger_and_storage() -> None:
    source = """
print(hub.buttons.pressed(), Button.LEFT in hub.buttons.pressed(), hub.battery.current() > 0, hub.charger.connected())
hub.system.storage(10, write=b'abc')
print(hub.system.storage(9, read=5), hub.system.info()['name'])
hub.system.set_stop_button(None)
"""
    assert hub(source) == "set() False True False\nb'\\x00abc\\x00' Pybricks Hub"


def test_shutdown_ends_the_program() -> None:
    with pytest.raises(SystemExit):
        hub("hub.system.shutdown()")


def test_constants_print_as_on_a_hub() -> None:
    source = """
from pybricks.parameters import Port, Stop, Direction
print(Port.A, [Stop.HOLD, Direction.CLOCKWISE], Button.LEFT, Side.TOP, Color.RED, Color(1, 2, 3))
print(Color.RED == Color(360, 100, 100))
print(str(Port.B), f'{Stop.COAST}', '%s' % Color.NONE, Port.A == Port.A, Port.A != Port.B, {Port.A: 1}[Port.A])
h, s, v = Color.CYAN
print(h, s, v, Color.CYAN.h, Color.CYAN[2], Color.RED * 0.5, Color.RED >> 60)
"""
    assert hub(source) == (
        "Port.A [Stop.HOLD, Direction.CLOCKWISE] Button.LEFT Side.TOP Color.RED Color(h=1, s=2, v=3)\nTrue\n"
        "Port.B Stop.COAST Color.NONE True True 1\n180 100 100 180 100 Color(h=0, s=100, v=50) Color.YELLOW"
    )


def test_what_is_plugged_in_says_what_it_is() -> None:
    source = """
from pybricks.iodevices import PUPDevice
from pybricks.parameters import Port
device = PUPDevice(Port.A)
print(device.info(), device.reset())
try:
    device.read(0)
except OSError as e:
    print(e.errno)
"""
    assert hub(source) == "{'id': 48} None\n95"


def test_devices_that_nobody_has() -> None:
    source = """
from pybricks.iodevices import UARTDevice, XboxController
from pybricks.pupdevices import Remote
from pybricks.parameters import Port
for make in (lambda: UARTDevice(Port.A), XboxController, Remote):
    try:
        make()
    except OSError as e:
        print(e.errno)
"""
    assert hub(source) == "19\n110\n110"


def test_looking_for_a_device_takes_its_time() -> None:
    source = """
from pybricks.iodevices import LWP3Device, XboxController
from pybricks.pupdevices import DuploTrain, MarioHub, Remote, TechnicMoveHub
from pybricks.tools import StopWatch, multitask, run_task, wait
watch = StopWatch()
def code(call):
    watch.reset()
    try:
        return call()
    except OSError as e:
        return e.errno, watch.time()
print(code(lambda: Remote(timeout=500)), code(lambda: LWP3Device(32, 'x', 100)))
remote, box = Remote(connect=False), XboxController(connect=False)
print(code(remote.connect), remote.disconnect())
print(code(remote.buttons.pressed), code(remote.light.off), code(remote.name), code(box.joystick_left), code(box.buttons.pressed))
for kind in (TechnicMoveHub, MarioHub, DuploTrain):
    print(code(kind))
train = DuploTrain(connect=False, timeout=50)
print(code(lambda: train.sound('horn')))
async def look():
    try:
        await train.connect()
    except OSError as e:
        print('gave up', e.errno, watch.time())
async def go_on():
    await wait(20)
    print('meanwhile', watch.time())
watch.reset()
run_task(multitask(look(), go_on()))
forever = Remote(timeout=None, connect=False)
async def look_for_ever():
    await forever.connect()
async def lose_patience():
    await wait(3000)
run_task(multitask(look_for_ever(), lose_patience(), race=True))
print('raced')
for call in (lambda: Remote('a' * 15), lambda: Remote(timeout=-5), lambda: LWP3Device(256), lambda: Remote(3)):
    try:
        call()
    except (ValueError, TypeError) as e:
        print(type(e))
"""
    refused = "<class 'ValueError'>"
    assert hub(source).split("\n") == [
        "(110, 501) (110, 101)",
        "(110, 10001) None",
        "(19, 0) (19, 0) (19, 0) (19, 0) (19, 0)",
        *["(110, 10001)"] * 3,
        "(19, 0)",
        "meanwhile 20",
        "gave up 110 51",
        "raced",
        *[refused] * 3,
        "<class 'TypeError'>",
    ]


def test_the_colors_are_a_dictionary_that_a_program_changes_for_itself() -> None:
    source = """
Color.GREEN = Color(h=125)
Color['PINK'] = Color(330, 50)
print(Color.GREEN, Color['PINK'], Color['BLUE'] is Color.BLUE, 'PINK' in [name for name in Color])
print(isinstance(Color.RED, Color), isinstance(Color(5) >> 5, Color), str(Color)[:35])
hub.light.on(Color['PINK'])
for call in (lambda: Color['NO'], lambda: setattr(Color, 'X', 5)):
    try:
        call()
    except (KeyError, TypeError) as e:
        print(repr(e))
"""
    assert hub(source) == (
        "Color(h=125, s=100, v=100) Color(h=330, s=50, v=100) True True\nTrue True {'NONE': Color.NONE, 'BLACK': Color\n"
        "KeyError('NO',)\nTypeError(\"can't convert int to Color\",)"
    )
    assert hub("print(Color.GREEN, hasattr(Color, 'PINK'))") == "Color.GREEN False"


def test_memory_is_reported_as_on_a_hub() -> None:
    assert (
        hub("import micropython\nmicropython.mem_info()\nmicropython.qstr_info(True)").splitlines()[1].startswith("GC: total: ")
    )
