# graphnav: needs python3 (3.11 or later) and make, nothing else.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
STAMP = $(VENV)/.installed
SEED ?= 1

.PHONY: help install demo test lint format clean

help: ## what there is
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

install: $(STAMP) ## virtual environment with graphnav in it

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "graphnav needs Python 3.11 or later; try make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

demo: $(STAMP) ## simulate a tracked vehicle and smooth it
	$(BIN)/graphnav simulate tracked --out demo --seed $(SEED) --duration 900
	$(BIN)/graphnav smooth demo/run.csv.gz --truth demo/truth.csv.gz --report
	@echo
	@echo "Look at it:   $(BIN)/graphnav show demo/run_graphnav"
	@echo "or open       demo/run_graphnav/report.html"
	@echo "compare:      $(BIN)/graphnav compare demo/run_graphnav demo/truth.csv.gz"

test: $(STAMP) ## all tests
	$(BIN)/python -m pytest

lint: $(STAMP) ## style, types, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(STAMP) ## let ruff do it
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean: ## remove the environment and the demo
	rm -rf $(VENV) demo .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist
