# make demo | docs | test | check | wheels | format | booklets | clean. Each makes .venv by itself; PYTHON chooses the interpreter.
PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed
# The live page, where there is a screen to see it on.
PAGE := $(if $(DISPLAY)$(WAYLAND_DISPLAY)$(filter Darwin,$(shell uname -s)),--page)

# The three distributions of this workspace, and the test tools of all.
HOUSES := brickhub bricktwin bricksrl
WORKSPACE := --editable packages/brickhub --editable packages/bricktwin --editable 'packages/bricksrl[dev]'
# Where each run of pytest says what it has skipped.
SKIPS := build/skips
PYTEST := $(BIN)/python -m pytest --skips $(SKIPS)
# Else each process of the tests would rewrite their assertions again.
unexport PYTHONDONTWRITEBYTECODE
# Each process imports and collects everything: some ten seconds of CPU. `make test` has LIGHT beside them, so that there is
# one process more than cores, as many tests wait for a process or a socket.
WORKERS = $(shell $(BIN)/python -c 'import os; print(os.cpu_count() or 1)')
# A computer that is busy fails a test in a thousand: it is repeated, and named as RERUN at the end; `make test-shaken`
# repeats none. What pytest-timeout has ended is not repeated: it counts once for all repetitions, so that the next one
# could hang for ever.
REPEATED := --rerun-except 'from pytest-timeout'
FAST = --numprocesses $(WORKERS) -m 'not realtime and not slow' --reruns 1 $(REPEATED)
# They keep to a clock, wait most of the time, and come first where something else computes.
CLOCK := --numprocesses 2 -m 'realtime and not slow' --reruns 2 $(REPEATED)
BESIDE := nice -n 10
# The houses without torch, in one process.
LIGHT := packages/bricktwin/tests packages/brickhub/tests
# The longest first.
TESTS := packages/bricksrl/tests tests packages/bricktwin/tests packages/brickhub/tests plugins
CLOCKED = $(shell grep -rl mark.realtime $(TESTS) --include='test_*.py')

.PHONY: help extras demo docs test test-slow test-shaken check fast clocked light rest wheels format booklets clean $(HOUSES:%=test-%)

help:
	@echo "make demo    a Walker learns to walk on a virtual hub: films before and after, a report"
	@echo "make docs    the documentation site, into build/docs"
	@echo "make test    everything that has to pass: make check, then the tests; test-brickhub and so on: of one house alone"
	@echo "make test-slow  long evidence: trainings, thousands of random programs, every page of the documentation"
	@echo "make test-shaken  the tests with starts that are a little off, and with the arithmetic of other processors"
	@echo "make check   ruff, mypy, import-linter"
	@echo "make wheels  the three distributions, into dist/"
	@echo "make format  let ruff put the code in order"
	@echo "make booklets the building booklets of our robots, docs/plans/*.pdf"
	@echo "make clean   remove .venv, caches and build output (runs/ stays)"

$(INSTALLED): $(HOUSES:%=packages/%/pyproject.toml) constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("error: Python %d.%d is too old; make PYTHON=python3.11" % sys.version_info[:2] if sys.version_info < (3, 11) else 0)'
	@echo "Installing into .venv; the first time this takes some minutes."
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt $(WORKSPACE)
	@touch $@

# What tests need beside, and are skipped without: LEGO's package for its kits (BUSL-1.1).
extras: $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt legoeducation

demo: $(INSTALLED)
	$(BIN)/bricksrl train Walker-v1 --episodes 20 --seed 0 $(PAGE)

docs: $(INSTALLED)
	$(BIN)/python -m sphinx --fail-on-warning --keep-going -q -b html docs build/docs
	$(BIN)/bricktwin site --out build/docs/tab --policies docs/hub_programs || echo "The documentation has no robot in the tab."
	@echo "build/docs/index.html"

check: $(INSTALLED)
	$(BIN)/ruff check --quiet .
	$(BIN)/ruff format --check --quiet .
	$(BESIDE) $(BIN)/mypy
	$(BIN)/lint-imports --no-logo

test: export BRICKS_TESTS_CACHE := $(CURDIR)/build/tests-cache
test: $(INSTALLED)
	@rm -rf $(SKIPS) $(BRICKS_TESTS_CACHE)
	@code=0; $(MAKE) --jobs 2 light rest || code=$$?; \
	$(BIN)/python tests/plugins/skipped.py $(SKIPS) || code=$$?; exit $$code

fast: $(INSTALLED)
	$(BESIDE) $(PYTEST) $(FAST) $(TESTS)

light: $(INSTALLED)
	$(MAKE) fast WORKERS=1 TESTS='$(LIGHT)'

rest: $(INSTALLED)
	$(MAKE) --jobs 2 clocked check
	$(MAKE) fast TESTS='$(filter-out $(LIGHT),$(TESTS))'

clocked: $(INSTALLED)
	$(PYTEST) $(CLOCK) $(CLOCKED)

test-slow: $(INSTALLED)
	$(PYTEST) --numprocesses auto -m slow

test-shaken: $(INSTALLED)
	$(BIN)/python -m benchmarks shaken

$(HOUSES:%=test-%): test-%: $(INSTALLED)
	$(MAKE) clocked TESTS=packages/$*/tests
	$(MAKE) fast TESTS=packages/$*/tests

wheels: $(INSTALLED)
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist $(HOUSES:%=./packages/%)

format: $(INSTALLED)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

booklets: $(INSTALLED)
	mkdir -p docs/plans
	for robot in two-wheeler walker robo-arm ev3-driver; do $(BIN)/bricksrl plan steps $$robot --out docs/plans/$$(echo $$robot | tr - _).pdf || exit 1; done

clean:
	rm -rf .venv build dist packages/*/build packages/*/src/*.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find packages tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
