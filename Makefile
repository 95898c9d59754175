# Needs make and a python >= 3.11 with pip; everything else goes into .venv. Choose another python with PYTHON=...
PYTHON ?= python3
SCENARIO ?= humanoid-stand
# Tests run in one process for each core, eight at most; a file's tests stay together, files with slow tests first.
# PARALLEL= runs them in one process.
PARALLEL ?= -n logical --maxprocesses 8 --dist loadfile --no-loadscope-reorder
MUTATIONS ?= --count 200 --seed 1 --jobs 2
VENV := .venv
VENV_PYTHON := $(VENV)/bin/python
INSTALL := $(VENV_PYTHON) -m pip install --disable-pip-version-check --quiet --editable
# The one thing that pip does not bring: Pinocchio's wheel for Linux is linked against libgomp.
# The solver is compiled once for this processor, and kept.
COMPILE := $(VENV_PYTHON) -m wbc.compile_all
LOOK := $(VENV_PYTHON) -c "import pinocchio" || \
  { echo "If libgomp.so.1 is what is missing: apt install libgomp1 (Debian, Ubuntu) or dnf install libgomp (Fedora)" >&2; exit 1; }

.PHONY: help run test docs gallery lint types tests kernels deep mutations format clean
.DELETE_ON_ERROR:

help:
	@echo "make run     install into .venv, run the scenario $(SCENARIO), write its report   (SCENARIO=name for another)"
	@echo "make test    install everything permissive into .venv, then lint, types and tests"
	@echo "make docs    build the documentation as a site: docs/_build/html/index.html"
	@echo "make gallery run the scenarios of the gallery and build the site with their moving pictures and reports"
	@echo "make kernels the tests of the numerical core as other processors would run them (OpenBLAS, numba)"
	@echo "make deep    the same tests and the long ones, with many more random examples"
	@echo "make mutations   draw 200 slips in the sources and print those that no test notices: hours   (MUTATIONS=\"--count 20 --seed 2\")"
	@echo "make format  write the sources as the formatter wants them"
	@echo "make clean   remove .venv and what tools left behind"

run: $(VENV)/ready-to-run
	@$(VENV)/bin/wbc run $(SCENARIO)

test: lint types tests

docs: $(VENV)/ready-to-document
	@$(VENV_PYTHON) docs/build.py
	@echo "The site: docs/_build/html/index.html"

gallery: $(VENV)/ready-to-document $(VENV)/ready-to-run
	@$(INSTALL) ".[export]"
	@$(VENV_PYTHON) docs/gallery.py
	@$(MAKE) --no-print-directory docs

lint: $(VENV)/ready-to-test
	$(VENV_PYTHON) -m ruff check .
	$(VENV_PYTHON) -m ruff format --check .

types: $(VENV)/ready-to-test
	$(VENV_PYTHON) -m mypy

tests: $(VENV)/ready-to-test
	$(VENV_PYTHON) -m pytest $(PARALLEL)

kernels: $(VENV)/ready-to-test
	$(VENV_PYTHON) -m tests.kernels $(PARALLEL)

deep: $(VENV)/ready-to-test
	$(VENV_PYTHON) -m pytest -m "deep or not deep" --hypothesis-profile=deep $(PARALLEL)

mutations: $(VENV)/ready-to-test
	$(VENV_PYTHON) -m tests.mutations $(MUTATIONS)

format: $(VENV)/ready-to-test
	$(VENV_PYTHON) -m ruff check --fix .
	$(VENV_PYTHON) -m ruff format .

clean:
	rm -rf $(VENV) build dist docs/_build .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks

# One stamp per set of extras, newer than pyproject.toml: a second call finds it and downloads nothing.
$(VENV)/ready-to-run: pyproject.toml | $(VENV)/created
	@echo "Installing the framework, physics, reports and robot models into $(VENV):"
	@echo "about 350 MB to download from PyPI, 1.4 GB on disk, a minute or two."
	@$(INSTALL) ".[sim,report,robots]"
	@$(LOOK)
	@echo "Compiling the solver for this processor, once: about a minute."
	@$(COMPILE)
	@touch $@

$(VENV)/ready-to-document: pyproject.toml | $(VENV)/created
	@echo "Installing the framework, physics, reports and Sphinx into $(VENV)."
	@$(INSTALL) ".[docs]"
	@$(LOOK)
	@$(COMPILE)
	@touch $@

$(VENV)/ready-to-test: pyproject.toml | $(VENV)/created
	@echo "Installing the framework with all permissive extras, linters and test tools into $(VENV):"
	@echo "about 500 MB to download from PyPI, 1.9 GB on disk, a minute or two."
	@$(INSTALL) ".[all]"
	@$(LOOK)
	@echo "Compiling the solver for this processor, once: about a minute."
	@$(COMPILE)
	@touch $(VENV)/ready-to-run $@

# Without ensurepip, which some distributions leave out: the pip that is there installs pip into the environment.
# That also respects an externally managed python, since nothing outside .venv is touched.
$(VENV)/created:
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11))" || \
	  { echo "This needs Python 3.11 or newer; '$(PYTHON)' is $$($(PYTHON) --version 2>/dev/null || echo missing). Say which one: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -m venv --without-pip $(VENV)
	@$(PYTHON) -m pip --python $(VENV_PYTHON) install --disable-pip-version-check --quiet pip || $(VENV_PYTHON) -m ensurepip || \
	  { echo "'$(PYTHON) -m pip' did not work; install pip for it, or choose another with make PYTHON=..." >&2; exit 1; }
	@touch $@
