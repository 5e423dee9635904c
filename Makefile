# Every target sets itself up: a virtual environment in .venv, nothing outside it, no root.
# make demo · make test · make test-long · make coverage · make test-vcan · make quick · make check · make bench · make undeclared · make measured · make docs · make wheel · make install

PYTHON ?= python3
BIN    := .venv/bin
STAMP  := .venv/.installed
DEV    := .venv/.dev
DOCS   := .venv/.docs
WHEEL  := .venv/.wheel
DIST   ?= dist
NODE   := .venv/node
TOOLS  := $(NODE)/node_modules/.package-lock.json
VENDOR := hil/service/page/vendor
PAGE   := $(VENDOR)/uPlot.esm.js
NATIVE := device_emulator/native/libdevice.so.1 hil/running/native/libturn.so.1 hil/plugins/native/libplugin.so.1 estimator/core/libcore.so.1
NATIVE_SOURCES := $(wildcard device_emulator/native/*.[ch] hil/running/native/*.[ch] hil/plugins/native/*.[ch] hil/plugins/shipped/*/*.[ch] estimator/core/*.[ch] \
  estimator/core/*/*.py estimator/model/*.py estimator/effects/*.py device_emulator/effects/*.py \
  firmware/src/hil_spec.? firmware/src/hil_frame.? firmware/src/hil_crc32c.?)

.PHONY: help install demo test test-beside test-on-can test-long coverage test-vcan quick check bench undeclared measured docs wheel

help:
	@echo "make demo     close the loop in real time, trace what the model lacks, close it again with it"
	@echo "make test     every promise once"
	@echo "make test-long  the tests that it leaves out: whole traces, runs and campaigns, statistics"
	@echo "make test-vcan  the tests that need a CAN interface, in user-mode Linux where the kernel has no CAN"
	@echo "make coverage all tests again, and which lines they run"
	@echo "make quick    the tests of daily work"
	@echo "make check    lint, types (those of the page as well), import contracts"
	@echo "make bench    speed, each figure beside a peer in the same run, as one table, and into runs/bench.json"
	@echo "make undeclared  hundreds of emulated records with an effect nobody declared, traced; evaluation/results/undeclared.md"
	@echo "make docs     the pages of docs/ as a site, in site/; a broken link or a page without a menu entry fails"
	@echo "make wheel    a wheel for any Linux of this processor with glibc 2.17 or later, in dist/"
	@echo "make measured real records traced (DATA=folder), into runs/measured.json and evaluation/results"
	@echo "make install  the .venv that the others need (they do it themselves)"

install: $(NATIVE) $(DEV) $(PAGE)

demo: $(NATIVE)
	$(BIN)/hil demo

# Files side by side (a class of tests by itself), one more than there are processors, the longest first; beside
# them those on CAN, whose machine has one processor. Then what has to keep up with the wall clock, with nothing beside
# it: two files at a time, unless a file needs the machine to itself (tests/by_the_clock.py).
# `make test` and `make test-long` together run every test once.
BY_FILE := --dist loadscope --no-loadscope-reorder
BESIDE := -n $(shell expr $$(nproc) + 1) $(BY_FILE)
CAN_LOG := .venv/vcan.log

# Bytecode is kept, whatever the environment says, but not between the sources: without it pytest compiles every file of
# tests in each of its processes, and each process that a test starts all of the bench.
test test-long quick coverage: export PYTHONPYCACHEPREFIX := $(CURDIR)/.venv/pycache
test test-long quick coverage: export PYTHONDONTWRITEBYTECODE :=

test: $(NATIVE) $(DEV) $(PAGE)
	$(MAKE) --no-print-directory --jobs 2 test-beside test-on-can
	$(BIN)/python -m pytest -n 2 $(BY_FILE) -m "realtime and not long"

test-beside:
	$(BIN)/python -m pytest $(BESIDE) -m "not realtime and not long"

# Its output is shown when it has ended, not between the lines of the other.
test-on-can:
	@$(BIN)/python -m tests.vcan --quiet > $(CAN_LOG) 2>&1; code=$$?; cat $(CAN_LOG); exit $$code

test-long: $(NATIVE) $(DEV) $(PAGE)
	$(BIN)/python -m pytest $(BESIDE) -m "long and not realtime"
	$(BIN)/python -m pytest -n 2 $(BY_FILE) -m "long and realtime"

coverage: $(NATIVE) $(DEV) $(PAGE)
	$(BIN)/python -m pytest --cov --cov-report=term

test-vcan: $(NATIVE) $(DEV)
	$(BIN)/python -m tests.vcan --quiet

quick: $(NATIVE) $(DEV)
	$(BIN)/python -m pytest $(BESIDE) -m "not slow and not moderate and not realtime"

check: $(DEV) $(PAGE)
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/node $(NODE)/node_modules/typescript/bin/tsc
	$(BIN)/lint-imports --no-logo

bench: $(NATIVE) $(DEV)
	$(BIN)/python -m benchmarks --speed

undeclared: $(NATIVE) $(DEV)
	$(BIN)/python -m evaluation.undeclared

measured: $(NATIVE) $(DEV)
	$(BIN)/python -m evaluation.measured $(if $(DATA),--data $(DATA))

# Not --quiet: warnings that are not printed are not counted either.
docs: $(DOCS)
	NO_MKDOCS_2_WARNING=1 PATH=$(CURDIR)/$(BIN):$$PATH $(BIN)/mkdocs build --strict

# Compiled by zig, which knows old versions of glibc, from the source distribution: nothing in this folder changes.
wheel: $(WHEEL)
	CC="$(CURDIR)/$(BIN)/python -m ziglang cc -target $$(uname -m)-linux-gnu.2.17 -mcpu=baseline" \
	  $(BIN)/uv build --quiet --out-dir $(DIST)/raw .
	PATH=$(CURDIR)/$(BIN):$$PATH $(BIN)/auditwheel repair --plat manylinux_2_17_$$(uname -m) --wheel-dir $(DIST) \
	  $(DIST)/raw/gyrohil-*.whl
	@rm -r $(DIST)/raw

# By uv, a third of the time, which compiles the bench once; by pip where there is no uv, or where it cannot reach what
# pip is told of.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
INTO = $(BIN)/uv pip install --quiet --no-cache --python $(BIN)/python $(1) || $(PIP) $(2)
EXTRA = $(call INTO,-r pyproject.toml --extra $(1),--editable '.[$(1)]')
$(STAMP) $(DEV) $(DOCS) $(WHEEL): export PYTHONPYCACHEPREFIX :=

# Rebuilt when pyproject.toml changes. The checks come first: a .venv without pip would only be in the way.
$(STAMP): pyproject.toml
	@command -v $(PYTHON) >/dev/null || { echo "make: $(PYTHON) is missing: sudo apt install python3" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "make: Python 3.11 or newer is needed, $$($(PYTHON) -V) is too old: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null \
	  || { echo "make: the package python3-venv is missing: sudo apt install python3-venv" >&2; exit 1; }
	@echo "setting up .venv (about 1 GB the first time)"
	@$(PYTHON) -m venv .venv
	@$(PIP) 'uv<1' || true
	@$(call INTO,--editable .,--editable .)
	@touch $@

# What the installation compiled, again when its source changes.
$(NATIVE) &: $(NATIVE_SOURCES) compile_native.py | $(STAMP)
	@$(BIN)/python compile_native.py

# What tests, checks and campaigns need beside that.
$(DEV): $(STAMP)
	@echo "adding what tests and checks need (about 1 GB more)"
	@$(call EXTRA,dev)
	@touch $@

# What the site of documentation is built with.
$(DOCS): $(STAMP)
	@$(call EXTRA,docs)
	@touch $@

# What builds the wheel.
$(WHEEL): $(STAMP)
	@$(call EXTRA,wheel)
	@touch $@

# What the page of `hil serve` is drawn with, by the Node in the .venv, and what it is checked and tested with. The page
# loads nothing from elsewhere: what it needs stands beside it, and is packed into a wheel.
$(TOOLS): package.json package-lock.json .npmrc | $(DEV)
	@mkdir -p $(NODE)
	@cp package.json package-lock.json .npmrc $(NODE)
	@$(BIN)/npm ci --prefix $(NODE) --silent \
	  || { echo "make: npm cannot fetch what package-lock.json names; the rest works without: make demo" >&2; exit 1; }
	@touch $@

$(PAGE): $(TOOLS)
	@$(BIN)/python fetch_page.py $(NODE)/node_modules
