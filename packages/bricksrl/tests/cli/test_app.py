"""Help, version, and errors in one line."""

from __future__ import annotations

import dataclasses
import importlib
import os
import re
import shlex
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path

import pytest

import bricksrl as package
from brickhub.cli.app import parse
from bricksrl.cli import main
from bricksrl.cli.app import LINE, run

HUB_TOOLS = ("hub scan", "hub check", "hub latency", "hub calibrate", "hub stop")
COMMANDS = (
    "list",
    "train",
    "train-offline",
    "resume",
    "evaluate",
    "doctor",
    "hub",
    "hub program",
    "hub run",
    *HUB_TOOLS,
)
HEAVY = ("torch", "torchrl", "tensordict", "mujoco", "matplotlib", "scipy")


def test_version(bricksrl):
    done = bricksrl("--version")
    assert (done.returncode, done.stdout, done.stderr) == (
        0,
        f"bricksrl {package.__version__}\n",
        "",
    )


@pytest.mark.parametrize("columns", ["40", "80", "200"])
def test_lists_of_commands_end_no_line_in_mid_sentence(columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    for words in ([], *([group] for group in LINE.groups)):
        with pytest.raises(SystemExit):
            parse(LINE, [*words, "--help"])
        box = capsys.readouterr().out.rpartition("(required)")[2]
        text = " ".join(re.sub(r"[│╭╮╰╯─]", " ", box).split())
        said = [each.strip() for each in text.split("•")[1:]]
        assert said and all(each.endswith(".") for each in said), said


def test_help_imports_no_torch():
    script = (
        "import sys\n"
        "from bricksrl.cli import main\n"
        f"for command in ('', *{COMMANDS!r}):\n"
        "    try:\n"
        "        main([*command.split(), '--help'])\n"
        "    except SystemExit as end:\n"
        "        assert not end.code, end.code\n"
        f"    print('loaded by', command, *sorted(set(sys.modules) & set({HEAVY!r})))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    for command in ("", *COMMANDS):
        assert any(line.startswith(f"usage: bricksrl {command}".rstrip()) for line in lines)
        assert f"loaded by {command}".rstrip() in lines


COMMANDS_OF_WHAT_IS_MISSING = (
    "train missing.py",
    "train MyTask --from missing",
    "train RunAway-v0 --from missing",
    "train RunAway-v0 --base missing",
    "train RunAway-v0 --demonstrations missing",
    "train RunAway-v0 --settings missing.json",
    "train RunAway-v0 --physics missing.json",
    "train RunAway-v0 --agent missing.py",
    "train RunAway-v0 --transform missing.py",
    "train --resume missing",
    "train-offline RunAway-v0 --data missing",
    "resume missing",
    "team missing.py",
    "team --play missing",
    "tune missing.py",
    "tune RunAway-v0 --agent missing.py",
    "evaluate missing",
    "compare missing missing2",
    "play missing",
    "play runs/missing --page",
    "drive missing.py",
    "plot missing --out x.png",
    "export missing --out x.pt2",
    "record missing.py --out x",
    "record RunAway-v0 --policy missing --out x",
    "settings missing.py",
    "check missing.py",
    "data info missing",
    "data merge missing missing2 --out x",
    "data push missing me/x",
    "camera calibrate missing.py",
    "plan check missing.ldr",
    "plan show missing.ldr",
    "plan steps missing.ldr --out x.pdf",
    "twin fit missing",
    "twin measure missing.py --out x",
    "twin record walker --physics missing.json --out x",
    "hub run missing.py --robot walker",
    "hub run here.py --scene missing.py:MAT",
    "hub check missing.py",
)


def test_what_is_not_there_is_said_before_anything_slow_is_imported(tmp_path):
    """One process for all: what the first command imported, the others would have too."""
    (tmp_path / "here.py").write_text("pass\n")
    script = (
        "import sys\n"
        "from bricksrl.cli.app import run\n"
        f"for command in {COMMANDS_OF_WHAT_IS_MISSING!r}:\n"
        "    code = run(command.split())\n"
        f"    heavy = sorted(set(sys.modules) & set({HEAVY!r}))\n"
        "    print(command, code, *heavy, sep='|')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        cwd=tmp_path,
    )
    assert done.stdout.splitlines() == [f"{each}|2" for each in COMMANDS_OF_WHAT_IS_MISSING]
    said = done.stderr.splitlines()
    assert len(said) == len(COMMANDS_OF_WHAT_IS_MISSING) and all("missing" in each for each in said)
    assert [path.name for path in tmp_path.iterdir()] == ["here.py"]


def test_command_without_arguments_prints_help(bricksrl):
    alone, told = bricksrl(), bricksrl("--help")
    assert (alone.returncode, alone.stdout, alone.stderr) == (0, told.stdout, "")


@pytest.mark.parametrize("command", ["", "train", "hub", "hub scan"])
def test_help_is_a_command_too(command, bricksrl):
    told, asked = bricksrl("help", *command.split()), bricksrl(*command.split(), "--help")
    assert (told.returncode, told.stdout, told.stderr) == (0, asked.stdout, "")


def test_python_runs_the_package_as_the_command():
    done = subprocess.run(
        [sys.executable, "-m", "bricksrl", "--version"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, f"bricksrl {package.__version__}\n")


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
@pytest.mark.parametrize("command", ["--version", "--help"])
@pytest.mark.parametrize("output", ["| true", ">&-"])
def test_unread_output_ends_quietly(command, output):
    """A reader that has left, such as ``head``, and standard streams that are closed."""
    line = f"{shlex.quote(sys.executable)} -m bricksrl {command} {output}"
    done = subprocess.run(
        ["sh", "-c", line], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.stdout, done.stderr) == ("", "")


def test_second_ctrl_c_at_the_end_is_quiet():
    interrupted = "import atexit, signal; atexit.register(signal.raise_signal, signal.SIGINT); "
    program = f"{interrupted}from bricksrl.cli import main; raise SystemExit(main(['--version']))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_missing_docstrings_print_one_line():
    command = [sys.executable, "-OO", "-m", "bricksrl", "settings", "sac"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (
        (done.returncode, done.stdout) == (2, "")
        and "unset PYTHONOPTIMIZE" in done.stderr
        and done.stderr.count("\n") == 1
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("train RunAway-v0 --seeds nan", "--seeds is 'nan'; give a whole number"),
        ("train RunAway-v0 --seed x", "--seed is 'x'; give a whole number"),
        ("train RunAway-v0 --stop-at x", "--stop-at is 'x'; give a number"),
        ("camera calibrate RoboArm_mixed-v0 --at 1", "--at is '1'; give two whole numbers"),
        ("train RunAway-v0 --seed", "Missing value for argument '--seed'. Expected 1 values"),
        ("evaluate --run runs/spin", "run is no option; give it without --run"),
        ("train RunAway-v0 --jsn", "Unrecognized options: --jsn"),
        (
            "train RunAway-v0 --agnet sac",
            "Unrecognized options: --agnet, sac (did you mean --agent?)",
        ),
        (
            "train RunAway-v0 --robot ev3-driver",
            "Unrecognized options: --robot, ev3-driver (say --option robot=NAME)",
        ),
        ("compare runs/a --robot ev3-driver", "Unrecognized options: --robot, ev3-driver"),
        ("trian", "there is no command trian (did you mean 'train'?)"),
        ("hub scna", "there is no command scna (did you mean 'scan'?)"),
        ("camera", "a command is missing; choose calibrate"),
    ],
)
def test_wrong_arguments_have_plain_messages(fails, arguments, says):
    fails(*arguments.split(), says=f"error: {says}; see")


def test_file_whose_name_begins_like_an_option_is_no_option(fails, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-mine.ldr").touch()
    says = "error: -mine.ldr:walk looks like an option; for the file give ./-mine.ldr:walk"
    fails("learn", "-mine.ldr:walk", says=says)


@pytest.mark.parametrize(
    "environment",
    [{"PYTHONIOENCODING": "cp1252"}, {"PYTHONIOENCODING": "ascii"}, {"COLUMNS": "30"}],
)
def test_wrong_arguments_have_plain_messages_on_any_console(bricksrl, environment):
    done = bricksrl("train", "RunAway-v0", "--agnet", "sac", **environment)
    says = (
        "error: Unrecognized options: --agnet, sac (did you mean --agent?); see "
        "`bricksrl train --help`\n"
    )
    assert (done.returncode, done.stdout, done.stderr) == (2, "", says)


def test_help_names_every_command(bricksrl):
    done = bricksrl("--help")
    for command in ("list", "train", "train-offline", "resume", "evaluate", "hub"):
        assert f"• {command} " in done.stdout


def test_help_of_a_command_has_examples(capsys):
    for command in COMMANDS:
        if command != "hub":
            with pytest.raises(SystemExit):
                main([*command.split(), "--help"])
            assert f"\n  bricksrl {command}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("trian RunAway-v0", "trian"),
        ("train", "name an environment"),
        ("train RunAway-v0 --agnet sac", "--agnet"),
        ("train RunAway-v0 --seed x", "--seed"),
        ("train RunAway-v0 --hub telepathy", "telepathy"),
        ("train RunAway-v0 Spinning-v0", "Spinning-v0"),
        ("hub", "program, run"),
        ("hub run", "FILE"),
        ("evaluate", "RUN"),
        ("train RunAway-v0 --take-over x", "'x' for argument '--take-over'. Expected one of"),
        (
            "record RunAway-v0 --out a --take-over x",
            "Expected one of ('keyboard', 'gamepad', 'controller')",
        ),
        ("drive Spinning-v0 --with x", "Expected one of ('gamepad', 'controller')"),
        ("team Tag-v0 --agent x", "Expected one of ('mappo', 'ippo', 'sac')"),
        ("data keep a --out b --success maybe", "Expected one of ('yes', 'no')"),
        ("data remove a --out b --whole maybe", "Expected one of ('yes', 'no')"),
        ("data export a --out b --format parquet", "Expected one of ('minari', 'csv')"),
        ("train RunAway-v0 --frame-stack 0", "error: frame_stack is 0; give a whole number"),
        ("train RunAway-v0 --fault x", "error: 'x' is no fault; give one such as"),
        ("tune WalkerSim-v0 --steps 0", "error: steps is 0; give 1 or more"),
        ("data split a", "--rest DIR"),
    ],
)
def test_wrong_arguments_print_one_line(fails, arguments, says):
    fails(*arguments.split(), says=says)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("data split no --out a --rest b --share nan", "share is nan"),
        ("data split no --out a --rest b --share inf", "share is inf"),
        ("data split no --out a --rest b --share 80", "share is 80.0; give a number from 0 to 1"),
        ("data split no --out a --rest b --seed -1", "seed is -1"),
        ("record WalkerSim-v0 --out a --seed -1", "seed is -1"),
        ("tune WalkerSim-v0 --seed -1 --folder a", "seed is -1"),
        ("twin record two-wheeler --out a --steps 0", "steps is 0"),
        ("twin record two-wheeler --out a --seed -1", "seed is -1"),
        ("train WalkerSim-v0 --run a --seed -1", "seed is -1"),
        (
            "train WalkerSim-v0 --run a --seed 4294967295 --seeds 2",
            "seed is 4294967296; give a whole number from 0 to 4294967295",
        ),
        ("train-offline WalkerSim-v0 --data no --run a --seed -1", "seed is -1"),
        ("evaluate no --seed -1", "seed is -1"),
        ("train-offline WalkerSim-v0 --data no --updates 0", "updates is 0"),
        ("train WalkerSim-v0 --set target_entropy=nan --run a", "target_entropy is 'nan'"),
        ("train TD --set entropy=nan --run a", "no environment 'TD'"),
        (
            "train RoboArm-v0 --option threshold=5 --run a",
            "no option threshold (did you mean 'threshold_deg'?); its task has",
        ),
        (
            "train RunAway-v0 --option colour=red --run a",
            "no option colour; its task",
        ),
        (
            'train RoboArm-v0 --option threshold_deg="x" --run a',
            "is 'x'; give a number",
        ),
        (
            "train RoboArm-v0 --option threshold_deg=NaN --run a",
            "is nan; give a number",
        ),
        ("tune WalkerSim-v0 --folder a --on slurm", "no 'slurm' to run on"),
        ("train WalkerSim-v0 --run a --seeds 2 --on slurm", "no 'slurm' to run on"),
        ("train WalkerSim-v0 --run a --stop-at nan", "stop_at is not a finite number"),
        ("train WalkerSim-v0 --run a --seeds 2 --stop-at inf", "stop_at is not a finite number"),
        ("doctor --timeout-s nan", "timeout-s is nan"),
        ("doctor --timeout-s inf", "timeout-s is inf"),
        ("twin record two-wheeler --out .", "is a folder"),
        ("twin record two-wheeler --out a --hub telepathy", "telepathy"),
        ("twin record two-wheeler --out a --hub ble --physics main.py", "its own physics"),
        ("twin record two-wheeler --out a --hub ble", "give --yes"),
        ("hub run main.py --time-limit-s nan", "time limit is nan"),
        ("hub run main.py --time-limit-s inf", "time limit is inf"),
        ("hub run main.py --time-limit-s -1", "time limit is -1"),
        ("hub run other.py", "(No such file or directory)"),
        ("twin fit other.jsonl", "(No such file or directory)"),
        (
            "record RunAway-v0 --out a --physics other.json",
            "other.json (No such file or directory)",
        ),
    ],
)
def test_invalid_values_print_one_line(arguments, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "main.py").write_text("print(1)")
    assert run(shlex.split(arguments, posix=False)) == 2
    told = capsys.readouterr()
    assert told.out == "" and told.err.count("\n") == 1 and says in told.err
    assert [path.name for path in tmp_path.iterdir()] == ["main.py"], "nothing was made"


