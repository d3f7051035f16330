"""A hub's traceback in one line."""

from __future__ import annotations

from brickhub.hub.program.run_program import describe_traceback

SOURCE = "import x\n\nmotor = Motor(Port.A)\n"
TEXT = (
    'noise\r\nTraceback (most recent call last):\r\n  File "main.py", line 3, in <module>\r\n'
    "OSError: [Errno 19] ENODEV: \r\n"
)


def test_traceback_names_error_line_remedy() -> None:
    assert describe_traceback(TEXT, SOURCE) == (
        "the program on the hub raised OSError: [Errno 19] ENODEV: at line 3 (motor = "
        "Motor(Port.A)); "
        "plug the device into the port that the robot's description names"
    )


def test_last_traceback_counts() -> None:
    text = (
        TEXT
        + 'Traceback (most recent call last):\r\n  File "main.py", line 1, in f\r\nMemoryError\r\n'
    )
    assert describe_traceback(text, SOURCE).startswith(
        "the program on the hub raised MemoryError at line 1 (import x); use fewer"
    )


def test_truncated_traceback_is_partial() -> None:
    assert describe_traceback("Traceback (most rec", SOURCE) == (
        "the program on the hub raised an unknown error; correct the cause, then call open()"
    )
    assert "at line" not in describe_traceback(TEXT.replace("line 3", "line 99"), SOURCE)
    assert "at line" not in describe_traceback(TEXT.replace("main.py", "other.py"), SOURCE)
