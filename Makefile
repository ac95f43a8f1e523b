# Two commands do everything on a machine with Python 3.11 or newer, make and root (or sudo):
#   make demo    set up, then verify the seven-channel breadboard
#   make test    set up, then run all tests
# What a target does is in its recipe; how the set-up is done is in scripts/setup.sh.

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup ready demo check test test-bare test-browser test-install test-kicad test-processors test-pythons test-simulators regress reproduce stress proof nightly fuzz torture boards docs notebooks schemas lint format bench lock build clean

PYTHON_IN_VENV := .venv/bin/python
JOBS ?= 2
# Each process takes a stretch of the list, so that the tests of a file share what one of them made.
SHARED := --dist worksteal
ARGS ?=
RELEASE ?=

# One thread a process: BLAS threads on top of parallel tests only fight over the cores.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
# Without stored bytecode every process would compile NumPy and SciPy anew, for seconds each.
unexport PYTHONDONTWRITEBYTECODE

help: ## list the targets (the default)
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-16s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## .venv from pinned versions, ngspice where missing; tries again what failed before
	@bash scripts/setup.sh dev --again

ready:
	@bash scripts/setup.sh dev

demo: ## set up what a user needs, then verify the seven-channel breadboard
	@bash scripts/setup.sh demo
	.venv/bin/taction verify scenes/paper-breadboard.toml

test: ready ## set up, then all tests; ARGS="-k deck -x" goes to pytest
	@bash scripts/gnucap.sh .venv/.gnucap-tried
	$(PYTHON_IN_VENV) -m pytest -n $(JOBS) $(SHARED) $(ARGS)

check: ready ## before each commit: lint, types and the tests of what changed, in under 90 s
	@$(PYTHON_IN_VENV) scripts/check.py $(ARGS)

test-bare: ## demo and all tests in a minimal Debian, made as root by mmdebstrap; nothing is installed there by hand
	@RELEASE=$(RELEASE) bash scripts/bare.sh $(if $(ARGS),"$(ARGS)")

test-browser: ready ## the reports in a headless Chromium, which is installed where missing
	@browser=$$(bash scripts/chromium.sh) && TACTION_BROWSER=$$browser $(PYTHON_IN_VENV) -m pytest -n $(JOBS) tests/browser $(ARGS)

test-install: ready ## wheel and sdist by pip and uv into empty environments
	TACTION_INSTALL=1 $(PYTHON_IN_VENV) -m pytest tests/install $(ARGS)

test-kicad: ready ## the KiCad projects in a real kicad-cli, which is installed where missing
	@kicad=$$(bash scripts/kicad.sh) && TACTION_KICAD=$$kicad $(PYTHON_IN_VENV) -m pytest tests/kicad $(ARGS)

test-processors: ready ## the numerical tests with every BLAS kernel that this processor executes
	bash scripts/processors.sh $(ARGS) -- -n $(JOBS)

test-pythons: ready ## stress catalogue, baseline, processes and files with the newest other Python, in .venv-VERSION, and old BLAS kernels; ARGS=--all runs all tests with every newer one
	JOBS=$(JOBS) bash scripts/pythons.sh $(ARGS) -n $(JOBS)

test-simulators: ready ## all shipped scenes with ngspice 39 (of Debian 12), and with the installed one by another solver and method; ARGS=--all for every combination
	$(PYTHON_IN_VENV) scripts/simulators.py --jobs $(JOBS) $$(bash scripts/older_ngspice.sh) $(ARGS)

regress: ready ## verify scenes/ against scenes/baseline.json; ARGS=--update accepts what changed
	.venv/bin/taction regress scenes/ --baseline scenes/baseline.json $(ARGS)

reproduce: ready ## every claim of the paper, whole: about 50 s of processor time
	.venv/bin/taction reproduce $(ARGS)

stress: ready ## the stiff and extreme cases as a table; ARGS="--report stress.html" writes a page
	.venv/bin/taction self stress --jobs $(JOBS) $(ARGS)

proof: ready ## outcomes and readings of scenes, decks, stress and coverage against stored ones; ARGS=--update stores them
	$(PYTHON_IN_VENV) scripts/proof.py $(ARGS)

