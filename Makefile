# Two commands on a bare Debian machine: `make run` and `make test`. Everything else is for those who develop hapticd.
SHELL := /bin/bash
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
export PYTHONUNBUFFERED := 1

.PHONY: run test lint types layers bench docs clean help

help:            ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## */\t/' | expand -t 12

run: $(STAMP)    ## the daemon on the simulated RE35/Copley testbed, in real time
	$(BIN)/hapticd run

test: $(STAMP) lint types layers   ## every check and test that needs no special machine
	$(BIN)/python -m pytest

lint: $(STAMP)   ## ruff
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)  ## mypy, strict
	$(BIN)/mypy

layers: $(STAMP) ## import-linter: the rooms, and which way imports go
	$(BIN)/lint-imports

bench: $(STAMP)  ## all benchmarks: a table each, JSON in benchmarks/results/
	$(BIN)/python -m benchmarks

docs: $(STAMP)   ## reference pages and figures that are made from the code
	$(BIN)/python -m hapticd.config.reference > docs/reference/config.md
	$(BIN)/python docs/make_figures.py

clean:           ## forget the virtual environment and every cache
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

$(STAMP): pyproject.toml constraints.txt install.sh
	PYTHON=$(PYTHON) ./install.sh $(VENV)
	touch $@
