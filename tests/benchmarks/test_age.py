"""Which results are older than the code that they depend on."""

from __future__ import annotations

import pytest

from benchmarks.age import benchmark_of
from benchmarks.code import Code
from benchmarks.provenance import code_of, working_tree

PACKAGES = "packages/brickhub/src/brickhub"
FILES = {
    "benchmarks/speed.py": (
        "from bricksrl.envs import make\nfrom bricksrl.quick import quick\n\n\n"
        "def main():\n    return make(quick)\n"
    ),
    "packages/bricksrl/src/bricksrl/envs/__init__.py": 'MAKE = "bricksrl.envs.make"\n',
    "packages/bricksrl/src/bricksrl/envs/make.py": (
        "def make(rate):\n    from brickhub import link\n\n    return link.Link(rate).send()\n\n\n"
        "def never():\n    return 1\n"
    ),
    "packages/bricksrl/src/bricksrl/quick.py": '"""Quick."""\nquick = 1  # a number\n',
    f"{PACKAGES}/link.py": (
        "import radio\n\n\nclass Link:\n"
        "    def __init__(self, rate):\n        self.rate = rate\n\n"
        "    def send(self):\n        return self.rate\n\n"
        "    def receive(self):\n        return 0\n\n\n"
        "class Ear(radio.Ear):\n    def heard(self):\n        return 2\n\n\n"
        "EAR = radio.register(Ear)\n"
    ),
    f"{PACKAGES}/other.py": "rate = 4\n",
}


def code(files: dict[str, str]) -> Code:
    return Code(files.get, files)


def digest_with(**changed: str) -> str:
    return code(FILES | changed).digest("benchmarks.speed")


def test_what_a_benchmark_imports_is_looked_through_at_any_depth():
    assert code(FILES).closure("benchmarks.speed") == {
        "benchmarks.speed",
        "bricksrl.envs",
        "bricksrl.envs.make",
        "bricksrl.quick",
        "brickhub.link",
    }


@pytest.mark.parametrize(
    ("path", "old", "new", "is_other"),
    [
        (f"{PACKAGES}/other.py", "4", "5", False),
        ("packages/bricksrl/src/bricksrl/quick.py", "Quick.", "Other words.", False),
        ("packages/bricksrl/src/bricksrl/quick.py", "a number", "another word", False),
        ("packages/bricksrl/src/bricksrl/quick.py", "= 1", "= 2", True),
        ("packages/bricksrl/src/bricksrl/envs/make.py", "send()", "send() + 1", True),
        # What nobody mentions is never called.
        ("packages/bricksrl/src/bricksrl/envs/make.py", "return 1", "return 2", False),
        (f"{PACKAGES}/link.py", "return 0", "return 1", False),
        # A special method is called without its name.
        (f"{PACKAGES}/link.py", "self.rate = rate", "self.rate = -rate", True),
        (f"{PACKAGES}/link.py", "return self.rate", "return -self.rate", True),
        # Nobody mentions EAR, so that the class that it holds is never called.
        (f"{PACKAGES}/link.py", "return 2", "return 3", False),
    ],
)
def test_words_do_not_count_and_what_can_be_reached_does(path, old, new, is_other):
    assert old in FILES[path]
    is_changed = digest_with(**{path: FILES[path].replace(old, new)}) != digest_with()
    assert is_changed == is_other


@pytest.mark.parametrize(
    ("text", "is_other"),
    [
        ("link.EAR", True),
        ("link.Ear()", True),
        ("link.Link", False),
        ('getattr(link, "EAR")', True),
    ],
)
def test_a_library_calls_any_method_of_a_class_that_it_is_given(text, is_other):
    """It is the base's: ``radio`` is none of our modules."""
    make = "packages/bricksrl/src/bricksrl/envs/make.py"
    files = FILES | {make: FILES[make].replace("link.Link(rate)", f"{text}, link.Link(rate)")}
    path = f"{PACKAGES}/link.py"
    changed = files | {path: files[path].replace("return 2", "return 3")}
    digests = {code(one).digest("benchmarks.speed") for one in (files, changed)}
    assert (len(digests) == 2) == is_other


@pytest.mark.parametrize(
    ("importing", "changed", "is_other"),
    [
        ('import_module(f"brickhub.agents.{name}")', "agents/fast", True),
        ('import_module(f"brickhub.agents.{name}")', "agents/deep/slow", True),
        ('import_module(f"brickhub.agents.{name}")', "agents/unnamed", False),
        ('files(f"{__package__}.onboard")', "onboard/loop", True),
        ('files("brickhub")', "onboard/loop", False),
    ],
)
def test_modules_by_a_name_that_is_made_and_programs_for_the_hub_count(
    importing, changed, is_other
):
    files = {
        "benchmarks/speed.py": "from brickhub import agents\n\nagents.made\n",
        f"{PACKAGES}/__init__.py": "",
        f"{PACKAGES}/agents/__init__.py": "from brickhub.loading import made\n",
        f"{PACKAGES}/loading.py": (
            'NAMES = ("fast", "deep.slow")\n\n\n'
            f"def made(name=NAMES[0]):\n    return {importing}.build()\n"
        ),
        f"{PACKAGES}/agents/fast.py": "def build():\n    return 1\n",
        f"{PACKAGES}/agents/unnamed.py": "def build():\n    return 1\n",
        f"{PACKAGES}/agents/deep/__init__.py": "",
        f"{PACKAGES}/agents/deep/slow.py": "def build():\n    return 1\n",
        f"{PACKAGES}/onboard/__init__.py": "",
        f"{PACKAGES}/onboard/loop.py": "def serve():\n    return 1\n",
    }
    path = f"{PACKAGES}/{changed}.py"
    other = files | {path: files[path].replace("1", "2")}
    digests = {code(one).digest("benchmarks.speed") for one in (files, other)}
    assert (len(digests) == 2) == is_other


def test_what_starts_benchmarks_does_not_count():
    assert digest_with(**{"benchmarks/session.py": "anything = 1\n"}) == digest_with()


def test_a_module_that_was_elsewhere_in_an_earlier_commit_is_found():
    moved = {
        "benchmarks/speed.py": "import bricksrl.quick\n",
        "src/bricksrl/quick.py": "quick = 1\n",
    }
    assert code(moved).closure("benchmarks.speed") == {"benchmarks.speed", "bricksrl.quick"}


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
