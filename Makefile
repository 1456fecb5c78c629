# `make demo` and `make test` work on a machine that has Python 3.11 or newer and nothing else.

BIN := .venv/bin
READY := .venv/.ready

.PHONY: demo test test-long check notebooks docs audit lock clean

demo: $(READY)
	$(BIN)/python benchmarks/demo.py

test: check
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

# What compiles programs of its own beside a quick test of the same: CONTRIBUTING.md.
test-long: $(READY)
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m long

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

notebooks: $(READY)
	$(BIN)/python -m pytest -n 2 --nbmake --nbmake-timeout=600 notebooks

# The first Python that is new enough and can make environments.
$(READY): pyproject.toml requirements.lock
	@for python in python3.11 python3.12 python3.13 python3 python /usr/bin/python3.11; do \
	  if $$python -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' \
	      2>/dev/null; then found=$$python; break; fi; \
	done; \
	if [ -z "$$found" ]; then \
	  echo "No Python 3.11 or newer with the venv module was found; install one first." >&2; \
	  exit 1; \
	fi; \
	echo "Creating .venv with $$found"; \
	$$found -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check \
	  --no-deps --no-build-isolation --editable .
	@touch $@

# The site, warnings as errors: open docs/_build/html/index.html. It needs no network.
docs: $(READY)
	$(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --quiet \
	  docs docs/_build/html
	@echo "docs/_build/html/index.html"

# Licences of what the lock installs, by pip-licenses in an environment of its own. A licence
# that is written otherwise than here, or unknown, stops it: read it before it is added.
AUDIT := .venv/.audit
LICENCES := MIT;MIT-0;MIT License;MIT-CMU;BSD;BSD License;BSD-2-Clause;BSD-3-Clause;\
BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0;Apache 2.0;Apache-2.0;\
Apache-2.0 OR BSD-2-Clause;Apache-2.0 OR BSD-3-Clause;Apache-2.0 AND MIT;MIT AND PSF-2.0;0BSD OR CC0-1.0;Apache Software License;ISC License (ISCL);PSF-2.0;\
Python Software Foundation License;MPL-2.0;Mozilla Public License 2.0 (MPL 2.0);LGPL-3.0-only
audit: $(READY)
	test -x $(AUDIT)/bin/pip-licenses || $(BIN)/python -m venv $(AUDIT)
	$(AUDIT)/bin/python -m pip install --quiet --disable-pip-version-check pip-licenses==5.5.5
	$(AUDIT)/bin/pip-licenses --python $(BIN)/python --with-system --order=license \
	  --allow-only="$$(printf '%s' '$(LICENCES)' | sed 's/; */;/g')" \
	  --packages $$(sed -n 's/==.*//p' requirements.lock)

# One lock for every Python from 3.11 on (what differs is marked), with hashes, by uv in an
# environment of its own. Pins stay where they can; `make lock LOCK=--upgrade` takes the newest.
LOCKER := .venv/.lock
LOCK :=
lock: $(READY)
	test -x $(LOCKER)/bin/uv || $(BIN)/python -m venv $(LOCKER)
	$(LOCKER)/bin/python -m pip install --quiet --disable-pip-version-check uv==0.13.9
	$(LOCKER)/bin/uv pip compile pyproject.toml --extra dev --extra docs \
	  --universal --python-version 3.11 --generate-hashes --no-header --no-annotate --quiet \
	  $(LOCK) --output-file requirements.lock

clean:
	rm -rf .venv demo docs/_build docs/generated docs/notebooks
