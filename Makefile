# make demo: set everything up and run the main job.   make test: set everything up and pass the tests.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# One thread in BLAS: the arrays are small, and the ray caster wants the cores.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
# Bytecode is kept whatever the shell says: tests start hundreds of processes, and each would compile all modules.
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo test test-slow check docs bench bench-planning bench-estimation bench-outside readme lock clean wheel rows

demo: $(STAMP)
	$(BIN)/omniservo run paper-example-1 --out runs/paper-example-1 --force
	@echo "open runs/paper-example-1/report.html"

# Three workers on two cores: tests of processes and lines mostly wait. What they all need is compiled before:
# beginning at once, each of them would compile it for itself.
test: $(STAMP)
	$(BIN)/omniservo warm-up
	$(BIN)/python -m pytest -n 3 --dist worksteal -m "not slow"

# What `make test` leaves out: whole runs, processes that are killed, statistics of many estimates. CI runs both.
test-slow: $(STAMP)
	$(BIN)/omniservo warm-up
	$(BIN)/python -m pytest -n 3 --dist worksteal -m slow

check: $(STAMP)
	$(BIN)/ruff check src tests benchmarks examples
	$(BIN)/ruff format --check src tests benchmarks examples
	$(BIN)/mypy
	$(BIN)/lint-imports

# The documentation as a site that opens from the disk, with search; a warning is an error.
docs: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -r requirements-docs.lock
	$(BIN)/python -m benchmarks.api_page
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "open site/index.html"

bench: $(STAMP)
	$(BIN)/python -m benchmarks.table

# Ours beside what people use today, into docs/benchmark-planning.md.   ARGS=--quick: a part of it, into runs/
bench-planning: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -r requirements-bench.lock
	$(BIN)/python -m benchmarks.comparisons.planning $(ARGS)

# Motion and pose beside pycolmap, PoseLib and OpenCV, into docs/benchmark-estimation.md.
bench-estimation: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -r requirements-bench.lock
	$(BIN)/python -m benchmarks.comparisons.estimation_page $(ARGS)

# Suites and libraries that Debian packages, run beside ours, into docs/outside-suites.md.
bench-outside: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -r requirements-bench.lock
	$(BIN)/python -m benchmarks.comparisons.outside_page $(ARGS)

# The README's table and animation, from runs made now.
readme: $(STAMP)
	$(BIN)/python -m benchmarks.readme

# With compiled kernels, for this Python and machine: the first plan of whoever installs it compiles nothing.
wheel: $(STAMP)
	OMNISERVO_KERNELS=1 $(BIN)/python -m build --wheel --no-isolation

# The raw rows of the public benchmark, and what verifies them, into dist/ beside the wheel, with the hashes of all.
STUDY ?= paper-benchmark
ROWS = $(notdir $(basename $(STUDY)))
rows: $(STAMP)
	mkdir -p dist
	$(BIN)/omniservo study $(STUDY) --out build/studies/$(ROWS)
	cp build/studies/$(ROWS)/rows.parquet dist/$(ROWS)-rows.parquet
	tar --sort=name --mtime=@0 --owner=0 --group=0 --numeric-owner -C build/studies -cf - $(ROWS)/study.json $(ROWS)/parts | gzip -n > dist/$(ROWS).tar.gz
	cd dist && sha256sum $$(ls | grep -v SHA256SUMS) > SHA256SUMS

$(STAMP): pyproject.toml requirements.lock
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	touch $@

# Pins every dependency (also the developers' tools) for all platforms and Python versions that are supported.
lock:
	$(PYTHON) -m pip install --quiet uv
	$(PYTHON) -m uv pip compile pyproject.toml --group dev --universal --python-version 3.11 --no-emit-index-url --output-file requirements.lock
	$(PYTHON) -m uv pip compile --group bench --constraint requirements.lock --universal --python-version 3.11 --no-emit-index-url --output-file requirements-bench.lock
	$(PYTHON) -m uv pip compile --group docs --constraint requirements.lock --universal --python-version 3.11 --no-emit-index-url --output-file requirements-docs.lock

clean:
	rm -rf $(VENV) dist build site .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
