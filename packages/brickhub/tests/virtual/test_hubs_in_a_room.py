"""Several hubs in one room: what they tell each other, in one simulated time.

Rules of the radio are those of ``pb_type_ble_radio.c`` of Pybricks 4; see `brickhub.virtual.air`.
"""

from __future__ import annotations

import io
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from radio_programs import HEAD, random_program

from brickhub.cli import main
from brickhub.errors import TwinError
from brickhub.virtual.air import INTERVAL_MS, LASTS_MS, NOTHING_HEARD_DBM, Air, Antenna
from brickhub.virtual.room import HubProgramFile, Room

SENDER = HEAD + "radio = BLERadio(broadcast_channel=7)\n"
LISTENER = HEAD + "radio = BLERadio(observe_channels=[7])\n"


def run(tmp_path: Path, *sources: str, limit_s: float | None = 60.0) -> tuple[list[int], str, str]:
    """Exit codes, output and errors of programs a, b, c ..."""
    out, err = io.BytesIO(), io.StringIO()
    programs = []
    for name, source in zip("abcdef", sources, strict=False):
        path = tmp_path / f"{name}.py"
        path.write_text(source)
        programs.append(HubProgramFile(path))
    codes = Room(programs, stdout=out, stderr=err, time_limit_s=limit_s).run()
    return codes, out.getvalue().decode(), err.getvalue()


@pytest.mark.parametrize(
    ("sent", "heard"),
    [
        ("True", "True"),
        ("False", "False"),
        ("-128", "-128"),
        ("70000", "70000"),
        ("0.1", "0.1"),
        ("'hé'", "'h\\xe9'"),
        ("b'\\x00\\xff'", "b'\\x00\\xff'"),
        ("bytearray(b'ab')", "b'ab'"),
        ("(1, 'two', 3.5, None is None)", "(1, 'two', 3.5, True)"),
        ("[1, 2]", "(1, 2)"),
        ("(5,)", "(5,)"),
        ("'x' * 24", "'xxxxxxxxxxxxxxxxxxxxxxxx'"),
        ("()", "()"),
    ],
)
def test_each_kind_of_data_arrives(tmp_path: Path, sent: str, heard: str) -> None:
    sender = f"{SENDER}radio.broadcast({sent})\nwait(1000)\n"
    listener = f"{LISTENER}wait(900)\nprint(repr(radio.observe(7)))\n"
    assert run(tmp_path, sender, listener) == ([0, 0], f"b: {heard}\n", "")


