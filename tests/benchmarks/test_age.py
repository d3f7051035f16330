"""Which results are older than the code that they depend on."""

from __future__ import annotations

import pytest

from benchmarks.age import benchmark_of
from benchmarks.code import Code
from benchmarks.provenance import code_of, working_tree

FILES = {
    "benchmarks/speed.py": "from bricksrl.envs import make\nfrom bricksrl.quick import quick\n",
    "packages/bricksrl/src/bricksrl/envs/__init__.py": 'MAKE = "bricksrl.envs.make"\n',
    "packages/bricksrl/src/bricksrl/envs/make.py": "def make():\n    from brickhub import link\n",
    "packages/bricksrl/src/bricksrl/quick.py": '"""Quick."""\nquick = 1  # a number\n',
    "packages/brickhub/src/brickhub/link.py": "rate = 3\n",
    "packages/brickhub/src/brickhub/other.py": "rate = 4\n",
}


def digest(**changed: str) -> str:
    files = FILES | {path: text for path, text in changed.items() if text}
    return Code(files.get).digest("benchmarks.speed")


def test_what_a_benchmark_imports_counts_at_any_depth():
    found = Code(FILES.get).closure("benchmarks.speed")
    assert found == {
        "benchmarks.speed",
        "bricksrl.envs",
        "bricksrl.envs.make",
        "bricksrl.quick",
        "brickhub.link",
    }


@pytest.mark.parametrize(
    ("path", "text", "is_other"),
    [
        ("packages/brickhub/src/brickhub/link.py", "rate = 5\n", True),
        ("packages/brickhub/src/brickhub/other.py", "rate = 5\n", False),
        ("packages/bricksrl/src/bricksrl/quick.py", '"""Other words."""\n\nquick = 1\n', False),
        ("packages/bricksrl/src/bricksrl/quick.py", "quick = 2\n", True),
        ("benchmarks/session.py", "anything = 1\n", False),
    ],
)
def test_words_do_not_count_and_code_does(path, text, is_other):
    assert (digest(**{path: text}) != digest()) == is_other


def test_a_module_that_was_elsewhere_in_an_earlier_commit_is_found():
    moved = {
        "benchmarks/speed.py": "import bricksrl.quick\n",
        "src/bricksrl/quick.py": "quick = 1\n",
    }
    assert Code(moved.get).closure("benchmarks.speed") == {"benchmarks.speed", "bricksrl.quick"}


def test_results_say_the_code_that_they_were_measured_with():
    said = code_of("benchmarks.formatting")
    assert said["digest"] == working_tree().digest("benchmarks.formatting")
    assert said["day"].startswith("20")


@pytest.mark.parametrize(
    ("result", "benchmark"),
    [
        ("robots", "robots"),
        ("study_paper", "paper"),
        ("offline_default", "offline"),
        ("link_faults_real_second_stage", "link_faults"),
        ("learning", "learning"),
        ("of_nobody", None),
    ],
)
def test_results_and_variants_name_their_benchmark(result, benchmark):
    assert benchmark_of(result) == benchmark