# Debian's testing suite (forky) has the newest Python, which no registry of packages has.
NIGHTLY := processors pythons simulators stress random-scenes long-tests fuzz torture bare newer-debian newest-debian
nightly-processors: ; $(MAKE) test-processors ARGS=
nightly-pythons: ; $(MAKE) test-pythons ARGS=--all
nightly-simulators: ; $(MAKE) test-simulators ARGS=--all
nightly-random-scenes: ; TACTION_ROUNDING_SCALE=20 TACTION_RANDOM_CIRCUITS=3000 $(MAKE) test ARGS=tests/verification
nightly-long-tests: ; TACTION_NIGHTLY=yes $(MAKE) test ARGS="-m nightly"
nightly-stress nightly-fuzz nightly-torture: nightly-%: ; $(MAKE) $* ARGS=
nightly-bare: ; $(MAKE) test-bare ARGS="make TACTION_NIGHTLY=yes test-browser test-kicad test-install docs"
nightly-newer-debian: ; $(MAKE) test-bare RELEASE=trixie ARGS="make demo test"
nightly-newest-debian: ; $(MAKE) test-bare RELEASE=forky ARGS="make demo test"

nightly: ready ## what takes too long for every commit (some hours); ARGS=fuzz runs one step
	@red=; for step in $(or $(ARGS),$(NIGHTLY)); do \
		CI=true $(MAKE) nightly-$$step || red="$$red $$step"; \
	done; echo "nightly: red:$${red:- none}"; [ -z "$$red" ]

fuzz: ready ## INPUTS=2000 damaged inputs of every kind, others each time; ARGS="-k decks" draws some kinds
	TACTION_FUZZ=$(or $(INPUTS),2000) $(PYTHON_IN_VENV) -m pytest -n $(JOBS) $(SHARED) tests/fuzz $(ARGS)

torture: ready ## ROUNDS=2 of every kill and disaster of a study; others by SEED
	TACTION_TORTURE=$(or $(ROUNDS),1) TACTION_SEED=$(or $(SEED),0) $(PYTHON_IN_VENV) -m pytest -n $(JOBS) tests/torture $(ARGS)

boards: ready ## boards that commands write and that pass, each with 100 drawn ones in ngspice: 20 minutes; ARGS="-k op27"
	TACTION_NIGHTLY=yes $(PYTHON_IN_VENV) -m pytest -n $(JOBS) -m nightly tests/bench $(ARGS)

docs: ready ## the documentation into docs/_build/html: pages, pictures and reference; a warning is an error
	$(PYTHON_IN_VENV) -m sphinx -W --keep-going -q -b html docs docs/_build/html

notebooks: ready ## the lessons of the documentation as notebooks/*.ipynb, for Jupyter
	$(PYTHON_IN_VENV) -c "import sys; sys.path.insert(0, 'docs'); import generated; generated.write_notebooks(generated.ROOT / 'notebooks')"

schemas: ready ## docs/schemas: the schemas of all documents of --json, from their models
	$(PYTHON_IN_VENV) -c "import sys; sys.path.insert(0, 'docs'); import generated; generated.write_schemas()"

lint: ready ## ruff (rules and format) and mypy --strict
	$(PYTHON_IN_VENV) -m ruff check .
	$(PYTHON_IN_VENV) -m ruff format --check .
	$(PYTHON_IN_VENV) -m mypy

format: ready ## rewrite the sources as ruff wants them
	$(PYTHON_IN_VENV) -m ruff check --fix .
	$(PYTHON_IN_VENV) -m ruff format .

bench: ready ## docs/benchmarks.md in minutes; ARGS="--only check" prints a section
	$(PYTHON_IN_VENV) -m benchmarks $(ARGS)

# Every transitive package is pinned, as the oldest Python that we support resolves it.
LOCK = $(PYTHON_IN_VENV) -m uv pip compile --quiet --no-header --no-annotate --python-version 3.11 $(ARGS) pyproject.toml
lock: ready ## pin in requirements/*.txt what pyproject.toml asks for and is not pinned yet; ARGS=--upgrade takes the newest of all
	$(LOCK) -o requirements/runtime.txt
	echo "setuptools>=77" | $(LOCK) - --extra plot --extra report -c requirements/runtime.txt -o requirements/demo.txt
	$(LOCK) --extra dev -c requirements/demo.txt -o requirements/dev.txt

build: ready ## source archive, and the wheel made from it, into dist/
	rm -rf build
	$(PYTHON_IN_VENV) -m uv build --quiet --no-build-isolation --python $(PYTHON_IN_VENV) --out-dir dist .

clean: ## remove .venv, caches and build products; leaves ngspice alone
	rm -rf .venv .venv-* .ngspice-39 build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis fuzz-failures
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
