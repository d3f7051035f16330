"""The hub object and its parts."""

from __future__ import annotations

import pytest
from hub_programs import Console, output

from brickhub.errors import TwinError
from brickhub.robot import BENCH, HubKind, Robot
from brickhub.virtual.bench_body import BenchBody
from brickhub.virtual.interpreter import execute
from brickhub.virtual.machine import Machine
from brickhub.virtual.micropython.exceptions import SwitchedOff
from brickhub.virtual.panel import Panel, parse_press
from brickhub.virtual.pybricks import modules

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
def test_only_own_hub_class(kind: HubKind) -> None:
    robot = Robot("it", kind)
    own = {kind.model.class_name, "ThisHub", kind.model.alias}
    for name in (
        "PrimeHub",
        "InventorHub",
        "EssentialHub",
        "TechnicHub",
        "CityHub",
        "MoveHub",
        "ThisHub",
        "EV3Brick",
    ):
        source = (
            f"from pybricks.hubs import {name}\nhub = {name}()\nprint(hub.battery.voltage() > 6000)"
        )
        if name in own:
            assert output(source, robot=robot) == "True"
        else:
            with pytest.raises(ImportError, match=f"can't import name {name}"):
                output(source, robot=robot)


@pytest.mark.parametrize(
    ("kind", "missing"),
    [
        (HubKind.CITY, "imu"),
        (HubKind.TECHNIC, "display"),
        (HubKind.ESSENTIAL, "speaker"),
        (HubKind.TECHNIC, "charger"),
    ],
)
def test_hub_has_own_parts_only(kind: HubKind, missing: str) -> None:
    with pytest.raises(AttributeError, match=missing):
        output(f"from pybricks.hubs import ThisHub\nThisHub().{missing}", robot=Robot("it", kind))


def test_ports_follow_hub() -> None:
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
"""  # noqa: E501
    assert hub(source) == (
        "(-0.0, 0.0) Side.TOP 0.0 True True\n9809.137 0.0 (3, 1) 0.0\n"
        "Matrix([\n    [   0.000],\n    [   0.000],\n    [ 999.999],\n]) 1.0\n90.0 2.0 None 359.5"
    )


def test_sideways_hub_reports_in_robot_frame() -> None:
    source = """
hub = PrimeHub(top_side=Axis.X, front_side=-Axis.Z)
print(hub.imu.up(), round(hub.imu.acceleration(Axis.X)), hub.imu.acceleration(Axis.Z) == 0, round(hub.imu.tilt()[0]))
"""  # noqa: E501
    assert hub(source) == "Side.TOP 9809 True -90"


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("PrimeHub(Axis.Z, Axis.Z)", "ValueError Invalid argument"),
        ("PrimeHub(5)", "TypeError Axis must be Matrix."),
        ("hub.imu.acceleration(Matrix([[1, 2]]))", "ValueError Axis must be 1x3 or 3x1 matrix."),
        ("hub.imu.reset_heading()", "TypeError 'angle' argument required"),
        (
            "hub.imu.settings(angular_velocity_bias=(1, 2))",
            "ValueError Angular velocity bias must be a 3-element tuple.",
        ),
        ("hub.light.on('red')", "TypeError can't convert str to Color"),
        ("hub.display.char('ab')", "ValueError Invalid argument"),
        ("hub.speaker.play_notes(['X4/4'])", "ValueError Missing note name A-G or R"),
        ("hub.system.storage(500, read=20)", "ValueError Invalid argument"),
        ("hub.speaker.sing()", "AttributeError 'Speaker' object has no attribute 'sing'"),
    ],
)
def test_refusals(call: str, error: str) -> None:
    kind, _, message = error.partition(" ")
    assert hub(f"try:\n    {call}\nexcept {kind} as e:\n    print(e)") == message


def test_radio_sends_and_receives_nothing() -> None:
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
"""  # noqa: E501
    one = "None None None -128\n<class 'ValueError'>\n<class 'ValueError'>\n<class 'TypeError'>\n"
    moved = "Hub messaging has been moved. You should use:\n\n"
    moved += (
        "from pybricks.messaging import BLERadio\n"
        "radio = BLERadio(broadcast_channel, observe_channels)\n\n"
    )
    assert hub(source) == moved + one + one + "no broadcast channel selected"


def test_display_sounds_lights_take_time() -> None:
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
"""  # noqa: E501
    assert hub(source) == "set() False True 0\nb'\\x00abc\\x00' Pybricks Hub"


_SHUTDOWN_IN_HANDLERS = """
class Handler:
    def __enter__(self):
        pass
    def __exit__(self, *error):
        1 / 0
