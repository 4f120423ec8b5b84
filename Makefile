# `make help` lists the targets. Each makes the virtual environment first where it is missing or out of date.

PYTHON ?= python3
WORKERS ?= auto
# Another Python has an environment of its own: make test PYTHON=python3.13
VENV := $(if $(filter python3,$(PYTHON)),.venv,.venv-$(notdir $(PYTHON)))
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
INSTALLED := $(VENV)/.installed
DEVELOPERS := $(VENV)/.installed-developers
PEERS := $(VENV)/.installed-peers
# Of tests: which ones. Reordered by number of tests, files with one long test would come last.
TESTS ?= tests
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder
# Of `make front`: the machine.
PRESET ?= BUILDABLE
# Of a study: further options, as `python -m scripts.studies NAME --help` lists them.
ARGS ?=
STUDY := $(BIN)/python -m scripts.studies

.DEFAULT_GOAL := help
.PHONY: help install compare page test test-slow test-cpus peers test-peers fuzz lint format docs clean \
	bench feedback figures front returns study textbook thesis

help:
	@echo "make install     the virtual environment $(VENV), to walk, solve and train"
	@echo "make compare     learned against optimal gaits, into runs/compare: the main job"
	@echo "make page        one HTML file to pass on, into runs/page.html: the front, a wheel to drive"
	@echo "make test        lint, types and the fast tests (some minutes); TESTS=tests/agents some of them"
	@echo "make test PYTHON=python3.13    the same with another Python, in an environment of its own"
	@echo "make test-slow   the long tests"
	@echo "make test-cpus   the fast tests as other processors run them; CPUS=Haswell one of them"
	@echo "make test-peers  Drake, other people's learners, Minari, video wrappers; installs them"
	@echo "make fuzz        random machines, every step checked (some minutes)"
	@echo "make lint        ruff, layers and mypy alone;  make format: let ruff mend what it can"
	@echo "make docs        the documentation site, into runs/site; a warning is an error"
	@echo "make clean       remove $(VENV) and caches; results in runs/ stay"
	@echo "Studies, which fill the documents' tables; ARGS='--help' lists the options of one:"
	@echo "make study       every learner over ten seeds, into docs/learning.md and the README (hours)"
	@echo "make front       a machine's front searched anew and shipped; PRESET=..."
	@echo "make feedback    every feedback law measured, into docs/feedback.md (about 40 minutes)"
	@echo "make bench       speed, ours and the peers', into docs/benchmark.md (some minutes, alone)"
	@echo "make thesis | figures | returns | textbook"

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@echo "[1/3] virtual environment $(VENV) with $$($(PYTHON) --version)"
	@$(PYTHON) -m venv $(VENV)
	@echo "[2/3] dependencies at the tested versions (about 2 GB, a few minutes the first time)"
	@$(PIP) install -c constraints.txt -e ".[learn,video]"
	@echo "[3/3] ready: . $(BIN)/activate"
	@touch $@

$(DEVELOPERS): $(INSTALLED)
	@echo "what tests, documents and studies need, into $(VENV)"
	@$(PIP) install -c constraints.txt -e ".[test,video]"
	@touch $@

$(PEERS): $(DEVELOPERS)
	@echo "peers (Drake, rl-zoo3, TorchRL, RLlib, skrl, CleanRL, Brax, rejax) into $(VENV)"
	@$(PIP) install -c constraints.txt -e ".[test,peers]"
	@$(PIP) install -c constraints.txt --no-deps --ignore-requires-python cleanrl gymnax rejax
	@touch $@

compare: $(INSTALLED)
	$(BIN)/rimless compare --out runs/compare $(ARGS)

page: $(INSTALLED)
	$(BIN)/rimless page --out runs/page.html

lint: $(DEVELOPERS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache --no-logo
	$(BIN)/mypy rimless_gym trajopt agents scripts

format: $(DEVELOPERS)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Compiled by one process first: on Python 3.13 the process that compiles rounds otherwise than those that load.
test: lint
	$(BIN)/rimless warmup
	$(PYTEST) -m "not slow and not peers" $(TESTS)

test-slow: $(DEVELOPERS)
	$(PYTEST) -m "slow and not peers" $(TESTS)

test-cpus: $(DEVELOPERS)
	$(STUDY) processors $(CPUS) --pytest="-n $(WORKERS) --dist loadfile $(TESTS)"

peers: $(PEERS)

test-peers: peers
	$(PYTEST) -m peers $(TESTS)

fuzz: $(DEVELOPERS)
	$(BIN)/python -m pytest tests/rimless_gym/test_fuzz.py --hypothesis-profile fuzz $(ARGS)

docs: $(DEVELOPERS)
	$(BIN)/python -m sphinx --fail-on-warning --quiet docs runs/site
	@echo "open runs/site/index.html"

study: $(DEVELOPERS)
	$(STUDY) learning --docs docs/learning.md --headline README.md $(ARGS)

front: $(DEVELOPERS)
	$(STUDY) front --preset $(PRESET) $(ARGS)
	$(STUDY) strides --preset $(PRESET) $(ARGS)
	$(STUDY) rests --preset $(PRESET) $(ARGS)

feedback: $(DEVELOPERS)
	$(STUDY) feedback --docs docs/feedback.md $(ARGS)

bench: $(DEVELOPERS)
	$(STUDY) benchmark --out docs $(ARGS)
	$(STUDY) accelerator

returns: $(DEVELOPERS)
	$(STUDY) returns --docs docs/environment.md $(ARGS)

thesis: $(DEVELOPERS)
	$(STUDY) thesis --docs docs/thesis.md $(ARGS)

figures textbook: $(DEVELOPERS)
	$(STUDY) $@ $(ARGS)

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
