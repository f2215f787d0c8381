# Everything needed on a machine with python3, make and git: `make demo`, `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
PEERS  := $(VENV)/.peers
SITE   := $(VENV)/.site
TOOLS  := $(VENV)/tools
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check
LOCK   := $(TOOLS)/bin/pip-compile --quiet --generate-hashes --no-emit-index-url --no-emit-trusted-host \
	--no-emit-find-links --no-annotate --no-header --strip-extras --allow-unsafe

.PHONY: demo test lint unit bench docs licences sbom audit lock clean

demo: $(STAMP)
	$(BIN)/massid demo --out demo_out

test: lint unit licences

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

unit: $(STAMP)
	$(BIN)/pytest -n 2 --dist worksteal

# What massid costs against what one could use instead; BENCH=--quick takes minutes instead of a quarter of an hour.
bench: $(PEERS)
	$(BIN)/python scripts/bench_costs.py $(BENCH)

# The documentation as a site, in site/index.html; a link or a docstring that leads nowhere ends it.
docs: $(SITE)
	$(BIN)/sphinx-build -W --keep-going -q -b html docs site

$(SITE): $(STAMP) constraints-docs.txt
	$(PIP) --require-hashes -r constraints-docs.txt
	touch $@

# The licence of everything that is needed at run time.
licences: $(STAMP)
	$(BIN)/python scripts/licences.py

# What a release is made of, as CycloneDX.
sbom: $(STAMP) $(TOOLS)/.installed
	mkdir -p dist
	$(TOOLS)/bin/cyclonedx-py environment $(BIN)/python --pyproject pyproject.toml --of JSON -o dist/sbom.cdx.json

# Known weaknesses of what is installed.
audit: $(TOOLS)/.installed
	$(TOOLS)/bin/pip-audit --disable-pip --require-hashes -r constraints.txt

# Versions and hashes anew: constraints.txt for what `make` installs, constraints-peers.txt for `make bench` and
# constraints-docs.txt for `make docs` besides.
# Versions stay as they are; UPGRADE=--upgrade takes the newest.
lock: $(STAMP) $(TOOLS)/.installed
	$(BIN)/python scripts/requirements_of.py dev > $(TOOLS)/dev.in
	$(LOCK) $(UPGRADE) -o constraints.txt $(TOOLS)/dev.in
	$(BIN)/python scripts/requirements_of.py dev compare > $(TOOLS)/compare.in
	$(LOCK) $(UPGRADE) -o constraints-peers.txt $(TOOLS)/compare.in
	$(BIN)/python scripts/requirements_of.py dev docs > $(TOOLS)/docs.in
	$(LOCK) $(UPGRADE) -o constraints-docs.txt $(TOOLS)/docs.in

$(TOOLS)/.installed: $(STAMP)
	$(BIN)/python -m venv $(TOOLS)
	$(TOOLS)/bin/python -m pip install --quiet --disable-pip-version-check \
		pip-tools==7.6.2 pip-audit==2.10.1 cyclonedx-bom==7.5.0
	touch $@

$(PEERS): $(STAMP) constraints-peers.txt
	$(PIP) --require-hashes -r constraints-peers.txt
	touch $@

# Nothing is installed whose hash is not in constraints.txt; massid itself is built by what is installed then.
$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v < (3, 13) else f"massid needs Python 3.11 or 3.12, but $(PYTHON) is {v[0]}.{v[1]}; try: make PYTHON=python3.12")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) --require-hashes -r constraints.txt
	$(PIP) --no-deps --no-build-isolation -e .
	touch $@

clean:
	rm -rf $(VENV) demo_out dist build site
