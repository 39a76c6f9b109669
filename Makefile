# `make run` shows the bench at work, `make test` runs everything that the checks run.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PLUGINS := opcua plant sparkplug teds
PROJECTS := pyproject.toml constraints.txt $(PLUGINS:%=plugins/%/pyproject.toml)
# Compiled modules are kept even where the environment forbids it: otherwise every process compiles
# all that it imports, which takes three to six times as long as what it does.
export PYTHONDONTWRITEBYTECODE :=
# Two more than processors: tests wait for instruments for a quarter of their time.
WORKERS = $(shell $(PYTHON) -c 'import os; print((os.cpu_count() or 1) + 2)')

.PHONY: run plant test check unit nightly programs lint types contracts docs kernels pictures \
  tests other-processor clean clean-kernels

run: $(VENV)/.installed
	$(BIN)/torquebench demo

# Three simulated benches and a plant: the link is cut, and nothing is lost. VIEW=1 leaves the plant
# view open at the end.
plant: $(VENV)/.installed-plant
	@$(PYTHON) tests/programs.py postgres
	$(BIN)/python -m plugins.plant.example.demonstration $(if $(VIEW),--view)

# Types, documentation and contracts keep one processor busy each; who has done first leaves none
# idle. Kernels are compiled once: all workers of the tests would begin with that at the same time.
test: programs
	$(MAKE) lint
	$(MAKE) --jobs 2 types docs contracts kernels
	$(MAKE) tests

# The daily loop: what needs no browser, no server and no other program. Types keep one processor
# busy and the first tests the others.
check: $(VENV)/.installed-test
	$(MAKE) --jobs 4 lint types contracts unit

# Left to `make test`: a third of the processor time of tests/unit, for what changes seldom.
LATER := bench/test_new_description* cli/test_second_process* compensation/test_exports* \
  panel/test_panel_people* reducers/test_strangers* reducers/test_tare* reports/test_certificate* \
  station/test_backup* station/test_hostile* tables/test_table_files* twin/*
unit: $(VENV)/.installed-test
	$(BIN)/pytest -n auto --dist worksteal tests/unit -k "not postgresql" \
	  $(LATER:%=--ignore-glob='tests/unit/%')

# Campaigns, soak tests and demonstrations, and the numbers as on another processor.
nightly: programs
	$(BIN)/pytest -n auto --dist worksteal -m "nightly and not alone"
	$(BIN)/pytest -m "nightly and alone"
	$(BIN)/pytest -n auto --dist worksteal -m "hypothesis and not nightly" \
	  --hypothesis-profile nightly
	$(MAKE) other-processor

# The programs that the tests start (a browser, PostgreSQL, an MQTT broker, …): installed by apt
# where root may do that, named otherwise.
programs:
	@$(PYTHON) tests/programs.py

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed-test
	$(BIN)/mypy

contracts: $(VENV)/.installed-test
	$(BIN)/lint-imports

# The documentation site, in docs/_build/html; a broken link or reference is an error.
docs: $(VENV)/.installed-test
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --builder html docs docs/_build/html

kernels: $(VENV)/.installed-test
	$(BIN)/python -c 'from tests.system.prepared_commands import prepare; prepare()'

# Every picture of the documentation again: screenshots, the animated demo, drawings.
pictures: $(VENV)/.installed-test
	$(BIN)/python -m tests.pictures

# A test that failed beside others runs once more with nothing beside it: some hold a wall clock's
# time, which a busy machine doesn't. One that passes only alone is named as such, to be mended.
tests: $(VENV)/.installed-test
	$(BIN)/pytest -n $(WORKERS) --dist worksteal --durations 20 --durations-min 8 \
	  || { test $$? -eq 1 && echo "These failed beside others; alone:" \
	  && $(BIN)/pytest --last-failed --last-failed-no-failures none --exitfirst -v; }

# The numbers again as on another processor: NumPy, kernels and linear algebra without the vector
# instructions of this one. No result depends on the sign of a zero or on the last bit.
NUMERIC := signals uncertainty calibration reducers mechanics
other-processor: $(VENV)/.installed-test
	NPY_DISABLE_CPU_FEATURES="$$($(BIN)/python -c 'import numpy; \
	  print(*numpy.show_config("dicts")["SIMD Extensions"].get("found", []))')" \
	NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR=.pytest_cache/generic-kernels OPENBLAS_CORETYPE=Nehalem \
	$(BIN)/pytest -n auto --dist worksteal src/torquebench/compensation \
	  $(NUMERIC:%=src/torquebench/%) $(NUMERIC:%=tests/unit/%)

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(BIN)/python pyproject.toml constraints.txt
	@$(PYTHON) tests/packages.py $(BIN)/python --constraint constraints.txt --editable '.[panel]'
	touch $@

$(VENV)/.installed-test: $(BIN)/python $(PROJECTS)
	@$(PYTHON) tests/packages.py $(BIN)/python --constraint constraints.txt --editable '.[test]' \
	  $(PLUGINS:%=--editable 'plugins/%[test]')
	touch $@ $(VENV)/.installed

$(VENV)/.installed-plant: $(BIN)/python $(PROJECTS)
	@$(PYTHON) tests/packages.py $(BIN)/python --constraint constraints.txt --editable . \
	  --editable plugins/plant
	touch $@

# Numba's cache looks at a kernel's own file only: after a change to a function that a kernel in
# another file calls, `make clean-kernels`.
clean-kernels:
	find src \( -name '*.nbi' -o -name '*.nbc' \) -delete

clean: clean-kernels
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
