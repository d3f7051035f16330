"""Compilation of hub programs."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from brickhub.errors import ProgramError
from brickhub.hub.program.compile import compile_mpy, compile_program, program_blob
from brickhub.hub.transport import HubModule, HubProgram
from brickhub.robot import HubKind


def test_mpy_is_version_6_without_native_code_for_31_bit_small_integers() -> None:
    mpy = compile_mpy("x = 1\n")
    assert (mpy[0:1], mpy[1], mpy[2], mpy[3]) == (b"M", 6, 0, 31)
    assert b"main.py" in mpy and b"robot.py" in compile_mpy("x = 1\n", "robot.py")


@pytest.mark.parametrize(
    "source", ["x = = 1\n", "if x:\npass\n", "match x:\n    case 1:\n        pass\n", "'\n", "\0"]
)
def test_syntax_errors_are_one_line(source: str) -> None:
    with pytest.raises(ProgramError, match=r"^main.py, line \d: SyntaxError: .*; ") as info:
        compile_mpy(source)
    assert "\n" not in str(info.value)


def test_an_error_names_its_line() -> None:
    with pytest.raises(ProgramError, match="line 3"):
        compile_mpy("x = 1\n\ny = = 2\n")


@pytest.mark.parametrize("line", ["x = [*range(3)]", "return 5", "def f(): continue"])
def test_error_of_a_statement_names_its_line(line: str) -> None:
    with pytest.raises(ProgramError, match="^main.py, line 3: SyntaxError"):
        compile_mpy(f"x = 1\n\n{line}\n")


def test_missing_hub_compiler_raises(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("mpy_cross_v6.MPY_CROSS_PATH", str(tmp_path / "mpy-cross"))
    with pytest.raises(ProgramError, match="reinstall mpy-cross-v6"):
        compile_mpy("x = 1\n")


def test_blob_has_program_and_modules() -> None:
    modules = compile_program(
        HubProgram(
            "import arm.hand\n",
            0,
            name="wave.py",
            modules=(HubModule("arm.hand", "arm/hand.py", "x = 1\n"),),
        )
    )
    main, hand = compile_mpy("import arm.hand\n", "wave.py"), compile_mpy("x = 1\n", "arm/hand.py")
    expected = (
        struct.pack("<I", len(main))
        + b"__main__\0"
        + main
        + struct.pack("<I", len(hand))
        + b"arm.hand\0"
        + hand
    )
    assert program_blob(modules, HubKind.PRIME) == expected


def test_too_large_program_raises() -> None:
    largest = bytes(HubKind.CITY.model.program_bytes - 13)
    assert program_blob({"__main__": largest}, HubKind.CITY)
    with pytest.raises(ProgramError, match="20481 bytes, the city hub takes 20480"):
        program_blob({"__main__": largest + b"x"}, HubKind.CITY)


def test_what_is_too_large_for_the_compiler_is_said() -> None:
    source = "".join(f"def f{n}(a, b):\n    return a * {n} + b\n" for n in range(9000))
    with pytest.raises(ProgramError, match="main.py is too large for the compiler mpy-cross; put"):
        compile_mpy(source)
