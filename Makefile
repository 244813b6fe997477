# Everything from nothing: each target makes the virtual environment first if it is missing or out of date.
# Needs python3 (3.11 or newer), git and make.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
BENCHED := $(VENV)/.installed-bench
NAMES ?=
DEMO_OUTPUT := demo-output

# Compiled kernels are kept between processes: the command line's tests would otherwise compile them again and again.
export JAX_COMPILATION_CACHE_DIR ?= $(CURDIR)/build/jax-cache
export JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS ?= 0.1

.DEFAULT_GOAL := help
.PHONY: help install demo test lint format types docs bench clean

help: ## Show this list
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "tsplinejax needs Python 3.11 or newer, and $(PYTHON) is " + sys.version.split()[0] + "; try: make PYTHON=python3.12")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@

install: $(INSTALLED) ## Set up the virtual environment with everything a developer needs

demo: $(INSTALLED) ## Fit real surfaces; pictures and a model go to demo-output/
	$(BIN)/tsplinejax demo -o $(DEMO_OUTPUT)

test: $(INSTALLED) ## Run all tests
	$(BIN)/python -m pytest -n 2

lint: $(INSTALLED) ## Check style and formatting
	$(BIN)/ruff check
	$(BIN)/ruff format --check

format: $(INSTALLED) ## Mend what can be mended of style and formatting
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

types: $(INSTALLED) ## Check types
	$(BIN)/pyright

docs: $(INSTALLED) ## Build the documentation into build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

$(BENCHED): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[bench]"
	@# G+Smo has wheels for some platforms only; without one its rows say that it is not installed.
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check --only-binary :all: "pygismo>=26,<27"
	touch $@

bench: $(BENCHED) ## Run the benchmarks against the peers; NAMES="speed start" runs some of them
	$(BIN)/python bench/run.py $(NAMES); code=$$?; $(BIN)/python docs/make_tables.py; exit $$code

clean: ## Remove the virtual environment and everything generated
	rm -rf $(VENV) $(DEMO_OUTPUT) build dist .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
