# On a bare Debian machine: `make run` and `make test`, and `sudo make install` for the service. The rest is for those who
# develop hapticd.
SHELL := /bin/bash
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
export PYTHONUNBUFFERED := 1

.PHONY: run test attack test-old compiled compiled-daemon compiled-gap lint types jstypes layers bench soak dist audit versions docs site firmware firmware-test \
  firmware-fuzz install uninstall system-test clean help

help:            ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## */\t/' | expand -t 12

run: $(STAMP)    ## the daemon on the simulated RE35/Copley testbed, in real time
	$(BIN)/hapticd run

# Hundreds of processes start: none of them should have to read our source anew, whatever the shell says.
test: export PYTHONDONTWRITEBYTECODE :=
# Three processes on two cores, since some of the tests wait; the longer compilation begins before mypy.
test: $(STAMP)   ## every check and test that needs no special machine
	@$(MAKE) --no-print-directory -j2 --output-sync=target lint layers compiled-gap types jstypes compiled-daemon
	$(BIN)/python -m pytest -m 'not realtime and not avr and not attack' -n 3 --dist worksteal --durations=15
	$(BIN)/python -m pytest -m 'realtime and not attack' -n 2 --dist loadfile --durations=15

attack: compiled ## what tries to break the daemon, all of it; make test has a sample
	$(BIN)/python -m pytest -m attack -n 2 --dist worksteal --durations=15

test-old: $(STAMP)  ## the gap's tests without wide vectors and fused products, as an old x86-64 computes
	$(BIN)/python -m tests.old_processor

compiled: $(STAMP)   ## fill the compile caches of daemon, gap workflow and simulated hardware, side by side
	@$(MAKE) --no-print-directory -j2 compiled-daemon compiled-gap

compiled-daemon: $(STAMP)
	$(BIN)/python -m hapticd.service.precompile
	$(BIN)/python -c 'import tests.sim_hw.forked_device'

compiled-gap: $(STAMP)
	$(BIN)/python -c 'import hapticd.gap, hapticd.jit; hapticd.jit.compile_all()'

lint: $(STAMP)   ## ruff; do the installed packages agree with one another
	$(BIN)/python -m pip --disable-pip-version-check check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)  ## mypy, strict; of tests and benchmarks, does each call fit its function
	$(BIN)/mypy

TYPESCRIPT := 5.9.3
TSC := $(VENV)/node/node_modules/typescript/bin/tsc
jstypes: $(STAMP) $(TSC)  ## tsc over the scope's page, strict
	$(BIN)/node $(TSC) -p hapticd/scope/static/jsconfig.json

$(TSC): $(STAMP)
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/npm install --silent --no-audit --no-fund --prefix $(VENV)/node typescript@$(TYPESCRIPT)
	touch $@

layers: $(STAMP) ## import-linter: the rooms, and which way imports go
	$(BIN)/lint-imports

bench: $(STAMP)  ## all benchmarks: a table each, JSON in benchmarks/results/
	$(BIN)/python -m benchmarks

MINUTES ?= 60
soak: compiled   ## does memory stay, is every missed period counted: three daemons under load for an hour, or MINUTES=10
	MINUTES=$(MINUTES) $(BIN)/python -m pytest -m attack -s tests/soak

docs: $(STAMP)   ## reference pages and figures that are made from the code
	$(BIN)/python -m docs.make_pages
	$(BIN)/python -m hapticd.effects.pages docs/effects
	$(BIN)/python docs/figure_wiring.py
	PYTHONPATH=. $(BIN)/python docs/make_figures.py
	HAPTICD_PICTURES=docs/images $(BIN)/python -m pytest -q tests/scope/test_tutorial.py

site: $(STAMP)   ## the documentation as a web site in site/; a broken link or anchor is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

dist: $(STAMP)   ## wheel and sdist in dist/, and what is in them checked
	$(BIN)/python -m pytest tests/dist/check_dist.py

audit: $(STAMP)  ## known vulnerabilities of the pinned dependencies, as far as the package index at hand knows any
	$(BIN)/python -m tests.dist.audit

versions: $(STAMP)  ## the wheel on every Python that can be had, with the oldest and the newest packages; half an hour
	$(BIN)/python -m tests.dist.versions

firmware:        ## the serial DAC board's firmware for every board, with sizes and stack; installs compilers that are missing
	firmware/install.sh
	$(MAKE) --no-print-directory -C firmware/serial_dac
	$(PYTHON) firmware/serial_dac/report.py

firmware-test: $(STAMP)   ## the firmware as binaries in emulation, all boards: some ten minutes
	$(BIN)/python -m pytest tests/firmware

SECONDS ?= 600
firmware-fuzz:   ## coverage-guided fuzzing of the firmware's core, ten minutes, or SECONDS=60; installs clang
	firmware/install.sh fuzz
	$(MAKE) --no-print-directory -C firmware/serial_dac fuzz SECONDS=$(SECONDS)

install:         ## for the whole machine, as root: service, user, completions, manual pages
	systemd/install.sh install

uninstall:       ## take all of that away again, but configurations and recordings
	systemd/install.sh uninstall

system-test: $(STAMP)   ## a Debian guest with PREEMPT_RT, systemd and CAN under qemu; needs root
	$(BIN)/python tests/system/run.py

clean:           ## forget the virtual environment and every cache
	rm -rf $(VENV) build firmware/serial_dac/build dist site *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

$(STAMP): pyproject.toml constraints.txt install.sh
	PYTHON=$(PYTHON) ./install.sh $(VENV)
	touch $@
