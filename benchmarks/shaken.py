"""All tests that are not slow, with starts that are a little off, and with the arithmetic of other
processors.

    python -m benchmarks shaken [--shakes 10] [--arithmetics ...]

In a shake each body starts 1e-9 off and each network's first weights are 1e-7 off
(`tests/plugins/shaking.py`). The first shake runs all tests and notes which of them meet something
that is shaken; the others run those. The arithmetics run all tests with other kernels of PyTorch,
MKL, OpenBLAS, NumPy and glibc, and with 1, 2 and 4 threads. A test that keeps to a clock may fail
twice: what fails three times rests on luck. Exit code 1 if any did.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks.session import Session

ROOT = Path(__file__).parent.parent
TESTS = ("packages/bricksrl/tests", "tests", "packages/bricktwin/tests", "packages/brickhub/tests")
FIRST = 1
"""Seed of the shake that notes which tests the others run."""

_OLD_LIBM = "glibc.cpu.hwcaps=-AVX2,-FMA"
_FEATURES = """
from numpy._core import _multiarray_umath as found
print(*(name for name in found.__cpu_dispatch__ if found.__cpu_features__[name]))
"""


def _threads(count: int) -> dict[str, str]:
    return {f"{library}_NUM_THREADS": str(count) for library in ("OMP", "MKL", "OPENBLAS")}


ARITHMETICS = {
    "plain": {
        "ATEN_CPU_CAPABILITY": "default",
        "MKL_CBWR": "COMPATIBLE",
        "OPENBLAS_CORETYPE": "Nehalem",
        **_threads(1),
    },
    "avx2": {
        "ATEN_CPU_CAPABILITY": "avx2",
        "MKL_CBWR": "AVX2",
        "OPENBLAS_CORETYPE": "Haswell",
        **_threads(1),
    },
    "two-threads": {
        "MKL_CBWR": "AVX",
        "OPENBLAS_CORETYPE": "Sandybridge",
        "GLIBC_TUNABLES": _OLD_LIBM,
        **_threads(2),
    },
    "four-threads": _threads(4),
}
"""Environment variables, by name. ``plain`` and ``two-threads`` also have the libm of a processor
without AVX2 and FMA; NumPy has what is left in `_numpy`."""
ARITHMETICS["plain"]["GLIBC_TUNABLES"] = _OLD_LIBM
_NUMPY = {"plain": "", "avx2": "X86_V3 AVX2 FMA3"}
"""Features of the processor that NumPy may use, where it may not use all."""


def environment_of(arithmetic: str) -> dict[str, str]:
    """Environment variables of an arithmetic on this processor."""
    found = dict(ARITHMETICS[arithmetic])
    if arithmetic in _NUMPY:
        command = [sys.executable, "-c", _FEATURES]
        # - our own arguments
        done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
        # NumPy warns of features that the processor does not have.
        off = [name for name in done.stdout.split() if name not in _NUMPY[arithmetic].split()]
        if off:
            found["NPY_DISABLE_CPU_FEATURES"] = " ".join(off)
    return found


def outcome(
    tests: list[str], options: list[str], environment: dict[str, str], jobs: int
) -> dict[str, Any]:
    """Run tests; returns their number, and those that failed three times."""
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-m",
        "not slow",
        "--reruns",
        "2",
    ]
    command += ["--timeout", "900", "--numprocesses", str(jobs), *options, *tests]
    clean = {name: value for name, value in os.environ.items() if name != "CI"}
    whole = {**clean, **environment}
    out, err = subprocess.PIPE, subprocess.STDOUT
    # - our own
    done = subprocess.run(  # noqa: S603
        command, cwd=ROOT, env=whole, stdout=out, stderr=err, text=True, check=False
    )
    failed = re.findall(
        r"^(?:FAILED|ERROR) (\S+?\.py(?:::.*?)?)(?: - .*)?$", done.stdout, re.MULTILINE
    )
    counts = re.findall(r"(\d+) (passed|failed|error)", done.stdout.strip().rpartition("\n")[2])
    if done.returncode not in (0, 1):
        failed.append(f"pytest itself: {done.stdout[-300:]}")
    return {"tests": sum(int(count) for count, _ in counts), "failed": sorted(set(failed))}


def first_shake(tests: list[str], jobs: int, record: Path) -> dict[str, Any]:
    """Run all tests, and keep the names of those that meet something shaken."""
    record.parent.mkdir(parents=True, exist_ok=True)
    record.unlink(missing_ok=True)
    found = outcome(tests, ["--shake", str(FIRST), "--met", str(record)], {}, jobs)
    record.touch()
    met = sorted(set(record.read_text(encoding="utf-8").splitlines()))
    record.unlink()
    return {**found, "met": met}


def shake(seed: int, met: list[str], jobs: int, record: Path) -> dict[str, Any]:
    """Run the tests that meet something shaken."""
    record.write_text("\n".join(met), encoding="utf-8")
    files = sorted({name.partition("::")[0] for name in met})
    found = outcome(files, ["--shake", str(seed), "--only", str(record)], {}, jobs)
    record.unlink()
    return found


def calculated(arithmetic: str, tests: list[str], jobs: int) -> dict[str, Any]:
    """Run all tests with an arithmetic."""
    return outcome(tests, [], environment_of(arithmetic), jobs)


def main(session: Session) -> int:
    """Run what is not finished yet."""
    session.parser.add_argument(
        "--tests", nargs="+", default=list(TESTS), help="files or folders of tests"
    )
    args = session.parse(shakes=10, arithmetics=list(ARITHMETICS))
    jobs = session.jobs or os.cpu_count() or 1
    record = (session.folder / "met.txt").resolve()
    runs: dict[str, dict[str, Any]] = {}

    def note(name: str, found: dict[str, Any]) -> None:
        runs[name] = {key: value for key, value in found.items() if key != "met"}
        print(
            f"{name}: {found['tests']} tests, {len(found['failed'])} failed",
            *found["failed"],
            sep="\n    ",
            flush=True,
        )
        session.write({"first_met": len(first["met"]), "runs": runs})

    (first,) = session.outcomes(first_shake, {f"shake-{FIRST}": (args.tests, jobs, record)}, 1)
    note(f"shake-{FIRST}", first)
    parts: dict[str, tuple[Any, ...]] = {
        f"arithmetic-{name}": (name, args.tests, jobs) for name in args.arithmetics
    }
    for name, found in zip(parts, session.outcomes(calculated, parts, 1), strict=True):
        note(name, found)
    shakes = {
        f"shake-{seed}": (seed, first["met"], jobs, record)
        for seed in range(FIRST + 1, FIRST + args.shakes)
    }
    if shakes and first["met"]:
        for name, found in zip(shakes, session.outcomes(shake, shakes, 1), strict=True):
            note(name, found)
    return 1 if any(run["failed"] for run in runs.values()) else 0
