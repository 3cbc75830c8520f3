# Two commands: `make demo` and `make test`. Each makes .venv from requirements.lock if it is not there.
#
# requirements.lock is made from pyproject.toml by:
#   uv pip compile --no-config --generate-hashes --no-emit-index-url --no-emit-find-links --no-header --no-annotate \
#       --python-version 3.11 --extra dev pyproject.toml -o requirements.lock

SHELL := /bin/sh
BIN := .venv/bin
# A sourced ROS workspace puts packages of another Python there, and pytest would load their plugins.
unexport PYTHONPATH PYTHONHOME

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help venv demo test lint bench clean

help:
	@echo 'make demo    run the quickstart experiment on real data; says where its report is'
	@echo 'make test    everything that continuous integration runs'
	@echo 'make lint    formatting, lint, types and import contracts only'
	@echo 'make bench   benchmarks, and the long studies against their manifests'
	@echo 'make clean   remove caches, results and build products; experiments and manifests stay'

demo: venv
	$(BIN)/clpv run quickstart
	$(BIN)/clpv report quickstart
	@echo 'Next: . $(BIN)/activate && clpv inspect quickstart'

test: lint
	$(BIN)/python -m pytest -q -n 2

lint: venv
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

bench: venv
	$(BIN)/python -m pytest tests/benchmarks -q -s
	$(BIN)/clpv verify lasa-disturbance
	$(BIN)/clpv verify lasa-obstacles
	$(BIN)/clpv verify obstacle-scenes
	$(BIN)/clpv verify box-moving
	$(BIN)/clpv verify box-disturbance
	$(BIN)/clpv verify box-obstacle

# A venv knows its own path, so one in a moved checkout is made anew. Both stamps are written last: after a failed or
# interrupted installation the next make starts again. PYTHON=... names another interpreter of the same version.
venv:
	@set -eu; \
	packages="$$(pwd -P) $$(cksum < requirements.lock)"; \
	if [ "$$(cat .venv/packages-installed 2>/dev/null)" != "$$packages" ] || ! $(BIN)/python -c '' 2>/dev/null; then \
		if [ -n "$${PYTHON:-}" ]; then set -- "$$PYTHON"; else set -- python3.11 python3 python; fi; \
		python=; \
		for name in "$$@"; do \
			if "$$name" -c 'import sys, ensurepip, venv; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then \
				python="$$name"; break; \
			fi; \
		done; \
		if [ -z "$$python" ]; then \
			echo "clpv needs Python 3.11 with its venv module: install it, or name it with 'make PYTHON=/path/to/python3.11 ...'." >&2; \
			exit 1; \
		fi; \
		echo 'Installing the pinned packages into .venv (about a minute) ...'; \
		"$$python" -m venv --clear .venv; \
		$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary :all: -r requirements.lock; \
		printf '%s\n' "$$packages" > .venv/packages-installed; \
	fi; \
	project="$$(cksum < pyproject.toml)"; \
	if [ "$$(cat .venv/project-installed 2>/dev/null)" != "$$project" ]; then \
		$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .; \
		printf '%s\n' "$$project" > .venv/project-installed; \
	fi

clean:
	find . \( -name .venv -o -name .git \) -prune -o -type d \( -name __pycache__ -o -name '*.egg-info' \) -prune -exec rm -rf {} +
	rm -rf build dist .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	rm -rf runs/.store runs/index.html runs/*/report.html runs/*/figures
