# Two commands matter: `make book` and `make test`. `make help` lists more.
# Another interpreter: make book PYTHON=python3.13        Another environment: make book VENV=/tmp/env

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
LOCKED := $(VENV)/.locked
STAMP := $(VENV)/.installed
GRADER := $(VENV)/nbgrader
LITE := $(VENV)/lite
LOWEST := $(VENV)-lowest
SITE := _build/html
NOTEBOOKS := $(sort $(wildcard notebooks/*.ipynb))
WORKERS ?= 2
SEED ?= 1
FOLDER ?= copies
# One thread for each worker: two workers of two threads would only wait for one another.
PYTEST := OPENBLAS_NUM_THREADS=1 "$(BIN)/python" -m pytest -q -n $(WORKERS)
# Each worker imports all files that it is told of, and the runner of notebooks takes seconds to import.
UNIT := -p no:nbval --dist loadfile tests/test_*.py
USUAL := not nightly and not browser and not lab

.DEFAULT_GOAL := help
.PHONY: help env book test quick nightly lint types unit notebooks check-book check-lab lab bench studies
.PHONY: notebook-outputs strip copies student solutions exam grade wheel lite release smoke unlocked lowest lock clean

help:  ## List the commands
	@awk -F ':.*## ' '/^[a-z.-]+:.*## / { printf "  make %-17s %s\n", $$1, $$2 }' Makefile

env: $(STAMP)

$(LOCKED): requirements.lock
	@"$(PYTHON)" -c 'import sys; v = sys.version_info[:2]; sys.exit(v < (3, 11) and "Python 3.11 or newer is needed, this is %d.%d: make PYTHON=python3.12 ..." % v)'
	@echo "Installing the environment into $(VENV) (about a minute)"
	@"$(PYTHON)" -m venv --clear "$(VENV)"
	@"$(BIN)/python" -m pip install -qq --disable-pip-version-check --require-hashes -r requirements.lock
	@touch "$(LOCKED)"

$(STAMP): $(LOCKED) pyproject.toml book/_tools/jupyterlab_overrides.json
	@mkdir -p "$(VENV)/share/jupyter/lab/settings"
	@cp book/_tools/jupyterlab_overrides.json "$(VENV)/share/jupyter/lab/settings/overrides.json"
	@"$(BIN)/python" -m pip install -qq --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch "$(STAMP)"

# nbgrader would show its menus to every student in JupyterLab, so it lives in an environment of its own on top of this
# one. So does JupyterLite, which only `make lite` needs.
define ON_TOP
@"$(BIN)/python" -m venv --clear "$(1)"
@"$(1)/$(notdir $(BIN))/python" -m pip install -qq --disable-pip-version-check --no-deps --require-hashes -r $(filter %.lock,$^)
@"$(BIN)/python" -c 'import site; print("import site; site.addsitedir(" + repr(site.getsitepackages()[-1]) + ")")' \
  > "$$("$(1)/$(notdir $(BIN))/python" -c 'import site; print(site.getsitepackages()[-1])')/book.pth"
endef

$(GRADER): $(STAMP) tests/nbgrader.lock
	$(call ON_TOP,$(GRADER))
	@touch "$(GRADER)"

# What a browser's Python lacks comes along as wheels, in the versions of the lock file.
$(LITE)/.installed: $(STAMP) book/_tools/lite.py book/_tools/lite.lock
	$(call ON_TOP,$(LITE))
	@"$(BIN)/python" book/_tools/lite.py wheels > "$(LITE)/wheels.txt"
	@"$(BIN)/python" -m pip download -qq --disable-pip-version-check --no-deps --require-hashes --platform any \
	  -d "$(LITE)/wheels" -r "$(LITE)/wheels.txt"
	@touch "$@"

book: $(STAMP)  ## Run the notebooks on the built-in data and build the site, warnings as errors
	@rm -rf "$(SITE)"
	OPENBLAS_NUM_THREADS=1 "$(BIN)/jupyter-book" build . --all -W --keep-going
	@"$(BIN)/python" -c 'import pathlib; p = pathlib.Path("$(SITE)/index.html").resolve(); print("\nThe book is ready. Open", p, "or", p.as_uri(), sep="\n  ")'

test: lint unit notebooks  ## Lint, unit tests, every notebook

quick: lint  ## Lint and the fast unit tests: what to run after each edit
	$(PYTEST) -m "not slow and $(USUAL)" $(UNIT)

nightly: $(STAMP) $(GRADER)  ## What takes long: every page and laboratory, every chapter in JupyterLab, many seeds, a release
	@$(MAKE) book
	@$(MAKE) release
	PFSLAM_REQUIRE_BROWSER=1 $(PYTEST) --dist loadgroup -m nightly tests
	PFSLAM_CASES=2000 $(PYTEST) --dist load tests/test_bad_input.py tests/test_settings.py

bench: $(STAMP)  ## Speed and memory of whole runs on this machine
	OPENBLAS_NUM_THREADS=1 "$(BIN)/python" book/_tools/bench.py

lint: $(STAMP)
	"$(BIN)/ruff" check .
	"$(BIN)/ruff" format --check .

types: $(STAMP)  ## Check the types
	"$(BIN)/mypy"

unit: $(STAMP)
	$(PYTEST) -m "$(USUAL)" $(UNIT)

notebooks: $(STAMP)
	PFSLAM_WIDGETS=text $(PYTEST) --dist loadfile --nbval --nbval-sanitize-with tests/nbval_sanitize.cfg --nbval-cell-timeout 600 $(NOTEBOOKS)

studies: $(STAMP)  ## Run the stored studies where results are missing, and renew their tables (STUDY=name for one)
	OPENBLAS_NUM_THREADS=1 "$(BIN)/python" book/_tools/studies.py $(STUDY)

check-book: $(STAMP)  ## Look at the built site in a real browser: three kinds of page, each laboratory once
	$(PYTEST) --dist loadgroup -m "browser and not nightly" tests/browser

check-lab: $(STAMP)  ## Run two chapters in JupyterLab, in a real browser
	$(PYTEST) --dist load -m "lab and not nightly" tests/lab

lab: $(STAMP)  ## Open the chapters in JupyterLab
	"$(BIN)/jupyter-lab" --notebook-dir=. --LabApp.default_url=/lab/tree/$(firstword $(NOTEBOOKS))

notebook-outputs: $(STAMP)  ## Run the notebooks in place and keep their text outputs
	PFSLAM_WIDGETS=text "$(BIN)/jupyter-nbconvert" --to notebook --execute --inplace $(NOTEBOOKS)
	"$(BIN)/python" book/_tools/strip.py $(NOTEBOOKS)

strip: $(STAMP)  ## Remove pictures and widgets from the notebooks
	"$(BIN)/python" book/_tools/strip.py $(NOTEBOOKS)

copies: $(STAMP)
	@rm -rf _build/student _build/solutions
	@OPENBLAS_NUM_THREADS=1 PFSLAM_WIDGETS=text "$(BIN)/python" book/_tools/copies.py _build $(NOTEBOOKS)
	@cp book/_tools/STUDENTS.md _build/student/README.md
	@cp book/_tools/nbgrader_config.py _build/solutions/
	@"$(BIN)/python" teachers/solutions.py _build/solutions

student: copies  ## Write the chapters without solutions into _build/student

solutions: copies  ## Write the chapters with their solutions into _build/solutions

exam: $(STAMP)  ## Write an exam paper and its key into _build/exam (SEED=7 for another)
	@"$(BIN)/python" teachers/exam.py $(SEED) _build/exam

grade: $(STAMP)  ## Grade the students' copies in FOLDER: pages with hints and grades.csv, into _build/grade
	@"$(BIN)/python" teachers/grade.py "$(FOLDER)" _build/grade

# Wheel and source distribution carry the students' copies of the chapters, which `pfslam lab` opens.
wheel: $(STAMP) copies  ## Write both kinds of copies, and into dist the wheel with the students'
	@rm -rf build book/pfslam_book/chapters
	@mkdir book/pfslam_book/chapters
	@cp _build/student/*.ipynb book/pfslam_book/chapters/
	@"$(BIN)/python" -c 'from setuptools.build_meta import build_sdist; build_sdist("dist")' > /dev/null
	@"$(BIN)/python" -m pip wheel -q --disable-pip-version-check --no-deps --no-build-isolation -w dist .
	@rm -rf build book/pfslam_book/chapters

lite: $(LITE)/.installed wheel  ## The chapters for a browser that runs them itself, in _build/lite (an experiment)
	@"$(BIN)/python" book/_tools/lite.py build _build/student dist "$(LITE)" _build/lite

$(SITE)/index.html:
	@$(MAKE) book

site.zip: $(SITE)/index.html  ## Pack the built book for a USB stick
	@"$(BIN)/python" book/_tools/pack.py zip "$(SITE)" site.zip

release: $(STAMP) site.zip student solutions  ## Wheel, sources, site and copies of the chapters, with checksums, into dist
	@rm -rf dist
	@$(MAKE) wheel
	@cp site.zip dist/pfslam-site.zip
	@"$(BIN)/python" book/_tools/pack.py zip _build/student dist/pfslam-student.zip > /dev/null
	@"$(BIN)/python" book/_tools/pack.py zip _build/solutions dist/pfslam-solutions.zip > /dev/null
	@rm dist/*.sha256
	@"$(BIN)/python" book/_tools/pack.py sums dist

SMOKE := _build/smoke
smoke:  ## Install the wheel of dist in a fresh environment, and run it there
	@"$(PYTHON)" -m venv --clear "$(SMOKE)"
	@"$(SMOKE)/$(notdir $(BIN))/python" -m pip install -qq --disable-pip-version-check dist/pfslam-*.whl
	@cd "$(SMOKE)" && "$(notdir $(BIN))/pfslam" --version
	@cd "$(SMOKE)" && "$(notdir $(BIN))/pfslam" run hall --until 20 --no-texture --loops --out out && test -s out/index.html
	@cd "$(SMOKE)" && "$(notdir $(BIN))/pfslam" lab --copy-only

unlocked:  # In place of the locked environment one with the newest release of every dependency
	@"$(PYTHON)" -m venv --clear "$(VENV)"
	@"$(BIN)/python" -m pip install -qq --disable-pip-version-check -e ".[dev]"
	@touch "$(LOCKED)" && touch "$(STAMP)"
	@"$(BIN)/python" -m pip list

# Without the book's own dependencies, so without the tests that import the book or its tools.
OF_THE_BOOK := (import|from) pfslam_book|book/|"book"|notebook|_tools|^from (bench|copies|hero)
lowest:  ## The package's unit tests with the lowest versions that pyproject.toml allows, in an environment of their own
	@"$(PYTHON)" -m venv --clear "$(LOWEST)"
	@"$(PYTHON)" book/_tools/lowest.py > "$(LOWEST)/lowest.txt"
	@"$(LOWEST)/$(notdir $(BIN))/python" -m pip install -qq --disable-pip-version-check -c "$(LOWEST)/lowest.txt" \
	  -e ".[plots,ros,cluster]" evo hypothesis pytest pytest-xdist
	OPENBLAS_NUM_THREADS=1 "$(LOWEST)/$(notdir $(BIN))/python" -m pytest -q -n $(WORKERS) --dist loadfile -m "$(USUAL)" \
	  $$(grep -LE '$(OF_THE_BOOK)' tests/test_*.py)

# A file on top of the environment is its own list of what to install: only the hashes are found anew.
COMPILE := uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-emit-index-url \
  --no-emit-find-links --custom-compile-command "make lock" -q
lock:  ## Renew the lock files: requirements.lock from requirements.in, two others from their names (needs uv)
	$(COMPILE) requirements.in -o requirements.lock
	@for file in tests/nbgrader.lock book/_tools/lite.lock; do \
	  grep -o '^[[:alnum:]][^ ]*' "$$file" | $(COMPILE) --no-deps - > "$$file.new" && mv "$$file.new" "$$file" || exit 1; done

clean:  ## Remove everything that was built, and the environment
	rm -rf _build "$(VENV)" "$(LOWEST)" site.zip site.zip.sha256 *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis out dist build