try:
    with Handler():
        hub.system.shutdown()
except BaseException:
    1 / 0
finally:
    1 / 0
"""


def test_shutdown_ends_the_program() -> None:
    """``mp_sched_vm_abort`` passes all exception handlers."""
    with pytest.raises(SwitchedOff):
        hub(_SHUTDOWN_IN_HANDLERS)


def test_constants_print_as_on_a_hub() -> None:
    source = """
from pybricks.parameters import Port, Stop, Direction
print(Port.A, [Stop.HOLD, Direction.CLOCKWISE], Button.LEFT, Side.TOP, Color.RED, Color(1, 2, 3))
print(Color.RED == Color(360, 100, 100))
print(str(Port.B), f'{Stop.COAST}', '%s' % Color.NONE, Port.A == Port.A, Port.A != Port.B, {Port.A: 1}[Port.A])
h, s, v = Color.CYAN
print(h, s, v, Color.CYAN.h, Color.CYAN[2], Color.RED * 0.5, Color.RED >> 60)
"""  # noqa: E501
    assert hub(source) == (
        "Port.A [Stop.HOLD, Direction.CLOCKWISE] Button.LEFT Side.TOP Color.RED Color(h=1, s=2, "
        "v=3)\nTrue\n"
        "Port.B Stop.COAST Color.NONE True True 1\n180 100 100 180 100 Color(h=0, s=100, v=50) "
        "Color(h=60, s=100, v=100)"
    )


def test_absent_devices() -> None:
    source = """
from pybricks.iodevices import XboxController
from pybricks.pupdevices import Remote
for make in (XboxController, Remote):
    try:
        make()
    except OSError as e:
        print(e.errno)
"""
    assert hub(source) == "110\n110"


def test_device_search_takes_time() -> None:
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
print(code(lambda: Remote(timeout=-5)), code(lambda: XboxController(timeout=100)))
far = LWP3Device(32, connect=False)
for call in (lambda: Remote('a' * 15), lambda: Remote(3), lambda: LWP3Device(1.5), lambda: remote.name(''),
             lambda: remote.name(None), lambda: far.write(b'ab'), lambda: far.write(b'abc'),
             lambda: far.write(bytes([3, 0, 1])), lambda: box.rumble((1, 2))):
    try:
        call()
    except (ValueError, TypeError, OSError) as e:
        print(e.args[0])
"""  # noqa: E501
    assert hub(source).split("\n") == [
        "(110, 501) (110, 101)",
        "(110, 10001) None",
        "(19, 0) (19, 0) (19, 0) (19, 0) (19, 0)",
        *["(110, 10001)"] * 3,
        "(19, 0)",
        "meanwhile 20",
        "gave up 110 51",
        "raced",
        "(110, 1) (110, 2202)",
        "Name too long",
        "can't convert 'int' object to str implicitly",
        "can't convert float to int",
        "bad name length",
        "can't convert 'NoneType' object to str implicitly",
        "bad length",
        "length in header wrong",
        "19",
        "expected 1 number or tuple of 4 values",
    ]


def test_color_dictionary_is_per_program() -> None:
    source = """
Color.GREEN = Color(h=125)
Color['PINK'] = Color(330, 50)
print(Color.GREEN, Color['PINK'], Color['BLUE'] is Color.BLUE, 'PINK' in [name for name in Color])
hub.light.on(Color['PINK'])
del Color['PINK']
for call in (lambda: Color['NO'], lambda: Color.PURPLE, lambda: Color.PINK, lambda: setattr(Color, 'X', 5),
             lambda: isinstance(Color.RED, Color), lambda: Color.RED[3], lambda: Color.RED * 'a'):
    try:
        print(call())
    except Exception as e:
        print(repr(e))
"""  # noqa: E501
    assert hub(source).splitlines() == [
        "Color.GREEN Color.PINK True True",
        "KeyError('NO',)",
        "KeyError('PURPLE',)",
        "KeyError('PINK',)",
        'TypeError("can\'t convert int to Color",)',
        "TypeError('issubclass() arg 2 must be a class or a tuple of classes',)",
        "IndexError()",
        'TypeError("can\'t convert str to float",)',
    ]
    assert hub("print(Color.GREEN)") == "Color.GREEN"


