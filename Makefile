.DEFAULT_GOAL := help
VENV ?= .venv
BIN := $(VENV)/bin
SHELL := /bin/sh
export NO_COLOR

.PHONY: help demo test test-fast test-matrix coverage lint format bench bench-model docs site bags warmup clean

help:  ## what can be made
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(VENV)/.ready: setup.py tools/make_venv.sh
	@tools/make_venv.sh $(VENV) dev

demo: $(VENV)/.ready  ## replay the sample bag through the nodes; leaves demo_out/index.html
	@$(BIN)/python demo/run_demo.py --output demo_out

test: $(VENV)/.ready  ## all tests
	$(BIN)/python -m pytest -n 2 --dist loadgroup

test-fast: $(VENV)/.ready  ## tests without the slow ones and the process graph
	$(BIN)/python -m pytest -n 2 -m "not slow and not graph"

test-matrix: $(VENV)/.ready  ## the quick tests on every Python that is there (3.10 to 3.13; 3.14 resolved at least)
	$(BIN)/python tools/test_matrix.py

coverage: $(VENV)/.ready  ## branch coverage of all tests, started processes included; fails under the floor (TESTS=... for a part)
	$(BIN)/python -m coverage erase
	$(BIN)/python -m coverage run -m pytest -n 2 --dist loadgroup $(TESTS)
	$(BIN)/python -m coverage combine -q
	$(BIN)/python -m coverage report $(if $(TESTS),--fail-under=0)

lint: $(VENV)/.ready  ## ruff and mypy --strict
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(VENV)/.ready  ## let ruff format the code
	$(BIN)/ruff format .

bench: $(VENV)/.ready  ## all benchmarks; leaves bench_out/
	$(BIN)/python test/benchmark/run_all.py --output bench_out

bench-model: $(VENV)/.ready  ## trajectories and surfaces of simulated dives against the truth
	$(BIN)/python test/benchmark/dive_model.py
	$(BIN)/python test/benchmark/dive_surface.py

docs: $(VENV)/.ready  ## write config/PARAMETERS.md, default.yaml, docs/topics.md and security/policy.xml from the code
	$(BIN)/python tools/write_parameters.py
	$(BIN)/python tools/write_topics.py
	$(BIN)/python tools/write_policy.py

site: $(VENV)/.ready  ## the documents as pages to read in a browser: site/index.html, strict and offline
	$(BIN)/python -m sphinx -q -E -W --keep-going -b html -d site/.cache docs site

bags: $(VENV)/.ready  ## make the sample bags anew
	$(BIN)/python bags/make_bags.py

warmup: $(VENV)/.ready  ## compile the kernels now rather than at the first call
	$(BIN)/uw_recon warmup

clean:  ## remove what was made, the virtual environment included
	rm -rf $(VENV) .matrix .coverage .coverage.* demo_out bench_out site docs/_generated build install log dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
