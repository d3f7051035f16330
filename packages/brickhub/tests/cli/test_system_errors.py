"""What a person is told where this computer refuses: the disk, memory, what is installed."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from dataclasses import dataclass

import pytest

from brickhub.cli.app import CommandLine, run
from brickhub.errors import HubTimeoutError

_raised: list[BaseException] = []


@dataclass(frozen=True)
class _Fails:
    """Fail with what the test has prepared.

    Examples:
      test fails
    """

    def execute(self) -> int:
        raise _raised.pop()


LINE = CommandLine("test", "0", "Tests.", {"fails": f"{__name__}:_Fails"})
Told = Callable[[BaseException], str]


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str]) -> Told:
    """One line that a person is told of an error, without its beginning."""

    def tell(error: BaseException) -> str:
        _raised.append(error)
        assert run(LINE, ["fails"]) == 2
        captured = capsys.readouterr()
        assert captured.out == "" and captured.err.count("\n") == 1
        return captured.err.removeprefix("error: ").rstrip("\n")

    return tell


def _system_error(number: int, *names: str) -> OSError:
    return OSError(number, os.strerror(number), *names)


def test_full_disk_has_its_own_remedy(told: Told) -> None:
    full = os.strerror(errno.ENOSPC)
    assert told(_system_error(errno.ENOSPC, "a.csv")) == f"a.csv: {full}; make room on the disk"
    assert told(_system_error(errno.ENOSPC)) == f"{full}; make room on the disk"


@pytest.mark.parametrize("number", [errno.ENOENT, errno.EACCES, errno.EIO])
def test_other_refusals_name_the_file(told: Told, number: int) -> None:
    said = told(_system_error(number, "a.csv"))
    assert said == f"a.csv: {os.strerror(number)}; look whether it is there and you may use it"


def test_error_without_a_number_is_said_too(told: Told) -> None:
    assert told(OSError("no room")).startswith("no room; look")


def test_memory_that_is_missing_is_said(told: Told) -> None:
    assert told(MemoryError()) == "this computer has not enough memory for that; ask for less"


def test_our_own_errors_are_said_as_they_are(told: Told) -> None:
    assert told(HubTimeoutError("the hub is silent; switch it on")) == (
        "the hub is silent; switch it on"
    )
