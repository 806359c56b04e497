# The front door. `make help` explains; everything else is in pipeline/.
#
# What a user writes is never executed: each variable below is taken as it stands (value), never expanded, and
# reaches Python through the environment, so neither make nor the shell nor Snakemake reads it. It counts only on
# the command line: what the environment calls TOKEN or MODEL may be a secret, and is no option of ours.
USER_VARIABLES := PROMPT NEGATIVE MODEL SEED SEEDS QUALITY JOB OUT THREADS PROFILE RUN SKETCH SIGMA_S MESH PARAM START STRENGTH REFINE TOKEN ONLY PROVIDER \
	IMAGES NAME CHECKPOINT STORAGE SHAPES GRADIENT PREDICTION UNLIT PIVOT SIZE_M FORMATS MINUTES VERIFY HOST PORT JOBS
$(foreach name,$(USER_VARIABLES),$(eval override $(name) := \
	$(if $(findstring command line,$(origin $(name))),$$(value $(name)))))
export $(USER_VARIABLES)
UNKNOWN := $(filter-out $(USER_VARIABLES) PYTHON IN_VENV,$(foreach name,$(.VARIABLES),$(if $(findstring command line,$(origin $(name))),$(name))))
# The word that is nearest to $(1) among $(2); what was written reaches the shell between single quotes.
nearest = $(shell $(PYTHON) -c 'import difflib, sys; word, *known = sys.argv[1:]; \
	print(*(sum((difflib.get_close_matches(w, known, 1) for w in (word, word.upper(), word.lower())), [])[:1]))' \
	'$(subst ','\'',$(1))' $(2) 2>/dev/null)
meant = $(if $(nearest),: did you mean $(nearest)?,; there are: $(2))
PYTHON ?= python3
$(if $(UNKNOWN),$(error $(firstword $(UNKNOWN)) is no variable of this project$(call meant,$(firstword $(UNKNOWN)),$(USER_VARIABLES))))

# The packages of one .venv load the code of one clone. Two clones that share it would run each other's.
INSTALLED_FOR := $(file <.venv/.runtime)
ifneq ($(filter-out $(CURDIR),$(INSTALLED_FOR)),)
ifneq ($(filter-out help clean-venv,$(MAKECMDGOALS)),)
$(error .venv is installed for the clone in $(INSTALLED_FOR), this one is $(CURDIR): make clean-venv, then the same again)
endif
endif

MAKEFLAGS += --no-print-directory
.DEFAULT_GOAL := help
TARGETS := help options run plan verify models doctor serve gallery sweep dist export bench learn-token default-model test \
	fuzz clean-venv
.PHONY: $(TARGETS)

IN_VENV := .venv/bin/python

help:
	@cat pipeline/help.txt

run: .venv/.runtime
	@$(IN_VENV) -m pipeline run

plan: .venv/.runtime
	@$(IN_VENV) -m pipeline plan

verify: .venv/.runtime
	@$(IN_VENV) -m pipeline verify

options: .venv/.runtime
	@$(IN_VENV) -m pipeline options

models: .venv/.runtime
	@$(IN_VENV) -m pipeline models

doctor: .venv/.runtime
	@$(IN_VENV) -m pipeline doctor

gallery: .venv/.runtime
	@$(IN_VENV) -m pipeline gallery

sweep: .venv/.runtime
	@$(IN_VENV) -m pipeline sweep

serve: .venv/.serve
	@$(IN_VENV) -m pipeline serve

dist: .venv/.runtime
	@$(IN_VENV) integrations/dist/make_dist.py

export: .venv/.dev
	@$(IN_VENV) -m export

bench: .venv/.dev
	@$(IN_VENV) -m benchmarks

learn-token: .venv/.dev
	@$(IN_VENV) -m export.everyday_objects.train.learn_token

# The bundled model from nothing: days of two cores; each step goes on where it was stopped.
default-model: .venv/.dev
	$(IN_VENV) -m export.everyday_objects.train.train_autoencoder build/everyday
	$(IN_VENV) -m export.everyday_objects.data.pictures build/everyday --shards 500
	$(IN_VENV) -m export.everyday_objects.data.pictures build/everyday --folder held_out_pictures --first 90000 --shards 1
	$(IN_VENV) -m export.everyday_objects.train.train_denoiser build/everyday --steps 100000 --half 800
	$(IN_VENV) -m export.everyday_objects.train.export_bundle build/everyday
	$(IN_VENV) -m export.everyday_objects.train.train_judge build/everyday --steps 4000
	ONLY=default-model $(IN_VENV) -m benchmarks

test: .venv/.dev
	$(IN_VENV) -m ruff check .
	$(IN_VENV) -m mypy
	$(IN_VENV) -m pytest -n 2 --dist loadfile --no-loadscope-reorder

fuzz: .venv/.dev
	@$(IN_VENV) -m tests.faults.fuzz

clean-venv:
	rm -rf .venv

# A stamp a set of packages: made again when pyproject.toml changes, and after an installation that did not end.
.venv/.runtime: export CLONE := $(CURDIR)
.venv/.runtime: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "error: $(PYTHON) is not Python 3.11 or newer: say PYTHON=python3.11" >&2; exit 2; }
	@echo "installing into .venv (first use: a few minutes)" >&2
	@test -x $(IN_VENV) || $(PYTHON) -m venv .venv
	@$(IN_VENV) -m pip install --quiet --editable . >&2
	@printf '%s\n' "$$CLONE" >$@

.venv/.serve: .venv/.runtime pyproject.toml
	@$(IN_VENV) -m pip install --quiet --editable '.[serve]' >&2
	@touch $@

.venv/.dev: .venv/.runtime pyproject.toml
	@# Most of it is never imported: Python compiles what is, when it is.
	@$(IN_VENV) -m pip install --quiet --no-compile --editable '.[dev,export,serve]' >&2
	@# For its file of CLIP's merges alone: its torchvision does not load beside the CPU build of torch.
	@$(IN_VENV) -m pip install --quiet --no-deps 'open_clip_torch>=3.3,<4' >&2
	@touch $@

# What is no target.
.DEFAULT:
	@echo 'error: $(subst ','\'',$@) is no target$(call meant,$@,$(TARGETS))' >&2; exit 2
