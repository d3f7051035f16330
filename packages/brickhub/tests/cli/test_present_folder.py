"""Files of strangers in the present folder."""

import subprocess
import sys

PROGRAM = """
import multiprocessing
import sys

from brickhub.cli import main

if __name__ == "__main__":
    sys.argv = ["brickhub", "--version"]
    try:
        main()
    except SystemExit:
        pass
    process = multiprocessing.get_context("spawn").Process(target=print, args=["spawned"])
    process.start()
    process.join()
"""


def test_processes_that_a_library_starts_do_not_run_what_lies_in_the_present_folder(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    here = tmp_path / "here"
    here.mkdir()
    (here / "signal.py").write_text("print('code of a stranger')\n")
    process = subprocess.run(
        [sys.executable, program], cwd=here, capture_output=True, text=True, check=True
    )
    assert process.stdout.splitlines()[1:] == ["spawned"], process.stderr