def test_color_order_equals_hub() -> None:
    order = "BLACK GRAY WHITE NONE GREEN BLUE BROWN ORANGE YELLOW RED CYAN MAGENTA VIOLET"
    assert (
        hub("print(*Color)\nprint(str(Color)[:43])")
        == order + "\n{'BLACK': Color.BLACK, 'GRAY': Color.GRAY, "
    )


def test_named_colors_print_names() -> None:
    source = (
        "print(Color.GREEN, Color(120, 100, 100), Color.GREEN * 1, Color.RED >> 120, 0.5 * "
        "Color.RED, Color.RED // 3)\n"
    )
    source += (
        "print(Color.GREEN == Color(120), hash(Color.RED) == hash(Color(0)), "
        "hash(Color.RED) == hash(Color.RED))\n"
    )
    source += "print({Color.RED: 1}[Color(0)], -1 * Color.RED)"
    green = "Color(h=120, s=100, v=100)"
    assert hub(source) == (
        f"Color.GREEN {green} {green} {green} Color(h=0, s=100, v=50) Color(h=0, s=100, v=33)\n"
        "True False True\n"
        "1 Color(h=0, s=100, v=-100)"
    )


def test_version_and_geometry() -> None:
    source = (
        "import pybricks\nprint(pybricks.version)\n"
        "from pybricks.geometry import Axis, Matrix, vector, cross\n"
    )
    source += "from pybricks import tools\nprint(vector(1, 2).shape)"
    with pytest.raises(ImportError, match="can't import name tools"):
        hub(source)
    printed = hub(source.replace("from pybricks import tools\n", ""))
    assert printed == "('primehub', '4.1.0', 'v4.1.0 on 2026-10-12')\n(2, 1)"


def test_memory_is_reported_as_on_a_hub() -> None:
    assert (
        hub("import micropython\nmicropython.mem_info()\nmicropython.qstr_info(True)")
        .splitlines()[1]
        .startswith("GC: total: ")
    )


def pressing(source: str, *presses: str, robot: Robot = BENCH) -> str:
    machine = Machine(BenchBody(robot), Panel(robot.hub, map(parse_press, presses)))
    console = Console(machine, {})
    try:
        execute(HEAD_OF_HUB + source, "main.py", modules(machine, console), console)
    except SystemExit:
        console.write(f"stopped at {machine.time_ms}".encode())
    finally:
        machine.stop_motors()
    return console.written.decode().replace("\r\n", "\n").removesuffix("\n")


HEAD_OF_HUB = (
    "from pybricks.hubs import *\nfrom pybricks.parameters import *\n"
    "from pybricks.tools import *\nhub = ThisHub()\n"
)
POLL = "while not hub.buttons.pressed():\n    wait(10)\nprint(hub.buttons.pressed())\n"


def test_buttons_follow_script() -> None:
    source = (
        "watch = StopWatch()\n"
        + POLL
        + "print(watch.time())\nwait(150)\nprint(Button.LEFT in hub.buttons.pressed())\n"
    )
    source += "wait(100)\nprint(hub.buttons.pressed())"
    assert pressing(source, "left@2.5s") == "{Button.LEFT}\n2500\nTrue\nset()"
    assert pressing(POLL, "left@1", "bluetooth@0.995s+1s") == "{Button.LEFT, Button.BLUETOOTH}"


def test_center_button_stops_program_by_default() -> None:
    assert pressing("print('on')\nwait(5000)", "center@1.234s") == "on\nstopped at 1249"
    assert pressing("while True:\n    pass", "center@0.99s") == "stopped at 999"
    assert (
        pressing("try:\n    wait(5000)\nexcept SystemExit:\n    print('caught')", "center@1s")
        == "caught"
    )
    assert pressing("hub.system.set_stop_button(None)\n" + POLL, "center@1s") == "{Button.CENTER}"
    two = "hub.system.set_stop_button((Button.LEFT, Button.RIGHT))\nwait(9000)"
    assert pressing(two, "left@1s+3s", "center@2s", "right@3s") == "stopped at 3049"
    assert (
        pressing("hub.system.set_stop_button(Button.BLUETOOTH)\n" + POLL, "center@1s")
        == "{Button.CENTER}"
    )


def test_hub_menu_selects_entry() -> None:
    menu = "print(hub_menu('A', 'B', 7))\nwait(5000)"
    assert pressing(menu, "right@1s", "right@2s", "center@3s", "center@4s") == "7\nstopped at 4049"
    assert pressing("print(hub_menu('A', 'B', 7))", "left@1s", "left@2s", "center@3s") == "B"
    assert pressing("print(hub_menu(1, 2))", "center@1s+2s") == "1"
    assert (
        pressing("try:\n    hub_menu('AB', 'C')\nexcept ValueError as e:\n    print(e)")
        == "Invalid argument"
    )


