"""Output of a program apart from what the firmware says at its end, however it is cut."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from brickhub.errors import HubBusyError, ProgramError, ProgramStoppedError
from brickhub.hub.program.run_program import (
    Transcript,
    describe_traceback,
    folder_with_module,
    imports,
    load_program,
    module_beside,
    read_program,
    run_program,
    time_limit_note,
)
from brickhub.hub.transport import HubModule, HubProgram, as_typed

TRACE = "Traceback (most recent call last):\r\n"
AT = '  File "main.py", line 2, in <module>\r\n'
STOPPED = "The program was stopped (SystemExit).\r\n"


@pytest.mark.parametrize(
    ("text", "out", "err", "code"),
    [
        ("", "", "", 0),
        ("hello\r\nyou", "hello\nyou", "", 0),
        # The firmware's own end.
        (f"a\r\n{TRACE}{AT}OSError: no\r\n", "a\n", f"{TRACE}{AT}OSError: no\r\n", 1),
        (f"{TRACE}{AT}{AT}ValueError\r\n", "", f"{TRACE}{AT}{AT}ValueError\r\n", 1),
        (f"a\r\n{STOPPED}", "a\n", STOPPED, 0),
        # A traceback that something follows was printed by the program.
        (f"{TRACE}{AT}OSError\r\nmore\r\n", f"{TRACE}{AT}OSError\r\nmore\r\n", "", 0),
        (f"{TRACE}{AT}OSError\r\nmore", f"{TRACE}{AT}OSError\r\nmore", "", 0),
        (f"{TRACE}no place\r\n", f"{TRACE}no place\r\n", "", 0),
        (f"{STOPPED}more\r\n", f"{STOPPED}more\r\n", "", 0),
        # Alone, without a place, it is no traceback.
        (TRACE, TRACE, "", 0),
        (f"see {TRACE}", f"see {TRACE}", "", 0),
        # Two of them: the first was printed.
        (f"{TRACE}{AT}A\r\n{TRACE}{AT}B\r\n", f"{TRACE}{AT}A\r\n", f"{TRACE}{AT}B\r\n", 1),
        # What only begins so is output.
        ("Trace", "Trace", "", 0),
        ("The program was stopped (by me).\r\n", "The program was stopped (by me).\r\n", "", 0),
        ("a\rb\r\n", "a\rb\n", "", 0),
        # The output of a program may end within a line.
        (f"name? {TRACE}{AT}OSError\r\n", "name? ", f"{TRACE}{AT}OSError\r\n", 1),
        (f"äT{STOPPED}", "äT", STOPPED, 0),
        (f"a {TRACE}no place\r\n", f"a {TRACE}no place\r\n", "", 0),
        (f"{TRACE}{AT}said: {TRACE}", "", f"{TRACE}{AT}said: {TRACE}", 1),
    ],
)
@pytest.mark.parametrize("piece_bytes", [1, 3, 1000])
def test_output_and_end_of_a_program(
    text: str, out: str, err: str, code: int, piece_bytes: int
) -> None:
    stdout, stderr = io.BytesIO(), io.StringIO()
    transcript = Transcript(stdout, stderr)
    data = text.encode()
    for start in range(0, len(data), piece_bytes):
        transcript.feed(data[start : start + piece_bytes])
    assert transcript.end() == code
    assert stdout.getvalue() == out.replace("\r\n", "\n").encode()
    assert stderr.getvalue() == err.replace("\r\n", "\n")


def test_a_prompt_is_printed_at_once() -> None:
    stdout = io.BytesIO()
    transcript = Transcript(stdout, io.StringIO())
    transcript.feed(b"name? ")
    assert stdout.getvalue() == b"name? "
    # What may become the word of the firmware waits.
    transcript.feed(b"Tr")
    assert stdout.getvalue() == b"name? "
    transcript.feed(b"ee\nTr")
    assert stdout.getvalue() == b"name? Tree\n"
    transcript.feed(b"ee")
    assert stdout.getvalue() == b"name? Tree\nTree"


def test_that_we_stopped_it_is_not_said() -> None:
    stderr = io.StringIO()
    transcript = Transcript(io.BytesIO(), stderr)
    transcript.feed(STOPPED.encode())
    assert transcript.end(is_stopped_by_us=True) == 0
    assert stderr.getvalue() == ""
    transcript = Transcript(io.BytesIO(), stderr)
    transcript.feed(f"{TRACE}{AT}OSError\r\n".encode())
    assert transcript.end(is_stopped_by_us=True) == 1
    assert stderr.getvalue().endswith("OSError\n")


class PlayedTransport:
    """A transport whose program prints pieces, and ends with them; its clock ticks by reads."""

    def __init__(self, *pieces: bytes, refuses: int = 0) -> None:
        self.pieces = list(pieces)
        self.refuses = refuses
        self.written: list[bytes] = []
        self.timeouts_s: list[float] = []
        self.stops = 0
        self.started: list[HubProgram] = []
        self._now_s = 0.0

    def start(self, program: HubProgram) -> None:
        self.started.append(program)

    def now_s(self) -> float:
        return self._now_s

    def write(self, data: bytes) -> None:
        if self.refuses:
            self.refuses -= 1
            raise HubBusyError("full")
        self.written.append(data)

    def read(self, timeout_s: float) -> bytes:
        self.timeouts_s.append(timeout_s)
        self._now_s += 1.0
        if not self.pieces:
            raise ProgramStoppedError("over")
        return self.pieces.pop(0)

    def stop(self) -> None:
        self.stops += 1
        self.pieces = [b"last\r\n", STOPPED.encode()]


def ran(transport: PlayedTransport, **options: object) -> tuple[int, str, str]:
    """Exit code, output and messages of a program over a played transport."""
    stdout, stderr = io.BytesIO(), io.StringIO()
    program = HubProgram("print(1)\n", 1)
    code = run_program(
        transport,  # type: ignore[arg-type]
        program,
        stdout=stdout,
        stderr=stderr,
        **options,  # type: ignore[arg-type]
    )
    assert transport.started == [program]
    return code, stdout.getvalue().decode(), stderr.getvalue()


def test_program_runs_to_its_end() -> None:
    transport = PlayedTransport(b"one\r\n", b"", b"two\r\n")
    assert ran(transport) == (0, "one\ntwo\n", "")
    assert transport.stops == 0
    assert transport.timeouts_s == [0.25] * 4


def test_time_limit_stops_a_program_once_and_its_last_words_are_heard() -> None:
    transport = PlayedTransport(*[b"."] * 9)
    code, out, err = ran(transport, time_limit_s=3.0)
    assert (code, out) == (124, "...last\n")
    assert err == "The program was stopped at the time limit of 3 s.\n"
    assert transport.stops == 1


@pytest.mark.parametrize("limit_s", [0.0, -1.0, float("inf"), float("nan")])
def test_time_limit_that_is_none(limit_s: float) -> None:
    transport = PlayedTransport()
    with pytest.raises(ProgramError, match=f"the time limit is {limit_s} s; give a number above"):
        ran(transport, time_limit_s=limit_s)


def test_input_goes_in_pieces_that_fit_a_write_and_again_when_the_hub_is_full() -> None:
    transport = PlayedTransport(*[b""] * 9, refuses=2)
    typed = bytes(range(45))
    assert ran(transport, stdin=io.BytesIO(typed)) == (0, "", "")
    assert [len(piece) for piece in transport.written] == [20, 20, 5]
    assert b"".join(transport.written) == typed
    assert set(transport.timeouts_s) == {0.02}


def test_text_is_typed_with_the_enter_key() -> None:
    transport = PlayedTransport(*[b""] * 9)
    ran(transport, stdin=io.StringIO("ä1\nb\n"))
    assert b"".join(transport.written) == "ä1\rb\r".encode()
    assert as_typed("a\udcff\n") == b"a\xff\r"
    assert as_typed(b"a\n") == b"a\n"


def test_note_of_the_time_limit() -> None:
    assert time_limit_note(2.5) == "The program was stopped at the time limit of 2.5 s.\n"


def write(folder: Path, **sources: str) -> None:
    """Files of a program; __ in a name is a folder."""
    for name, source in sources.items():
        path = folder / f"{name.replace('__', '/')}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source, encoding="utf-8")


def test_modules_beside_a_program_are_taken_once_each(tmp_path: Path) -> None:
    write(
        tmp_path,
        main="import one\nimport parts.arm\nimport umath\n",
        one="import two\n",
        two="import one\nfrom pybricks.tools import wait\n",
        parts__arm="X = 1\n",
        unused="Y = 2\n",
    )
    program = load_program(tmp_path / "main.py")
    assert (program.name, program.says_hello) == ("main.py", False)
    assert {module.name: module.file for module in program.modules} == {
        "one": "one.py",
        "two": "two.py",
        "parts.arm": "parts/arm.py",
    }
    assert 0 <= program.hash < 2**32
    assert imports(program, "umath")
    assert imports(program, "pybricks.tools")
    assert not imports(program, "unused")
    before = program.hash
    write(tmp_path, two="import one\n")
    assert load_program(tmp_path / "main.py").hash != before


def test_package_beside_a_program_is_its_first_file(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "__init__.py").write_text("A = 1\n")
    wanted = HubModule("parts", "parts/__init__.py", "A = 1\n")
    assert module_beside(tmp_path / "main.py", "parts") == wanted
    write(tmp_path, parts="B = 2\n")
    assert module_beside(tmp_path / "main.py", "parts") == HubModule("parts", "parts.py", "B = 2\n")
    assert module_beside(tmp_path / "main.py", "arm") is None


def test_nearest_folder_above_has_the_module(tmp_path: Path) -> None:
    deep = tmp_path / "a" / "b" / "c" / "d" / "e"
    deep.mkdir(parents=True)
    program = deep / "main.py"
    program.write_text("import arm\n")
    assert folder_with_module(program, "arm") is None
    # Beside it is not above it, and what is five folders up is another project's.
    write(deep, arm="")
    assert folder_with_module(program, "arm") is None
    write(tmp_path, arm="")
    assert folder_with_module(program, "arm") is None
    write(tmp_path / "a", arm="")
    assert folder_with_module(program, "arm") == (tmp_path / "a").resolve()
    write(tmp_path / "a" / "b", arm="")
    assert folder_with_module(program, "arm") == (tmp_path / "a" / "b").resolve()


def test_file_that_is_no_program(tmp_path: Path) -> None:
    missing = tmp_path / "none.py"
    with pytest.raises(ProgramError, match="cannot read the program .*; give the path of a Python"):
        read_program(missing)
    path = tmp_path / "latin.py"
    path.write_bytes(b"# caf\xe9\n")
    with pytest.raises(ProgramError, match="is no text in UTF-8 .*; save it as UTF-8"):
        read_program(path)
    path.write_bytes(b"\xef\xbb\xbfx = 1\n")
    assert read_program(path) == "x = 1\n"


@pytest.mark.parametrize(
    ("error", "remedy"),
    [
        ("OSError: [Errno 19] ENODEV", "plug the device into the port that the robot's"),
        ("OSError: [Errno 110] ETIMEDOUT", "switch the remote on at the start of the program"),
        ("MemoryError", "use fewer commands and channels, or a larger hub"),
        ("ValueError: x", "correct the cause, then call open()"),
    ],
)
def test_remedy_of_an_error(error: str, remedy: str) -> None:
    text = f'Traceback (most recent call last):\n  File "main.py", line 1, in f\n{error}\n'
    told = describe_traceback(text, "first\nsecond\n")
    assert told.startswith(f"the program on the hub raised {error} at line 1 (first); {remedy}")


@pytest.mark.parametrize(("line", "where"), [(0, ""), (2, " at line 2 (second)"), (3, "")])
def test_line_of_a_traceback_is_one_of_the_source(line: int, where: str) -> None:
    text = f'Traceback (most recent call last):\n  File "my.py", line {line}, in f\nKeyError: 1\n'
    told = describe_traceback(text, "first\n  second  \n", "my.py")
    assert told == f"the program on the hub raised KeyError: 1{where}; {_CORRECT}"
    # That of a module beside it is not in this source.
    assert " at line" not in describe_traceback(text, "first\nsecond\n")


_CORRECT = "correct the cause, then call open()"


def test_innermost_line_counts() -> None:
    text = (
        'Traceback (most recent call last):\n  File "main.py", line 1, in <module>\n'
        '  File "main.py", line 2, in f\nOSError: x\nThe program was stopped (SystemExit).\n'
    )
    told = describe_traceback(text, "first\nsecond\n")
    assert told == f"the program on the hub raised OSError: x at line 2 (second); {_CORRECT}"
