# Two commands: `make study` and `make test`; both set up .venv first. `make help` lists the rest.
SHELL := /bin/sh
.DEFAULT_GOAL := help
PYTHON := .venv/bin/python
EQUIGAP := $(PYTHON) -m studies.cli
QUICK := results/quick
JOBS ?= $(shell nproc)
WORKERS ?= 2
TESTS ?= tests
# cases run side by side, so each takes one thread
export OMP_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: help setup study generalise blind measured figures quick numbers docs test test-all coverage browser-test docker-test lint format clean

help: ## list the commands
	@sed -n 's/^\([a-z-]*\):.*## /  make \1\t/p' Makefile | expand -t 20

setup: ## set up .venv from requirements.lock (nothing else is installed)
	@.ci/setup

study: setup ## run the resolution and the thickness study at their default settings and name their reports
	$(EQUIGAP) resolution --jobs $(JOBS)
	$(EQUIGAP) thickness --jobs $(JOBS)

generalise: setup ## which specimens, invariants and sizes of network predict other specimens (an hour; resumes where it was)
	$(EQUIGAP) generalise --jobs $(JOBS)

blind: setup ## blind trials of the diagnosis (hours; resumes where it was)
	$(EQUIGAP) blind --jobs $(JOBS)

measured: setup ## what measured sheets and homogeneous tests do beyond hyperelasticity (EQUIGAP_DATA, or fetched)
	$(EQUIGAP) measured

figures: setup ## every figure and table of all studies, hours (SCALE=quick: minutes; SCALE=full: a day)
	$(EQUIGAP) figures --scale $(or $(SCALE),default) --jobs $(JOBS)

docker-test: ## build the container without a Docker engine and make its quick figures (root, buildah, debootstrap)
	docker/test

quick: setup ## everything at its smallest, a few minutes
	$(EQUIGAP) specimens --quick -o $(QUICK)/specimens
	$(EQUIGAP) simulate --quick -o $(QUICK)/simulate
	$(EQUIGAP) calibrate $(QUICK)/simulate/experiment.npz --quick -o $(QUICK)/calibrate
	$(EQUIGAP) discover $(QUICK)/simulate/experiment.npz --quick -o $(QUICK)/discover
	$(EQUIGAP) predict $(QUICK)/calibrate/model.json --against arruda_boyce -o $(QUICK)/predict
	$(EQUIGAP) supervised --quick --data arruda-boyce -o $(QUICK)/supervised
	$(EQUIGAP) design --quick -o $(QUICK)/design
	$(EQUIGAP) resolution --quick --jobs $(JOBS) --output $(QUICK)/resolution
	$(EQUIGAP) thickness --quick --jobs $(JOBS) --output $(QUICK)/thickness

numbers: setup ## put the numbers of docs/results into README and docs, the modules into the reference (a stale one fails a test)
	$(PYTHON) docs/derive_numbers.py
	$(PYTHON) docs/insert_numbers.py
	$(PYTHON) docs/reference_pages.py

docs: setup ## the documentation as pages in build/site; its examples are run, a warning is an error
	rm -rf build/tutorial
	$(PYTHON) docs/tutorial/run.py build/tutorial
	$(PYTHON) -m pytest tests/project/test_documentation.py
	$(PYTHON) -m mkdocs build --quiet --config-file .ci/mkdocs.yml

test: setup ## the test suite, without the slowest tests
	$(PYTHON) -m pytest -n $(WORKERS) --dist worksteal -m "not slow" $(TESTS)

test-all: setup ## every test
	$(PYTHON) -m pytest -n $(WORKERS) --dist worksteal $(TESTS)

coverage: setup ## lines and branches that no test reaches, in build/coverage-report (slower than `make test`)
	$(PYTHON) -m pytest -n $(WORKERS) --dist worksteal -m "not slow" --cov --cov-report=term --cov-report=html:build/coverage-report $(TESTS)

browser-test: setup ## reports in a real browser: headless Chromium, which has to be on the PATH
	$(PYTHON) -m pytest -n $(WORKERS) --dist loadfile tests/studies/reports/test_reports_in_a_browser.py

lint: setup ## style and types
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .
	$(PYTHON) -m mypy meshes forward calibrate studies

format: setup ## put the source into its style
	$(PYTHON) -m ruff check --fix .
	$(PYTHON) -m ruff format .

clean: ## remove .venv and caches; results/ is kept
	rm -rf .venv build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.git/*' -prune -exec rm -rf {} +