@pytest.mark.parametrize(
    ("sent", "says"),
    [
        ("'x' * 25", "ValueError: payload limited to 26 bytes"),
        ("(1,) * 14", "ValueError: payload limited to 26 bytes"),
        ("None, None", "TypeError"),
        ("{}", "TypeError: must be True, False, int, float, str or bytes"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, sent: str, says: str) -> None:
    codes, _, err = run(tmp_path, f"{SENDER}radio.broadcast({sent})\n", LISTENER)
    assert codes == [1, 0] and says in err and err.startswith("a: Traceback")


def test_two_tasks_cannot_change_the_message_at_once(tmp_path: Path) -> None:
    """As on a hub: one of them is refused, and the same message again is none."""
    source = f"""
from pybricks.tools import multitask, run_task, wait
{SENDER}
async def say(*messages):
    for message in messages:
        try:
            await radio.broadcast(message)
        except OSError as error:
            print(message, error.errno)
        await wait(1)

async def main():
    await multitask(say(1, 2, 3), say("b"))
    await multitask(say(3), say(3, None))
    await multitask(say(True), say(1))

run_task(main())
"""
    codes, out, _ = run(tmp_path, source)
    assert codes == [0] and out == "a: b 16\na: 1 16\n"


def test_channels_are_numbers_of_a_byte(tmp_path: Path) -> None:
    listener = (
        f"{HEAD}radio = BLERadio(observe_channels=[7])\nwait(500)\nprint(radio.observe(263))\n"
    )
    many = f"{HEAD}BLERadio(observe_channels=range(256))\n"
    sender = f"{SENDER}radio.broadcast(5)\nwait(900)\n"
    codes, out, err = run(tmp_path, sender, listener, many)
    assert codes == [0, 0, 1] and out == "b: 5\n"
    assert err.endswith("c: ValueError: Too many observe channels\n")


def test_a_message_lasts_a_second_after_it_was_heard_last(tmp_path: Path) -> None:
    sender = f"{SENDER}radio.broadcast(1)\nwait(1000)\nradio.broadcast(None)\nwait(5000)\n"
    listener = f"""{LISTENER}
watch = StopWatch()
while radio.observe(7) is None:
    wait(1)
first = watch.time()
while radio.observe(7) is not None:
    wait(1)
print(first, watch.time(), radio.signal_strength(7))
"""
    codes, out, _ = run(tmp_path, sender, listener)
    first_ms, last_ms, strength_dbm = map(int, out.removeprefix("b: ").split())
    assert codes == [0, 0] and first_ms < 4 * INTERVAL_MS
    assert 1000 + LASTS_MS - 3 * INTERVAL_MS < last_ms < 1000 + LASTS_MS + 10
    assert strength_dbm == NOTHING_HEARD_DBM


def test_the_last_of_several_messages_counts_and_nobody_hears_itself(tmp_path: Path) -> None:
    sender = f"""{HEAD}
radio = BLERadio(broadcast_channel=7, observe_channels=[7, 8])
for number in range(100):
    radio.broadcast(number)
    wait(10)
print(radio.observe(7), radio.observe(8))
wait(500)
"""
    listener = f"""{LISTENER}
seen = []
for _ in range(300):
    message = radio.observe(7)
    if message is not None and message not in seen:
        seen.append(message)
    wait(5)
print(seen)
"""
    _, out, _ = run(tmp_path, sender, listener)
    own, heard = out.splitlines()
    numbers = eval(heard.removeprefix("b: "))  # noqa: S307  our own text
    assert own == "a: None None"
    assert numbers == sorted(numbers) and numbers[-1] == 99, "in order, and the last one arrives"
    assert 7 <= len(numbers) <= 12, "a message each 100 to 110 ms, few of them lost"


def test_three_hubs_pass_a_number_round(tmp_path: Path) -> None:
    def relay(own: int, before: int) -> str:
        return f"""{HEAD}
radio = BLERadio(broadcast_channel={own}, observe_channels=[{before}])
while True:
    number = radio.observe({before})
    if number is not None:
        break
    wait(10)
radio.broadcast(number + 1)
print(number)
wait(3000)
"""

    first = f"{HEAD}radio = BLERadio(broadcast_channel=1)\nradio.broadcast(10)\nwait(3000)\n"
    codes, out, err = run(tmp_path, first, relay(2, 1), relay(3, 2))
    assert (codes, out, err) == ([0, 0, 0], "b: 10\nc: 11\n", "")


def test_one_that_fails_or_waits_does_not_stop_another(tmp_path: Path) -> None:
    codes, out, err = run(
        tmp_path,
        "print('one', end='')\n1 / 0\n",
        "from pybricks.tools import wait\nwait(100)\nprint('two')\n",
        "while True: pass\n",
        limit_s=2.0,
    )
    assert codes == [1, 0, 124] and out == "a: one\nb: two\n"
    assert "a: ZeroDivisionError" in err and "c: The program was stopped at the time limit" in err


def test_who_waits_for_input_is_told_that_a_room_has_none(tmp_path: Path) -> None:
    codes, _, err = run(tmp_path, "input()\n", "print(1)\n")
    assert codes == [1, 0] and "several hubs in a room have none, so run it alone" in err


def test_strength_is_smoothed_and_falls_with_the_distance() -> None:
    near, far = Antenna(), Antenna()
    for antenna, distance_m in ((near, 1.0), (far, 4.0)):
        sender = Antenna()
        antenna.observe([3])
        sender.broadcast(0, 3, 1)
        Air([sender, antenna], lambda *_, distance_m=distance_m: distance_m).carry(2000)
    strengths = [antenna.observed(2000, 3)[1] for antenna in (near, far)]
    assert strengths == [-55, -67], "6 dB less at twice the distance"
    heard = near.heard[3]
    before, time_ms = heard.strength_dbm, heard.time_ms
    heard.take(time_ms + 128, 1, before - 40)
    assert heard.strength_dbm == before - 10, "a quarter of 512 ms"
    heard.take(time_ms + 128 + 600, 1, -100)
    assert heard.strength_dbm == -100


@pytest.mark.parametrize("count", [8, pytest.param(100, marks=pytest.mark.slow)])
def test_random_pairs_are_the_same_twice(count: int, tmp_path: Path) -> None:
    rng = random.Random(59)
    told = 0
    for _ in range(count):
        pair = (random_program(rng, 0), random_program(rng, 1))
        first = run(tmp_path, *pair)
        assert first == run(tmp_path, *pair) and first[0] == [0, 0]
        told += "(" in first[1]
    assert told > 0, "some of them hear each other"


def test_command(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder, text in zip(folders, ("print(1)\n", "print(2)\nraise ValueError\n"), strict=True):
        folder.mkdir()
        (folder / "main.py").write_text(text)
    words = [str(folder / "main.py") for folder in folders]
    assert main(("run", *words)) == 1
    said = capfdbinary.readouterr()
    assert said.out == b"main 1: 1\nmain 2: 2\n" and b"main 2: ValueError" in said.err
    for option, says in (
        (("--press", "left@1s"), b"several hubs have no --press"),
        (("--robot", words[0]), b"there are 2 programs and 1 robot;"),
        (
            ("--robot", words[0], "--robot", words[1]),
            b"robots that share a world need bodies: use bricktwin run",
        ),
    ):
        assert main(("run", *words, *option)) == 2
        assert says in capfdbinary.readouterr().err


def test_an_empty_room_is_refused() -> None:
    with pytest.raises(TwinError, match="there is no program for this room"):
        Room([], stdout=io.BytesIO(), stderr=io.StringIO())


def test_what_ends_the_room_is_no_error_of_a_program(tmp_path: Path) -> None:
    """Nor of another hub's, which has let time pass when it happened."""

    class Full(io.BytesIO):
        def write(self, data: object, /) -> int:
            raise OSError(28, "No space left on device")

    path, err = tmp_path / "a.py", io.StringIO()
    path.write_text("from pybricks.tools import wait\nwait(100)\nprint(1)\nwait(9999)\n")
    programs = [HubProgramFile(path), HubProgramFile(path)]
    with pytest.raises(OSError, match="No space left"):
        Room(programs, stdout=Full(), stderr=err).run()
    assert err.getvalue() == ""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_end_all_programs_past_their_handlers(tmp_path: Path, name: str) -> None:
    path = tmp_path / "a.py"
    path.write_text(
        "from pybricks.tools import wait\nwhile True:\n    try:\n        wait(100)\n"
        "    except BaseException:\n        pass\n"
    )
    # Whoever started these tests by `nohup` lets them ignore SIGHUP, and so what they start.
    heeding = (
        "import os, signal, sys\nsignal.signal(int(sys.argv[1]), signal.SIG_DFL)\n"
        "os.execv(sys.executable, [sys.executable, *sys.argv[2:]])\n"
    )
    number = getattr(signal, name)
    for count in (1, 2):
        words = ["-m", "brickhub", "run", *[str(path)] * count, "--realtime"]
        command = [sys.executable, "-c", heeding, str(int(number)), *words]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            try:
                time.sleep(1.5)
                process.send_signal(number)
                err = process.communicate(timeout=20)[1]
            finally:
                process.kill()
        assert process.returncode == 130 and "Traceback" not in err, err
        assert err.startswith("interrupted: "), err
