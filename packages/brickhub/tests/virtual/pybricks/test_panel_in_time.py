"""Buttons, light and display as time passes. The times are those of the firmware (v4.1.0b2, built
for a computer), measured."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.virtual.panel import Panel, parse_press
from brickhub.virtual.run import Operation, run_file

HEAD = """from pybricks.hubs import PrimeHub
from pybricks.parameters import Button, Color, Icon
from pybricks.tools import StopWatch, hub_menu, run_task, wait
hub = PrimeHub()
s = StopWatch()
"""


class Watcher:
    """Notes down what can be seen on a panel, and when (ms)."""

    def __init__(self) -> None:
        self.lights: list[tuple[int, int | None]] = []
        self.displays: list[tuple[int, int]] = []
        self.sounds: list[tuple[int, int]] = []

    def __call__(self, panel: Panel) -> None:
        panel.on_change = self.look

    def look(self, panel: Panel) -> None:
        hue = None if panel.light is None else panel.light[0]
        if not self.lights or self.lights[-1][1] != hue:
            self.lights.append((panel.clock_ms(), hue))
        if not self.displays or self.displays[-1][1] != sum(panel.display):
            self.displays.append((panel.clock_ms(), sum(panel.display)))
        if not self.sounds or self.sounds[-1][1] != panel.sound_hz:
            self.sounds.append((panel.clock_ms(), panel.sound_hz))


def run(tmp_path: Path, source: str, *presses: str) -> tuple[str, Watcher]:
    program, out, err, watcher = tmp_path / "main.py", io.BytesIO(), io.StringIO(), Watcher()
    program.write_text(HEAD + source, encoding="utf-8")
    run_file(
        program,
        stdout=out,
        stderr=err,
        operation=Operation(list(map(parse_press, presses)), watch=watcher),
    )
    return (out.getvalue().decode() + err.getvalue()).strip(), watcher


WAIT_TWICE = """
while s.time() < 1000:
    try:
        wait(1000 - s.time())
    except SystemExit:
        print(s.time())
"""


@pytest.mark.parametrize(
    ("source", "presses", "printed"),
    [
        (WAIT_TWICE, ["center@0.222s+0.1s"], "249"),
        (WAIT_TWICE, ["center@0.222s+0.4s"], "249"),
        (WAIT_TWICE, ["center@0.222s+0.1s", "center@0.9s+0.05s"], "249\n949"),
        (WAIT_TWICE, ["center@0.252s+0.03s"], ""),
        ("hub.system.set_stop_button(None)\nwait(300)\n"
         "hub.system.set_stop_button(Button.CENTER)" + WAIT_TWICE,
         ["center@0.2s+0.4s"], "349"),
        ("print(hub_menu(1, 2, 3), s.time())", ["left@0.3s+0.1s", "center@1s+0.2s"], "3 1200"),
        ("print(hub_menu('A', 'B'), s.time())", ["bluetooth@0.3s", "right@0.6s", "left@0.65s+0.03s",
         "center@1s"], "B 1200"),
    ],
)  # fmt: skip
def test_a_hub_looks_at_its_stop_button_every_50_ms(
    source: str, presses: list[str], printed: str, tmp_path: Path
) -> None:
    assert run(tmp_path, source, *presses)[0] == printed


@pytest.mark.parametrize(
    ("setting", "presses", "printed"),
    [
        ("Button.CENTER", ["center@0.222s+2.1s"], "249\nThe hub was switched off."),
        ("None", ["center@0.222s+2.1s"], "The hub was switched off."),
        ("None", ["center@0.222s+2s"], "3000"),
        ("None", ["center@0.222s+0.1s", "center@2.3s+0.1s"], "3000"),
        ("None", ["left@0.2s+3s"], "3000"),
    ],
)
def test_center_button_switches_off_after_two_seconds(
    setting: str, presses: list[str], printed: str, tmp_path: Path
) -> None:
    """``pbsys_program_stop_poll``; nothing in a program can prevent it."""
    source = f"""
hub.system.set_stop_button({setting})
while s.time() < 3000:
    try:
        wait(3000 - s.time())
    except:
        print(s.time())
"""
    source += "print(s.time())\n"
    assert run(tmp_path, source, *presses)[0] == printed


def test_a_light_blinks_and_changes_its_color_by_itself(tmp_path: Path) -> None:
    _, seen = run(
        tmp_path,
        "hub.light.blink(Color.BLUE, [30, 40, 50])\nwait(300)\nhub.light.on(Color.GREEN)\n"
        "wait(100)",
    )
    assert seen.lights[:7] == [
        (0, 240),
        (31, None),
        (71, 240),
        (151, None),
        (191, 240),
        (271, None),
        (300, 120),
    ]
    _, seen = run(
        tmp_path,
        "hub.light.animate([Color.RED, Color.GREEN, Color.NONE], 75)\nwait(300)\n"
        "hub.light.off()\nwait(200)",
    )
    assert seen.lights == [(0, 0), (76, 120), (151, None), (226, 0), (300, None)]


def test_pictures_follow_each_other_until_something_else_is_shown(tmp_path: Path) -> None:
    one, two = ([[bright] * 5] * 5 for bright in (10, 20))
    source = f"hub.display.animate([{one}, {two}], 100)\nwait(250)\n"
    _, seen = run(tmp_path, source + "hub.display.pixel(0, 0)\nwait(200)")
    assert seen.displays == [(0, 250), (101, 500), (201, 250), (250, 0), (250, 100), (450, 0)]
    _, seen = run(tmp_path, source + "hub.display.on(1)\nwait(200)")
    assert seen.displays == [(0, 250), (101, 500), (201, 250), (250, 25), (450, 0)]


def test_a_beep_begins_at_once_and_ends_for_whoever_waits(tmp_path: Path) -> None:
    source = """
async def main():
    await wait(20)
    beep = hub.speaker.beep(500, 100)
    await wait(50)
    await beep
    hub.speaker.beep(600, 10)
    await wait(100)
run_task(main())
"""
    _, seen = run(tmp_path, source)
    assert seen.sounds == [(20, 500), (120, 0), (120, 600), (220, 0)]
