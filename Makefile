# Two commands matter: `make book` and `make test`. `make help` lists the rest.
# Another interpreter: make book PYTHON=python3.13        Another environment: make book VENV=/tmp/env

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
LOCKED := $(VENV)/.locked
STAMP := $(VENV)/.installed
SITE := _build/html
NOTEBOOKS := $(sort $(wildcard notebooks/*.ipynb))
WORKERS ?= 2
# One thread for each worker: two workers of two threads would only wait for one another.
PYTEST := OPENBLAS_NUM_THREADS=1 "$(BIN)/python" -m pytest -q -n $(WORKERS)

.DEFAULT_GOAL := help
.PHONY: help env book test lint types unit notebooks check-book lab notebook-outputs strip lock clean

help:  ## List the commands
	@grep -hE '^[a-z-]+:.*##' Makefile | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 26

env: $(STAMP)  ## Make the environment from the lock file (done by the others when needed)

$(LOCKED): requirements.lock
	@"$(PYTHON)" -c 'import sys; v = sys.version_info[:2]; sys.exit(v < (3, 11) and "Python 3.11 or newer is needed, this is %d.%d: make PYTHON=python3.12 ..." % v)'
	@echo "Installing the environment into $(VENV) (about a minute)"
	@"$(PYTHON)" -m venv --clear "$(VENV)"
	@"$(BIN)/python" -m pip install -qq --disable-pip-version-check --require-hashes -r requirements.lock
	@mkdir -p "$(VENV)/share/jupyter/lab/settings"
	@cp book/_tools/jupyterlab_overrides.json "$(VENV)/share/jupyter/lab/settings/overrides.json"
	@touch "$(LOCKED)"

$(STAMP): $(LOCKED) pyproject.toml
	@"$(BIN)/python" -m pip install -qq --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch "$(STAMP)"

book: $(STAMP)  ## Run the notebooks on the built-in data and build the site, warnings as errors
	@rm -rf "$(SITE)"
	"$(BIN)/jupyter-book" build . --all -W --keep-going
	@"$(BIN)/python" -c 'import pathlib; p = pathlib.Path("$(SITE)/index.html").resolve(); print("\nThe book is ready. Open", p, "or", p.as_uri(), sep="\n  ")'

test: lint unit notebooks  ## Lint, unit tests, every notebook

lint: $(STAMP)
	"$(BIN)/ruff" check .
	"$(BIN)/ruff" format --check .

types: $(STAMP)  ## Check the types
	"$(BIN)/mypy"

unit: $(STAMP)
	$(PYTEST) --dist loadfile -m "not browser" tests

notebooks: $(STAMP)
ifneq ($(NOTEBOOKS),)
	PFSLAM_WIDGETS=text $(PYTEST) --dist loadfile --nbval --nbval-sanitize-with tests/nbval_sanitize.cfg --nbval-cell-timeout 600 $(NOTEBOOKS)
endif

check-book: $(STAMP)  ## Check the built site: links, pages, and every widget in a real browser
	$(PYTEST) -m browser tests/browser

lab: $(STAMP)  ## Open the notebooks in JupyterLab
	"$(BIN)/jupyter-lab" --notebook-dir=notebooks

notebook-outputs: $(STAMP)  ## Run the notebooks in place and keep their text outputs (after a change of a chapter)
	PFSLAM_WIDGETS=text "$(BIN)/jupyter-nbconvert" --to notebook --execute --inplace $(NOTEBOOKS)
	"$(BIN)/python" -m pfslam.teaching.strip $(NOTEBOOKS)

strip: $(STAMP)  ## Remove pictures and widgets from the notebooks, keep text outputs
	"$(BIN)/python" -m pfslam.teaching.strip $(NOTEBOOKS)

lock:  ## Resolve requirements.in anew into requirements.lock (needs uv)
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-emit-index-url \
	  --no-emit-find-links --custom-compile-command "make lock" -q requirements.in -o requirements.lock

clean:  ## Remove everything that was built, the environment too
	rm -rf _build "$(VENV)" *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis out dist build
