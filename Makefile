# Soter: everything a person or CI runs. `make help` lists it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PY := $(BIN)/python
comma := ,
# where the machine has no C compiler, one comes as a Python package
ZIG := $(shell command -v cc >/dev/null 2>&1 || command -v gcc >/dev/null 2>&1 || command -v clang >/dev/null 2>&1 || echo ,compiler)
JOBS ?= $(shell nproc 2>/dev/null || echo 2)
LINTED := src tests bench examples release docs/site
# a file of tests stays on one worker, which proves and compiles once what they share; the long ones first
PARALLEL := -n $(JOBS) --dist loadfile --no-loadscope-reorder
# the packages' versions: those of requirements.lock, which were tried together, or the newest that pyproject.toml admits
VERSIONS ?= locked
PIP := $(PY) -m pip install --quiet --disable-pip-version-check
NEWEST = $(PIP) --upgrade --upgrade-strategy eager -e '.[$(1)$(ZIG)]'
LOCKED = $(PIP) -c requirements.lock -e '.[$(1)$(ZIG)]' || { \
  echo "soter: a version of requirements.lock cannot be had here (see above): the newest ones are installed"; $(NEWEST); }
INSTALL = $(if $(filter newest,$(VERSIONS)),$(NEWEST),$(LOCKED))
# tests that say which package of others they need
THIRD_PARTIES = $(shell grep -rl importorskip tests --include='test_*.py')

.PHONY: help setup demo test test-changed test-all test-rest test-real-time test-newest durations lint format soak playground docs proofs bench bench-quick bench-line figures vscode release clean
.DEFAULT_GOAL := help

help:  ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F':.*## ' '{printf "  make %-14s %s\n", $$1, $$2}'

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { echo "Soter needs Python 3.10 or newer: make PYTHON=python3.11 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV) || { $(PYTHON) -m pip install --user --quiet virtualenv && $(PYTHON) -m virtualenv --quiet $(VENV); }
	$(PIP) --upgrade pip

$(VENV)/.run: pyproject.toml requirements.lock | $(VENV)/bin/python
	$(call INSTALL,demo)
	@touch $@

$(VENV)/.dev: pyproject.toml requirements.lock | $(VENV)/bin/python
	$(call INSTALL,test$(comma)lint)
	@touch $@ $(VENV)/.run

setup: $(VENV)/.dev  ## make .venv with everything for running, testing and linting

demo: $(VENV)/.run  ## fly laps three ways and the whole mission, write the reports
	$(PY) examples/drone/demo.py

test: $(VENV)/.dev  ## the quick tests, before a commit; says how many it left out
	$(PY) -m pytest $(PARALLEL)

test-changed: $(VENV)/.dev  ## SINCE=main: quick tests of what has changed since that revision, HEAD unless said
	$(PY) -m pytest $(PARALLEL) --changed-since $(or $(SINCE),HEAD)

test-all: $(VENV)/.dev  ## every test but those of real time; BUT=long: not those marked so
	$(PY) -m pytest $(PARALLEL) --all $(if $(BUT),-m "not $(BUT)")

test-rest: $(VENV)/.dev  ## what `make test` leaves to `make test-all`, alone; BUT=long as there
	$(PY) -m pytest $(PARALLEL) --rest $(if $(BUT),-m "not $(BUT)")

test-real-time: $(VENV)/.dev  ## tests of real time on this machine, one after the other; a busy one may fail them
	$(PY) -m pytest -n 0 -m real_time

test-newest:  ## tests that touch packages of others, with the newest versions, in .venv-newest
	$(MAKE) --no-print-directory setup VENV=.venv-newest VERSIONS=newest
	@echo "newer than requirements.lock:" $$(.venv-newest/bin/python -m pip freeze --exclude-editable | tr A-Z_ a-z- | grep -vxFf requirements.lock)
	.venv-newest/bin/python -m pytest $(PARALLEL) $(THIRD_PARTIES)

durations: $(VENV)/.dev  ## measure every test: tests/durations.json, which decides what `make test` takes
	$(PY) -m pytest $(PARALLEL) --all --write-durations

soak: $(VENV)/.dev  ## N=600 seconds of random tests on fresh programs; what fails is told with its seed
	$(PY) tests/soak.py --seconds $(or $(N),600) --jobs $(JOBS)

lint: $(VENV)/.dev  ## formatter, linter, strict types, import layers, complexity, C format
	$(BIN)/ruff format --check $(LINTED)
	$(BIN)/ruff check $(LINTED)
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(PY) tests/unit/test_house_figures.py
	$(BIN)/clang-format --dry-run -Werror $(shell find src/soter -name templates -prune -o \( -name "*.[ch]" -o -name "*.hpp" \) -print)
	$(BIN)/soter fmt --check examples/*/*.soter src/soter/language/prelude/*.soter

format: $(VENV)/.dev  ## put Python and C into the one format
	$(BIN)/ruff format $(LINTED)
	$(BIN)/ruff check --fix-only $(LINTED)
	$(BIN)/clang-format -i $(shell find src/soter -name templates -prune -o \( -name "*.[ch]" -o -name "*.hpp" \) -print)
	$(BIN)/soter fmt examples/*/*.soter src/soter/language/prelude/*.soter

playground: $(VENV)/.run  ## build/playground/index.html: Soter in a browser, offline; needs npm
	$(PY) -m soter.playground -o build/playground --examples examples/wall

docs: $(VENV)/.dev  ## build/site: the docs, strictly, with a search and, where npm is there, a playground
	$(PY) docs/site/build_site.py -o build/site $(if $(shell command -v npm),,--no-playground)

proofs:  ## the theorem of docs/proof.md, checked by Coq (needs coqc), in build/proofs
	@mkdir -p build/proofs && cp proofs/*.v build/proofs
	cd build/proofs && for f in $$(grep '\.v$$' ../../proofs/_CoqProject); do coqc -q -Q . Soter $$f || exit 1; done

bench: $(VENV)/.dev  ## every figure of docs/benchmarks.md
	$(PY) bench/run_all.py

bench-quick: $(VENV)/.dev  ## 15 seconds: what people wait for, beside its targets; bench/quick.py --help
	$(PY) bench/quick.py

bench-line: $(VENV)/.dev  ## a line of docs/benchmarks/line.jsonl, to be committed with a change; 5 minutes
	$(PY) bench/line.py

figures: $(VENV)/.dev  ## every figure of docs/ made again, beside what the page says; hours. SMALL=1: quicker runs
	$(PY) bench/made_again.py --resume $(if $(SMALL),--small)

vscode:  ## the extension for VS Code, editors/vscode/dist/soter.vsix (needs npm)
	cd editors/vscode && npm ci --ignore-scripts --no-audit --no-fund && npm run --silent package

release: $(VENV)/.dev  ## build/release: archives, twice the same, tried in empty environments (docs/release.md)
	$(call INSTALL,release)
	$(PY) release/make_release.py

clean:  ## remove everything that was made
	rm -rf $(VENV) .venv-newest .soter build *.egg-info src/*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
