# Two commands do everything on a bare Debian machine: `make demo` and `make test`. Both set up `.venv` first, once.
SHELL := /bin/bash
VENV := .venv
PYTHON ?= python3
BIN := $(VENV)/bin
READY := $(VENV)/.ready
TESTS ?=
MODULE ?= geometry
MUTANTS ?= 60
SEED ?= 1
KITTI ?=
POSES ?=
VIDEOS ?=
PAGES ?=

VERSIONS ?= oldest newest
VERSION_TESTS ?= tests/geovp_classic/geometry tests/geovp_classic/odometry tests/geovp_classic/metrics tests/geovp_classic/rendering \
  tests/geovp/test_exports.py tests/benchmarks/test_run.py tests/benchmarks/test_tables.py

.PHONY: demo test mutation lint docs results wheel-test test-versions setup clean

demo: $(READY)  ## the demo matrix on the synthetic street: table, plots, pictures and report
	$(BIN)/geovp run --fresh demo

# Some images forbid Python to keep compiled modules, which every process of a test would compile again. Libraries bring plug-ins of
# pytest that no test here needs, and whose modules every process would rewrite.
PLUGINS := -p xdist -p randomly -p hypothesispytest
test: $(READY)  ## the whole test suite; with GEOVP_TEST_DATA=FOLDER also on real data
	PYTHONDONTWRITEBYTECODE= PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 $(BIN)/python -m pytest $(PLUGINS) -n auto --dist worksteal -q $(if $(CI),--randomly-seed=1) $(TESTS)

# In a copy, since cosmic-ray changes the sources themselves, one mutant at a time.
mutation: $(READY)  ## do the tests notice changed sources? MODULE=geometry|metrics|statistics|store|scoring|learned|tables MUTANTS=60 SEED=1
	@set -e; $(BIN)/python -m pip install --quiet --constraint constraints.txt cosmic-ray; \
	bin="$$PWD/$(BIN)"; copy=$$(mktemp -d); trap 'rm -rf "$$copy"' EXIT; \
	git ls-files -z | xargs -0 cp --parents -P -t "$$copy"; cd "$$copy"; \
	export PATH="$$bin:$$PATH" PYTHONPATH="$$copy:$$copy/learned:$$copy/benchmarks" NUMBA_CACHE_DIR="$$copy/.numba" PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 CI=true; \
	config=tests/mutation_testing/$(MODULE).toml; \
	cosmic-ray init $$config session.sqlite; cr-filter-operators session.sqlite $$config; \
	python tests/mutation_testing/sample.py session.sqlite --count $(MUTANTS) --seed $(SEED); \
	cosmic-ray exec $$config session.sqlite; \
	cr-report --surviving-only --show-diff session.sqlite | \
	  sed '/^total jobs/d; /^complete/d; s/^\(surviving mutants: [0-9]*\).*/\1 of $(MUTANTS)/'

lint: $(READY)  ## format, lint rules and types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

docs: $(READY)  ## the documentation as a site in site/; a broken link or reference is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

results: $(READY)  ## recompute the results pages; resumable. KITTI= POSES= VIDEOS=FOLDER PAGES="demo fusion"
	@PATH="$$PWD/$(BIN):$$PATH" KITTI="$(KITTI)" POSES="$(POSES)" VIDEOS="$(VIDEOS)" $(BIN)/python docs/recompute.py $(PAGES)

# The environment has the wheel, and the libraries of .venv beside it: nothing is downloaded.
wheel-test: $(READY)  ## the wheel, built and tried in a clean environment from another folder
	@rm -rf build; folder=$$(mktemp -d); trap 'rm -rf "$$folder" build' EXIT; set -e; \
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir "$$folder" .; \
	$(BIN)/python -m venv --without-pip "$$folder/venv"; \
	$(BIN)/python -m pip --python "$$folder/venv/bin/python" install --quiet --no-deps "$$folder"/*.whl; \
	beside=$$($(BIN)/python -c 'import os, numpy; print(os.path.dirname(os.path.dirname(numpy.__file__)))'); \
	echo "$$beside" > "$$(echo "$$folder"/venv/lib/python3*/site-packages)/beside.pth"; \
	"$$folder/venv/bin/python" tests/install_size.py; \
	cd "$$folder"; unset PYTHONPATH; \
	venv/bin/geovp --version; \
	venv/bin/geovp list > list.txt; grep -q '^  depth-fusion: ' list.txt; \
	venv/bin/python -c 'import geovp_benchmarks, geovp_classic, sys; assert geovp_classic.__file__.startswith(sys.prefix)'; \
	venv/bin/geovp run demo --quiet --limit 1 --no-report --set 'metrics.frame=["psnr"]' --set 'predictors={}' \
	  --set 'pose_sources={gt-3d={name="ground-truth"}}' --set 'renderers={plane={name="ground-far-plane"}}'; \
	test -n "$$(ls results/demo/gt-3d--plane/scores/part-*.parquet)"

test-versions:  ## a part of the suite with the oldest and the newest libraries allowed, each in an environment of its own
	@set -e; for which in $(VERSIONS); do \
	  echo "With the $$which versions:"; \
	  venv=.venv-$$which; pins=""; [ $$which = newest ] || pins="--constraint constraints-$$which.txt"; \
	  [ -x $$venv/bin/python ] || $(PYTHON) -m venv $$venv; \
	  $$venv/bin/python -m pip install --quiet --upgrade $$pins '.[volume,video]' pytest hypothesis; \
	  $$venv/bin/python -m pytest -q $(VERSION_TESTS); \
	done

setup: $(READY)  ## only the virtual environment

clean:  ## remove the virtual environment and everything derived
	rm -rf $(VENV) .venv-oldest .venv-newest build dist site *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis

NO_ROOM = { df -h . "$${TMPDIR:-/tmp}"; echo "Set-up failed: besides a package index it needs 4 GB here and 1 GB for temporary files (in TMPDIR, else /tmp)"; exit 1; }

# torch first, by its exact pin: unpinned it would draw in gigabytes that nothing here needs.
$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "GeoVP needs Python 3.11 or newer, $(PYTHON) is $$($(PYTHON) --version 2>&1): set PYTHON=/path/to/python3.11"; exit 2; }
	@$(MAKE) --no-print-directory debian-packages
	@[ -x $(BIN)/python ] || $(PYTHON) -m venv $(VENV)
	@echo "Installing into $(VENV) (once; some minutes, about 4 GB) ..."
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt torch || $(NO_ROOM)
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[learned,pretrained,onnx,volume,video,cluster,completion,exr,rosbag,dev]' || $(NO_ROOM)
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
