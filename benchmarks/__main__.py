"""Command line of the benchmarks.

python -m benchmarks                       # list them, and how long they take
python -m benchmarks NAME [--quick] ...    # run one, or go on where it was interrupted
python -m benchmarks tables [--check]      # write, or compare, the tables of the documentation
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module

from benchmarks.registry import BENCHMARKS, GROUPS, IS_WHOLE
from benchmarks.session import Benchmark, Session, duration, read_result, write_result
from brickhub.cli.terminal import Interrupted, print_error, print_line, print_note
from brickhub.errors import BricksError, UnknownNameError, hint


def run(words: Sequence[str]) -> int:
    """Run a benchmark, or list all; returns the exit code. Raises Interrupted after Ctrl-C."""
    if not words or words[0] in ("-h", "--help"):
        print_line(
            f"{(__doc__ or '').strip()}\n\n"
            "They take so long on two cores, in full and with --quick:"
        )
        for group, benchmarks in GROUPS.items():
            print_line(f"\n{group}")
            for one in benchmarks:
                times = f"{duration(one.minutes):>7} {duration(one.quick_minutes):>7}"
                print_line(f"  {f'{one.name} {one.needs}':34}{times}  {one.title}")
        return 0
    name, *rest = words
    if name not in BENCHMARKS:
        raise UnknownNameError(
            f"there is no benchmark '{name}'{hint(name, BENCHMARKS)}; choose "
            f"{', '.join(BENCHMARKS)}"
        )
    benchmark = BENCHMARKS[name]
    module = import_module(f"benchmarks.{benchmark.module}")
    session = Session(benchmark, module.__doc__ or "", rest)
    code = 0
    try:
        if session.shows_published():
            write_result(session.path(), read_result(session.published()))
            print_line(f"numbers  {session.path()}")
        else:
            code = module.main(session) or 0
    except KeyboardInterrupt:
        kept = f"what is finished is in {session.folder}; the same command goes on"
        raise Interrupted(kept if session.folder.exists() else "nothing was saved") from None
    if session.is_apart and IS_WHOLE:
        _write_page(benchmark, session)
    return code


def _write_page(benchmark: Benchmark, session: Session) -> None:
    """Write the tables of a result beside it, if it has any."""
    from benchmarks.tables import SECTIONS, section

    names = (
        []
        if session.is_quick
        else [name for name in benchmark.also if session.published(name).exists()]
    )
    if benchmark.name in SECTIONS and session.path().exists():
        results = {
            benchmark.name: read_result(session.path()),
            **{name: read_result(session.published(name)) for name in names},
        }
        path = session.path().with_suffix(".md")
        path.write_text(
            "\n".join(section(name, result) for name, result in results.items()), encoding="utf-8"
        )
        print_line(f"tables   {path}")


def main() -> int:
    """Run from the command line; an error becomes one line."""
    try:
        return run(sys.argv[1:])
    except Interrupted as end:
        print_note(f"interrupted: {end}")
        return 130
    except BricksError as error:
        print_error(str(error))
        return 2


if __name__ == "__main__":
    sys.exit(main())
