# make quick    geometry and strains to posteriors, criticism and pages   (CORES=4 for four cores)
# make study    the same with 300 simulations, four emulators and all checks of the inference
# make paper    the paper's study
# make published  the statistical half on the paper's own simulations, no simulator needed
# make smoke    every step once
# make hidden-effects   effects injected into synthetic hearts, criticised blind, and the score
# make heart-emulator   the emulator of any heart, which the package brings along (hours; goes on where it
#               was ended, and more simulations join those that there are)
# make test     lint, format, workflow lint, the documentation without warnings, tests of every kind
# make test-all   the same with all tests
# make test-fuzz    thousands of damaged inputs of each kind (EXAMPLES=2000)
# make env      the environment (the targets above make it themselves)
# make test-wheel   installation from wheels and the physics tests in a bare Debian 13 (as root)
# make test-faults  kills, full disks, damaged files and other faults while a study runs (as root)
# make test-slurm   the smoke study on a SLURM of one node, and the same without it (Debian 12, as root)
# make bench-simulator     what a simulation costs, beside cold load stepping
# make docs     the documentation, in docs/_build/html
# make docs-notebook   run docs/library.ipynb again and keep its outputs
# make lint     the checks of `make test` without its tests
# make format   format the code, write config/README.md and docs/inputs.md

SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help env quick study paper published smoke hidden-effects heart-emulator
.PHONY: test test-all test-faults test-fuzz test-slurm test-wheel
.PHONY: bench-simulator lint format docs docs-notebook

CORES ?= 2
export CORES
export OMP_NUM_THREADS := 1
export PYTHONNOUSERSITE := 1
# No process looks for modules in this folder.
export PYTHONSAFEPATH := 1
export PATH := $(CURDIR)/.venv/bin:$(PATH)

help:
	@sed -n 's/^# //p' Makefile

env:
	@envs/install.sh

quick: env
	snakemake --cores "$$CORES" --configfile config/quick.yaml
	snakemake --cores "$$CORES" --configfile config/quick.yaml --report results/quick/report.html

study: env
	snakemake --cores "$$CORES" --configfile config/study.yaml
	snakemake --cores "$$CORES" --configfile config/study.yaml --report results/study/report.html

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

heart-emulator: env
	snakemake --cores "$$CORES" heart_emulator --configfile config/heart_emulator.yaml
	cp results/heart_emulator/heart_emulator.pt.gz src/regional_lv/data/
	python -m regional_lv.hearts docs/heart_emulator.md

test: DEPTH := not test_all
test-all: DEPTH :=
test-all: export FUZZ_EXAMPLES := 20
test test-all:
	@envs/install.sh test
	@$(MAKE) --no-print-directory --jobs 2 --output-sync lint docs
	pytest -n "$$CORES" --dist loadfile --no-loadscope-reorder -m "$(DEPTH)"

EXAMPLES ?= 2000
test-fuzz: env
	FUZZ_EXAMPLES=$(EXAMPLES) pytest -n "$$CORES" tests/unit/test_hostile_input.py

test-faults: env
	@envs/install.sh test
	pytest tests/faults

test-wheel:
	envs/test-wheel.sh

test-slurm: env
	@envs/install.sh test
	envs/test-slurm.sh

bench-simulator: env
	snakemake --cores "$$CORES" results/three_loads/mechanics/predictor.npz \
		--configfile config/config.yaml config/examples/three_loads.yaml
	PYTHONHASHSEED=0 python benchmarks/simulator.py config/config.yaml \
		config/examples/three_loads.yaml

lint: env
	ruff check .
	ruff format --check .
	snakefmt --check Snakefile workflow
	mypy
	python tests/workflow/lint.py config/smoke.yaml

format: env
	ruff check --fix .
	ruff format .
	snakefmt Snakefile workflow
	python -m regional_lv.config config/README.md
	python -m regional_lv.inputs docs/inputs.md

# In an environment of its own: it needs neither the simulator nor the package.
.venv-docs/.stamp: envs/docs-requirements.txt
	python3 -m venv --clear .venv-docs
	.venv-docs/bin/python -m pip install --quiet --requirement envs/docs-requirements.txt
	touch .venv-docs/.stamp

docs: .venv-docs/.stamp
	.venv-docs/bin/sphinx-build -W --keep-going --builder html docs docs/_build/html

docs-notebook: env
	pip install --quiet --constraint envs/docs-requirements.txt ipykernel nbclient
	jupyter execute --inplace docs/library.ipynb
