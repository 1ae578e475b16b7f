# make quick    the whole pipeline on a small design      (CORES=4 for four cores)
# make paper    the paper's study
# make published  the statistical half on the paper's own simulations, no simulator needed
# make smoke    every step once
# make hidden-effects   effects injected into synthetic hearts, criticised blind, and the score
# make test     lint, format, workflow lint, all tests
# make env      the environment (the targets above make it themselves)
# make test-wheel   installation from wheels and the physics tests in a bare Debian 13 (as root)
# make bench-simulator     what a simulation costs, beside cold load stepping
# make lint     the checks of `make test` without its tests
# make format   format the code, write the tables of config/README.md

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help env quick paper published smoke hidden-effects test test-wheel bench-simulator lint
.PHONY: format

CORES ?= 2
export CORES
export OMP_NUM_THREADS := 1
export PYTHONNOUSERSITE := 1
export PATH := $(CURDIR)/.venv/bin:$(PATH)

help:
	@sed -n 's/^# //p' Makefile

env:
	@envs/install.sh

quick: env
	snakemake --cores "$$CORES" --configfile config/quick.yaml
	snakemake --cores "$$CORES" --configfile config/quick.yaml --report results/quick/report.html

paper: env
	snakemake --cores "$$CORES"
	snakemake --cores "$$CORES" --report results/paper/report.html

published: env
	snakemake --cores "$$CORES" --configfile config/published.yaml
	snakemake --cores "$$CORES" --configfile config/published.yaml \
		--report results/published/report.html

smoke: env
	snakemake --cores "$$CORES" --configfile config/smoke.yaml

hidden-effects: env
	snakemake --cores "$$CORES" hidden_effects --configfile config/hidden_effects.yaml

test: lint
	pytest -n "$$CORES" --dist loadfile --no-loadscope-reorder

test-wheel:
	envs/test-wheel.sh

bench-simulator: env
	snakemake --cores "$$CORES" results/three_loads/mechanics/predictor.npz \
		--configfile config/config.yaml config/examples/three_loads.yaml
	PYTHONHASHSEED=0 python benchmarks/simulator.py config/config.yaml \
		config/examples/three_loads.yaml

lint: env
	ruff check .
	ruff format --check .
	snakemake --lint --configfile config/smoke.yaml

format: env
	ruff check --fix .
	ruff format .
	python -m regional_lv.config config/README.md