@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        ("train RunAway-v0 --agnet sac", "bricksrl train"),
        ("train RunAway-v0 --seed x", "bricksrl train"),
        ("evaluate runs/spin --episodes many", "bricksrl evaluate"),
        ("hub latency Walker-v1 --exchanges x", "bricksrl hub latency"),
        ("data split", "bricksrl data split"),
        ("hub scam", "bricksrl hub"),
        ("trian RunAway-v0", "bricksrl"),
    ],
)
def test_argument_error_names_help(fails, arguments, command):
    fails(*arguments.split(), says=f"; see `{command} --help`\n")


def test_closed_stdout_is_not_an_error():
    command = f"{sys.executable} -m bricksrl list --json | true"
    done = subprocess.run(  # noqa: S602
        command, shell=True, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stderr == ""


def test_missing_package_is_named(bricksrl, tmp_path: Path) -> None:
    """As of an installation that was broken off."""
    (tmp_path / "sitecustomize.py").write_text(
        "from importlib.machinery import PathFinder\n"
        "find = PathFinder.find_spec\n"
        "PathFinder.find_spec = lambda name, *rest: None if name.startswith('pyarrow') else "
        "find(name, *rest)\n"
    )
    done = bricksrl(
        "data",
        "info",
        str(tmp_path),
        PYTHONPATH=f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
    )
    told = (
        r"error: the package 'pyarrow' is missing in .*; install bricksrl there again, or "
        r"activate its environment\n"
    )
    assert done.returncode == 2 and re.fullmatch(told, done.stderr), done.stderr


def test_names_are_whole_in_a_narrow_terminal(bricksrl) -> None:
    told = bricksrl("list", COLUMNS="40").stdout
    assert "RoboArm_mixed-v0" in told and "LineFollow-v0" in told


def test_options_that_turn_something_off_say_so() -> None:
    """The parser puts no- before a flag that is on by default, and keeps its help."""
    places = [*LINE.commands.values()]
    for _, commands in LINE.groups.values():
        places += commands.values()
    off = {}
    for place in places:
        module, _, name = place.partition(":")
        off |= dict(flags_that_are_on(getattr(importlib.import_module(module), name)))
    assert {"film", "record"} <= off.keys()
    for name, text in off.items():
        assert text.startswith("Do not "), (name, text)


def flags_that_are_on(command: type) -> Iterator[tuple[str, str]]:
    """Flags of a command that are on by default, and their help."""
    hints = typing.get_type_hints(command, include_extras=True)
    for field in dataclasses.fields(command):
        if dataclasses.is_dataclass(field.default):
            yield from flags_that_are_on(type(field.default))
        if field.default is True:
            remarks = hints[field.name].__metadata__
            yield field.name, next(remark.help for remark in remarks if hasattr(remark, "help"))
