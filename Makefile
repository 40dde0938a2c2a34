# Two commands do everything on a bare Debian machine: `make demo` and `make test`. Both set up `.venv` first, once.
SHELL := /bin/bash
VENV := .venv
PYTHON ?= python3
BIN := $(VENV)/bin
READY := $(VENV)/.ready
TESTS ?=

.PHONY: demo test lint docs setup clean

demo: $(READY)  ## the demo matrix on the synthetic street: table, plots, pictures and report
	$(BIN)/geovp run --fresh benchmarks/configs/demo.toml

test: $(READY)  ## the whole test suite; with GEOVP_TEST_DATA=FOLDER also on real data
	$(BIN)/python -m pytest -n auto --dist worksteal -q $(TESTS)

lint: $(READY)  ## format, lint rules and types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

docs: $(READY)  ## the documentation as a site in site/; a broken link or reference is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

setup: $(READY)  ## only the virtual environment

clean:  ## remove the virtual environment and everything derived
	rm -rf $(VENV) build dist site *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis

# torch first, by its exact pin: unpinned it would draw in gigabytes that nothing here needs.
$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "GeoVP needs Python 3.11 or newer, $(PYTHON) is $$($(PYTHON) --version 2>&1): set PYTHON=/path/to/python3.11"; exit 2; }
	@$(MAKE) --no-print-directory debian-packages
	@[ -x $(BIN)/python ] || $(PYTHON) -m venv $(VENV)
	@echo "Installing into $(VENV) (once; some minutes, about 4 GB) ..."
	$(BIN)/python -m pip install --quiet --constraint constraints.txt torch
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --config-settings editable_mode=compat --editable '.[all,dev]'
	@$(BIN)/python -c 'import open3d' 2>/dev/null || \
	  { echo "Open3D cannot be imported: install the Debian package libusb-1.0-0 (as root: apt-get install libusb-1.0-0)"; exit 1; }
	@touch $@

# What Debian leaves out: venv's own pip, and the library that Open3D links against.
.PHONY: debian-packages
debian-packages:
	@missing=""; \
	$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || missing="$$missing python3-venv"; \
	/sbin/ldconfig -p 2>/dev/null | grep -q 'libusb-1\.0\.so\.0' || missing="$$missing libusb-1.0-0"; \
	[ -n "$$missing" ] || exit 0; \
	sudo=""; [ "$$(id -u)" = 0 ] || sudo="sudo -n"; \
	echo "Installing Debian packages:$$missing"; \
	if command -v apt-get >/dev/null && $$sudo apt-get update -qq && $$sudo apt-get install -y -qq $$missing >/dev/null; then exit 0; fi; \
	echo "Could not install$$missing: install them by hand (as root: apt-get install$$missing)"