def test_other_hubs_have_one_button() -> None:
    robot = Robot("train", HubKind.CITY)
    source = "hub.system.set_stop_button(None)\n" + POLL + "print(hub.button.pressed())"
    assert pressing(source, "center@1s", robot=robot) == "{Button.CENTER}\n{Button.CENTER}"
    with pytest.raises(
        TwinError,
        match="no button 'left'; press one of center, or of a wireless device, such as remote",
    ):
        pressing("", "left@1s", robot=robot)
    with pytest.raises(
        TwinError, match=r"the xbox has no button 'xbox.z'; press one of xbox.a, xbox.b"
    ):
        pressing("", "xbox.z@1s", robot=robot)


def test_remote_keeps_its_new_name() -> None:
    source = """
from pybricks.pupdevices import Remote
remote = Remote(name="crane")
print(remote.name())
remote.name("tram")
remote.disconnect()
for name in (None, "tram", "crane"):
    try:
        remote = Remote(name, timeout=100)
        print(remote.name())
        remote.disconnect()
    except OSError as e:
        print(e.errno)
"""
    assert pressing(source, "remote.center@9s") == "crane\ntram\ntram\n110"


def test_remote_that_is_off_is_not_found_and_one_that_was_lost_is_found_again() -> None:
    source = """
from pybricks.pupdevices import Remote
from pybricks.tools import StopWatch
watch = StopWatch()
try:
    Remote(timeout=1000)
except OSError as e:
    print(e.errno, watch.time() // 100)
remote = Remote()
print(watch.time() // 100)
print(remote.buttons.pressed())
while True:
    try:
        remote.buttons.pressed()
    except OSError as e:
        print(e.errno, watch.time() // 100)
        break
    wait(10)
wait(2000)
try:
    print(remote.name())
except OSError as e:
    print("still", e.errno)
remote.connect()
print(remote.name(), remote.buttons.pressed())
"""
    # Off at first, switched on after 2 s, off again from 4 s to 5 s.
    presses = ("remote.off@0s+2s", "remote.off@4s+1s", "remote.center@6s+9s")
    said = pressing(source, *presses).splitlines()
    assert said == ["110 10", "25", "set()", "19 40", "still 19", "Handset {Button.CENTER}"]


def test_pressed_remote_is_near() -> None:
    source = """
from pybricks.pupdevices import Remote
from pybricks.tools import run_task
remote = Remote()
remote.light.on(Color.RED)
async def lights():
    await remote.light.on(Color.BLUE)
    await remote.light.off()
run_task(lights())
wait(1000)
print(remote.name(), remote.buttons.pressed(), hub.buttons.pressed())
remote.disconnect()
try:
    remote.buttons.pressed()
except OSError as e:
    print(e.errno)
"""
    printed = pressing(source, "remote.left_plus@1s+1s", "remote.right@1s+1s")
    assert printed == "Handset {Button.LEFT_PLUS, Button.RIGHT} set()\n19"


@pytest.mark.parametrize(
    "text", ["left", "left@", "left@x", "@3s", "left@1.2.3", "left@-1", "left@1+0"]
)
def test_press_needs_button_and_time(text: str) -> None:
    with pytest.raises(TwinError, match="left@2.5s"):
        parse_press(text)


