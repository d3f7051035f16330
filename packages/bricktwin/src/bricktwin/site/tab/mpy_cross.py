"""The hub's compiler in a tab, in place of the package ``mpy_cross_v6``, which is a program of the
computer."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType

Compile = Callable[[str, str, list[str]], tuple[int, bytes | None, str]]
"""Status, ``.mpy`` and report for a file name, a source and options."""


@dataclass(frozen=True)
class _Ended:
    """How the compiler ended, as ``subprocess`` says it."""

    returncode: int
    stderr: bytes


def put_in_place(compile_in_tab: Compile) -> None:
    """Let ``import mpy_cross_v6`` find the compiler that runs in the tab."""

    def mpy_cross_compile(
        filename: str,
        contents: str,
        *,
        extra_args: Sequence[str] = (),
    ) -> tuple[_Ended, bytes | None]:
        status, mpy, report = compile_in_tab(filename, contents, list(extra_args))
        # It comes as a view of the compiler's memory.
        return _Ended(status, report.encode()), None if mpy is None else bytes(mpy)

    module = ModuleType("mpy_cross_v6", __doc__)
    module.mpy_cross_compile = mpy_cross_compile  # type: ignore[attr-defined]
    sys.modules["mpy_cross_v6"] = module
