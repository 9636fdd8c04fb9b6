# Everything a newcomer needs: `make demo` and `make test`. Each target sets up .venv first when it is missing.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
PAGES  := $(VENV)/.pages

.DEFAULT_GOAL := help
.PHONY: help setup demo inputs test test-all lint bench robustness pictures docs clean

help:
	@echo "make demo      set up, rebuild the missing sherd of a broken vessel, name the files written"
	@echo "make inputs    one generated input for each command, into inputs/"
	@echo "make test      set up, run the tests"
	@echo "make test-all  the tests with the long ones"
	@echo "make lint      formatting, lint, types"
	@echo "make bench     benchmarks beside other programs, as tables and plots into docs/measured"
	@echo "make robustness  how many varied and damaged inputs pass, are refused, or come out wrong"
	@echo "make pictures  the pictures of the README and of the documentation"
	@echo "make docs      the documentation, into site/"

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

$(PAGES): $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev,docs]'
	@touch $@

setup: $(READY)

demo: $(READY)
	$(BIN)/recon demo

inputs: $(READY)
	$(BIN)/python docs/make_inputs.py

test: $(READY)
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal

test-all: $(READY)
	HYPOTHESIS_PROFILE=searching $(BIN)/python -m pytest --numprocesses auto --dist worksteal -m 'slow or not slow'

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(READY)
	$(BIN)/python benchmarks

robustness: $(READY)
	$(BIN)/python benchmarks robustness
	@for table in benchmarks/*_robustness.py benchmarks/damaged_inputs.py; do $(BIN)/python $$table || exit 1; echo; done

pictures: $(READY)
	$(BIN)/python docs/make_pictures.py

docs: $(PAGES)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

clean:
	rm -rf $(VENV) demo inputs site