def test_panel_shows_light_display_sound() -> None:
    machine = Machine(BenchBody(BENCH))
    panel, seen = machine.panel, []

    class Eye(Console):
        def write(self, data: bytes) -> None:
            if data.strip():
                seen.append((panel.light, panel.text, sum(panel.display), panel.sound_hz))

    source = """
def look():
    print(1)
hub.light.on(Color.RED)
hub.display.char("A")
look()
hub.light.off()
hub.display.on(50)
hub.speaker.beep(440, -1)
look()
hub.display.number(-123)
hub.display.pixel(1, 1)
look()
hub.light.blink(Color.BLUE, [100, 200])
hub.display.icon([[100] * 5] + [[0] * 5] * 4)
look()
"""
    execute(HEAD_OF_HUB + source, "main.py", modules(machine, eye := Eye(machine, {})), eye)
    assert seen == [
        ((0, 100, 100), "A", 0, 0),
        (None, "", 1250, 440),
        (None, "<", 100, 440),
        ((240, 100, 100), "", 500, 440),
    ]
    machine.stop_motors()
    assert (panel.light, panel.text, sum(panel.display), panel.sound_hz) == (None, "", 0, 0)


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("hub.display.icon([[1, 2], [3, 4]])", "ValueError Invalid argument"),
        ("hub.display.animate([Icon.UP], 100)", "ValueError Invalid argument"),
        ("hub.light.blink(Color.RED, [0])", "ValueError Invalid argument"),
        ("hub.speaker.play_notes(['C/4'])", "ValueError Missing octave number 2-8"),
        ("hub.speaker.play_notes(['Cb4/4'])", "ValueError Cb is not allowed"),
        ("hub.speaker.play_notes(['C44'])", "ValueError Missing /"),
        ("hub.speaker.play_notes(['C4/'])", "ValueError Missing fractional value 1, 2, 4, 8, etc."),
        ("hub.system.storage(0)", "TypeError Must set either read (int) or write (bytes)."),
        ("hub.system.storage()", "TypeError 'offset' argument required"),
        (
            "hub.system.set_stop_button()",
            "TypeError function takes 1 positional arguments but 0 were given",
        ),
        ("hub.system.set_stop_button(5)", "TypeError can't convert int to Button"),
        ("hub.system.name(5)", "TypeError function takes 0 positional arguments but 1 were given"),
        ("hub.battery.voltage(unit=1)", "TypeError function doesn't take keyword arguments"),
        ("hub.imu.settings(heading_correction=300)", "ValueError Invalid argument"),
        ("hub.imu.rotation(Axis.X * 0)", "ValueError Invalid argument"),
    ],
)
def test_refusals_of_the_parts(call: str, error: str) -> None:
    kind, _, message = error.partition(" ")
    assert hub(f"try:\n    {call}\nexcept {kind} as e:\n    print(e)") == message


@pytest.mark.parametrize(
    ("up", "shown"),
    [
        ("TOP", "#..../...../...../...../...+. ####./...../...../...../....."),
        ("FRONT", "#..../...../...../...../...+. ####./...../...../...../....."),
        ("RIGHT", "....#/...../...../+..../..... ....#/....#/....#/....#/....."),
        ("BOTTOM", ".+.../...../...../...../....# ...../...../...../...../.####"),
        ("LEFT", "...../....+/...../...../#.... ...../#..../#..../#..../#...."),
    ],
)
def test_display_is_turned(up: str, shown: str) -> None:
    """As the firmware's ``_pbio_light_matrix_set_pixel``; what is on the display already stays."""
    machine = Machine(BenchBody(Robot("hub", HubKind.PRIME)))
    pictures: list[str] = []

    class Eye(Console):
        def write(self, data: bytes) -> None:
            pictures.extend(
                [machine.panel.describe().split()[3].rstrip(";")] if data.strip() else []
            )

    source = f"""
hub.display.pixel(2, 2)
hub.display.orientation(Side.{up})
print(1)
hub.display.pixel(2, 2, 0)
hub.display.pixel(0, 0)
hub.display.pixel(4, 3, 50)
print(2)
hub.display.icon([[100, 100, 100, 100, 0]] + [[0] * 5] * 4)
print(3)
"""
    execute(HEAD_OF_HUB + source, "main.py", modules(machine, eye := Eye(machine, {})), eye)
    assert pictures == ["...../...../..#../...../.....", *shown.split()]
    machine.stop_motors()
    assert machine.panel.quarter_turns == 0


def test_button_itself_is_no_stop_button() -> None:
    machine = Machine(BenchBody(Robot("hub", HubKind.PRIME)))
    source = HEAD_OF_HUB + "hub.system.set_stop_button(Button)"
    execute(source, "main.py", modules(machine, console := Console(machine, {})), console)
    assert machine.panel.stop_buttons == frozenset()


def test_hub_is_stationary_while_coasting() -> None:
    source = (
        "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "motor = Motor(Port.A)\n"
    )
    source += (
        "print(hub.imu.stationary())\nmotor.hold()\nwait(2000)\n"
        "print(hub.imu.stationary())\nprint(hub.battery.type())"
    )
    assert hub(source) == "True\nFalse\nLi-ion"


def test_hub_is_stationary_after_a_second_of_rest() -> None:
    source = (
        "from pybricks.pupdevices import Motor\nfrom pybricks.parameters import Port\n"
        "motor = Motor(Port.A)\n"
    )
    source += (
        "motor.dc(50)\nwait(100)\nmotor.stop()\nfor pause in (0, 990, 20):\n"
        "    wait(pause)\n    print(hub.imu.stationary())"
    )
    assert hub(source) == "False\nFalse\nTrue"
