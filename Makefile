# Everything needed on a machine with python3, make and git: `make demo`, `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
PEERS  := $(VENV)/.peers
SITE   := $(VENV)/.site

.PHONY: demo test lint unit bench docs clean

demo: $(STAMP)
	$(BIN)/massid demo --out demo_out

test: lint unit

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

$(SITE): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt --group docs
	touch $@

$(PEERS): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt --group compare
	touch $@

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v < (3, 13) else f"massid needs Python 3.11 or 3.12, but $(PYTHON) is {v[0]}.{v[1]}; try: make PYTHON=python3.12")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "pip>=25.1"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e . --group dev
	touch $@

clean:
	rm -rf $(VENV) demo_out dist build site
