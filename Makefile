# make install | compare | study | front | page | feedback | docs | test | test-slow | test-cpus | peers | test-peers | fuzz | bench | lint | format
# Every target makes the virtual environment first where it is missing or out of date.

PYTHON ?= python3
WORKERS ?= auto
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip -qq --disable-pip-version-check
INSTALLED := $(VENV)/.installed
PEERS := $(VENV)/.installed-peers
CHECKED := rimless_gym trajopt agents scripts
# Reordered by number of tests, files with one long test would come last, on one worker.
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder
# Of `make front`: the machine, and the budget of time in minutes.
PRESET ?= BUILDABLE
MINUTES ?= 120
# Of `make test-cpus`: which processors (see scripts/studies/processors.py; all by default), which tests.
CPUS ?=
TESTS ?= tests

.DEFAULT_GOAL := help
.PHONY: help install compare study front page feedback docs test test-slow test-cpus peers test-peers fuzz bench lint format clean

help:
	@echo "make install     the virtual environment $(VENV), tested versions of everything"
	@echo "make compare     learned against optimal gaits, into runs/compare: the main job"
	@echo "make study       every learner over ten seeds, into docs/learning.md and the README (hours)"
	@echo "make front       a machine's front searched anew and shipped; PRESET=..., MINUTES=120"
	@echo "make page        one HTML file to pass on, into runs/page.html: the front, a wheel to drive"
	@echo "make feedback    every feedback law measured, into docs/feedback.md (about 40 minutes)"
	@echo "make docs        the documentation site, into runs/site; a warning is an error"
	@echo "make test        lint, types and the fast tests (some minutes)"
	@echo "make test-slow   the long tests"
	@echo "make test-cpus   the fast tests as other processors run them (some minutes for each)"
	@echo "make peers       other people's software for test-peers, into $(VENV)"
	@echo "make test-peers  Drake, other people's learners, Minari, video wrappers; installs them"
	@echo "make fuzz        random machines, every step checked (some minutes)"
	@echo "make bench       speed, ours and the peers', into docs/benchmark.md (some minutes, alone)"
	@echo "make lint        ruff and mypy alone;  make format: let ruff mend what it can"
	@echo "make clean       remove $(VENV) and caches; results in runs/ stay"

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@echo "[1/3] virtual environment $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)
	@echo "[2/3] dependencies at the tested versions (about 2 GB, a few minutes the first time)"
	@$(PIP) install -c constraints.txt -e ".[test,video]"
	@echo "[3/3] ready: . $(BIN)/activate"
	@touch $@

$(PEERS): $(INSTALLED)
	@echo "peers (Drake, rl-zoo3, TorchRL, RLlib, skrl, CleanRL) into $(VENV)"
	@$(PIP) install -c constraints.txt -e ".[test,peers]"
	@$(PIP) install -c constraints.txt --no-deps --ignore-requires-python cleanrl
	@touch $@

compare: $(INSTALLED)
	$(BIN)/python scripts/compare.py --out runs/compare

study: $(INSTALLED)
	$(BIN)/python -m scripts.studies learning --docs docs/learning.md --headline README.md

front: $(INSTALLED)
	$(BIN)/python -m scripts.studies front --preset $(PRESET) --minutes $(MINUTES)

page: $(INSTALLED)
	$(BIN)/rimless page --out runs/page.html

feedback: $(INSTALLED)
	$(BIN)/python -m scripts.studies feedback --docs docs/feedback.md

docs: $(INSTALLED)
	$(BIN)/python -m sphinx --fail-on-warning --quiet docs runs/site
	@echo "open runs/site/index.html"

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache --no-logo
	$(BIN)/mypy $(CHECKED)

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

test: lint
	$(PYTEST) -m "not slow and not peers"

test-slow: $(INSTALLED)
	$(PYTEST) -m "slow and not peers"

test-cpus: $(INSTALLED)
	$(BIN)/python -m scripts.studies processors $(CPUS) --pytest "-n $(WORKERS) --dist loadfile $(TESTS)"

peers: $(PEERS)

test-peers: peers
	$(PYTEST) -m peers

fuzz: $(INSTALLED)
	$(BIN)/python -m pytest tests/rimless_gym/test_fuzz.py --hypothesis-profile fuzz $(FUZZ)

bench: $(INSTALLED)
	$(BIN)/python -m scripts.studies benchmark --out docs

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
