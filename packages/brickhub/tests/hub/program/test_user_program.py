"""User programs on a hub."""

from __future__ import annotations

import asyncio
import io
import struct
import sys
from pathlib import Path

import pytest
from ble_world import World
from hypothesis import given
from hypothesis import strategies as st

from brickhub.cli import main
from brickhub.errors import HubDisconnectedError, ProgramError
from brickhub.hub.program.compile import compile_program, program_blob
from brickhub.hub.program.run_program import (
    Transcript,
    check_time_limit,
    load_program,
    run_program,
)
from brickhub.hub.transports.address import HubAddress
from brickhub.robot import HubKind, Motor, Robot

pytestmark = pytest.mark.realtime

FILES = {
    "main.py": (
        "import parts.arm\nfrom leg import kick, step\nimport pybricks.tools\n"
        "print(parts.reach(), kick, step)\n"
    ),
    "parts/arm.py": "from tools import double\ndef reach():\n    return double(21)\n",
    "tools/__init__.py": "def double(x):\n    return 2 * x\n",
    "leg.py": "import ustruct\nkick, step = 1, 2\n",
    "unused.py": "raise ValueError\n",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, source in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(source)
    return tmp_path


def unpacked(blob: bytes) -> dict[str, bytes]:
    modules, place = {}, 0
    while place < len(blob):
        (length,) = struct.unpack_from("<I", blob, place)
        name, _, rest = blob[place + 4 :].partition(b"\0")
        modules[name.decode()] = rest[:length]
        place += 5 + len(name) + length
    return modules


def test_program_modules_match_pybricksdev(folder: Path) -> None:
    from pybricksdev.compile import compile_multi_file

    program = load_program(folder / "main.py")
    assert [module.name for module in program.modules] == ["parts.arm", "leg", "tools"]
    blob = program_blob(compile_program(program), HubKind.PRIME)
    assert unpacked(blob) == unpacked(
        asyncio.run(compile_multi_file(str(folder / "main.py"), (6, 1)))
    )
    assert blob.index(b"__main__") == 4


def test_byte_order_mark_is_no_code(tmp_path: Path) -> None:
    """Some editors on Windows write one."""
    (tmp_path / "main.py").write_bytes(b"\xef\xbb\xbfprint(1)\r\n")
    assert load_program(tmp_path / "main.py").source == "print(1)\n"


def test_circular_imports_terminate(tmp_path: Path) -> None:
    (tmp_path / "main.py").write_text("import other\n")
    (tmp_path / "other.py").write_text("import main, other\n")
    assert [module.name for module in load_program(tmp_path / "main.py").modules] == [
        "other",
        "main",
    ]


def test_unreadable_or_invalid_files_raise(folder: Path) -> None:
    with pytest.raises(ProgramError, match="cannot read the program"):
        load_program(folder / "none.py")
    (folder / "leg.py").write_bytes(b"\xff\xfe")
    with pytest.raises(ProgramError, match=r"leg\.py' is no text in UTF-8 .*; save it as UTF-8"):
        load_program(folder / "main.py")
    (folder / "leg.py").write_text("kick = = 2\n")
    with pytest.raises(ProgramError, match=r"^leg\.py, line 1: SyntaxError"):
        compile_program(load_program(folder / "main.py"))


HEAD = "Traceback (most recent call last):\r\n"
PLACES = '  File "main.py", line 3, in <module>\r\n  File "arm.py", line 1, in reach\r\n'
RAISED = HEAD + PLACES + "ValueError: 3\r\n"
STOPPED = "The program was stopped (SystemExit).\r\n"


@pytest.mark.parametrize(
    ("written", "out", "err", "code"),
    [
        ("a\r\nb\r\n", "a\nb\n", "", 0),
        ("a\r\nb", "a\nb", "", 0),
        ("a\r\n" + RAISED, "a\n", RAISED, 1),
        (RAISED + "on\r\n", RAISED + "on\n", "", 0),
        (RAISED + "on", RAISED + "on", "", 0),
        (RAISED + RAISED, RAISED, RAISED, 1),
        (HEAD + "said somebody\r\n", HEAD + "said somebody\n", "", 0),
        ("a\r\n" + STOPPED, "a\n", STOPPED, 0),
        (STOPPED + "not yet\r\n", STOPPED + "not yet\n", "", 0),
        ("The ", "The ", "", 0),
        ("\xe4\r\n", "\xe4\n", "", 0),
    ],
)
@given(data=st.data())
def test_firmware_messages_are_distinguished(
    data: st.DataObject, written: str, out: str, err: str, code: int
) -> None:
    stdout, stderr = io.BytesIO(), io.StringIO()
    transcript, left = Transcript(stdout, stderr), written.encode()
    while left:
        size = data.draw(st.integers(1, len(left)))
        transcript.feed(left[:size])
        left = left[size:]
    assert transcript.end() == code
    assert stdout.getvalue().decode() == out.replace("\r\n", "\n")
    assert stderr.getvalue() == err.replace("\r\n", "\n")


def test_prompt_is_shown_immediately() -> None:
    stdout = io.BytesIO()
    Transcript(stdout, io.StringIO()).feed(b"a\r\nTicket: ")
    assert stdout.getvalue() == b"a\nTicket: "


def run(
    world: World, path: Path, stdin: str | None = None, time_limit_s: float | None = None
) -> tuple[int, str, str]:
    program = load_program(path)
    world.hub.files[program.name] = program.source
    world.hub.files.update({module.file: module.source for module in program.modules})
    transport = world.transport()
    transport.open()
    out, err = io.BytesIO(), io.StringIO()
    typed = io.StringIO(stdin) if stdin is not None else None
    code = run_program(
        transport, program, stdout=out, stderr=err, stdin=typed, time_limit_s=time_limit_s
    )
    transport.close()
    return code, out.getvalue().decode(), err.getvalue()


def test_user_program_runs_over_bluetooth(world: World, folder: Path) -> None:
    assert run(world, folder / "main.py") == (0, "42 1 2\n", "")
    (folder / "leg.py").write_text("kick, step = 1, 2\nprint('a')\nkick / 0\n")
    code, out, err = run(world, folder / "main.py")
    assert (code, out) == (1, "a\n")
    assert err.splitlines()[1:] == [
        '  File "main.py", line 2, in <module>',
        '  File "leg.py", line 3, in <module>',
        "ZeroDivisionError: divide by zero",
    ]
    assert not world.hub.is_running


def test_user_program_runs_on_small_hub(tmp_path: Path) -> None:
    world = World(tmp_path, Robot("small", HubKind.MOVE, motors=(Motor("one", "A"),)))
    try:
        (tmp_path / "main.py").write_text("print(7 // 2)\n")
        assert run(world, tmp_path / "main.py") == (0, "3\n", "")
    finally:
        world.close()


def test_user_program_is_always_downloaded(world: World, folder: Path) -> None:
    """A program without HELLO is always downloaded and not cached."""
    link = world.link()
    link.open()
    link.close()
    for name in ("one", "two"):
        (folder / "main.py").write_text(f"print('{name}')\n")
        assert run(world, folder / "main.py") == (0, f"{name}\n", "")
    downloads = len(world.hub.commands)
    link.open()
    assert len(world.hub.commands) > downloads + 5, "our own program had to come again"


def test_user_program_reads_input(world: World, folder: Path) -> None:
    lines = "".join(f"{n}\n" for n in range(100))
    (folder / "main.py").write_text(
        "total = 0\nfor _ in range(100):\n    total += int(input())\nprint()\nprint('sum', total)\n"
    )
    code, out, _ = run(world, folder / "main.py", stdin=lines)
    assert code == 0 and out.endswith("\nsum 4950\n")


def test_closed_input_is_empty(world: World, folder: Path) -> None:
    (folder / "main.py").write_text("print('runs')\n")
    program = load_program(folder / "main.py")
    world.hub.files[program.name] = program.source
    closed, out = io.BytesIO(), io.BytesIO()
    closed.close()
    assert (
        run_program(world.transport(), program, stdout=out, stderr=io.StringIO(), stdin=closed) == 0
    )
    assert out.getvalue() == b"runs\n"


def test_user_program_and_motors_stop_at_time_limit(world: World, folder: Path) -> None:
    source = (
        "from pybricks.parameters import Port\nfrom pybricks.pupdevices import Motor\n"
        "from pybricks.tools import wait\n"
    )
    (folder / "main.py").write_text(
        source + "Motor(Port.A).run(500)\nprint('runs')\nwhile True:\n    wait(10)\n"
    )
    code, out, err = run(world, folder / "main.py", time_limit_s=0.5)
    assert (code, out.strip(), err) == (
        124,
        "runs",
        "The program was stopped at the time limit of 0.5 s.\n",
    )
    assert not world.hub.is_driven and not world.hub.is_running


def test_lost_link_raises(world: World, folder: Path) -> None:
    (folder / "main.py").write_text("from pybricks.tools import wait\nprint('runs')\nwait(60000)\n")

    class Unplugs(io.BytesIO):
        def write(self, data: bytes) -> int:  # type: ignore[override]
            world.hub.reboot()
            return super().write(data)

    program = load_program(folder / "main.py")
    world.hub.files[program.name] = program.source
    transport = world.transport()
    transport.open()
    with pytest.raises(HubDisconnectedError):
        run_program(transport, program, stdout=Unplugs(), stderr=io.StringIO())


def test_command_runs_user_program(
    world: World, folder: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary
) -> None:
    monkeypatch.setattr(HubAddress, "transport", lambda self, kind=None: world.transport())
    monkeypatch.setattr(sys, "stdin", None)
    world.hub.files.update(FILES)
    assert main(("run", str(folder / "main.py"), "--hub", "ble")) == 0
    assert capfdbinary.readouterr().out == b"42 1 2\n"
    assert not world.hub.is_connected


def test_invalid_program_fails_without_hub(folder: Path, capsys) -> None:
    (folder / "main.py").write_text("x =\n")
    assert main(("run", str(folder / "main.py"), "--hub", "ble")) == 2
    assert "main.py, line 2: SyntaxError" in capsys.readouterr().err


@pytest.mark.parametrize("limit_s", [0.0, -1.0, float("inf"), float("nan")])
def test_time_limit_is_a_positive_number(limit_s: float) -> None:
    with pytest.raises(ProgramError, match="give a number above zero, or none"):
        check_time_limit(limit_s)
    for fine_s in (None, 1e-3, 1e9):
        check_time_limit(fine_s)
