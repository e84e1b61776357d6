# Every command runs through scripts/with-dolfinx. It uses the DOLFINx of this machine, or else of a
# private Debian tree made on first use, and builds qsdolfinx when its sources have changed.

DOLFINX = scripts/with-dolfinx
# Numbers of MPI ranks for the tests.
RANKS = 1 2 3
# Arguments for pytest (--share, --all-cases: see CONTRIBUTING.md; PYTEST_N: with N ranks), and time limit
# of a test run in seconds.
PYTEST = -q --share
TEST_TIMEOUT = 2400
# The command of `make demo`.
DEMO = python3 demos/patch_test.py --plot patch_test.png

.PHONY: help demo test test-sid bench-check verified sanitize figures lint format docs dist image clean
.NOTPARALLEL:

help:
	@echo 'make demo      run the patch test and draw patch_test.png'
	@echo 'make test      run the tests with $(RANKS) MPI ranks'
	@echo 'make test-N    run the tests with N ranks (test RANKS="1 4": with 1 and 4; PYTEST="-k gap": only some tests)'
	@echo 'make test-sid  run the tests with $(RANKS) MPI ranks and the DOLFINx of Debian sid, in a separate tree'
	@echo 'make bench-check  compare ratios of speed and memory with recorded ratios'
	@echo 'make verified  solve problems with known solutions, and write docs/verified.md'
	@echo 'make sanitize  run the tests of the kernels with AddressSanitizer and UBSan'
	@echo 'make figures   redraw the pictures of docs/gallery.md'
	@echo 'make lint      check style and types'
	@echo 'make format    format Python and C++'
	@echo 'make docs      build the documentation in build/docs'
	@echo 'make dist      build source archive and wheel in dist/, and test them in a new environment'
	@echo 'make image     build the container image (docker, podman or buildah), and run the demo and the tests in it'
	@echo 'make clean     remove everything that was built, including the private Debian tree'

demo:
	$(DOLFINX) $(DEMO)

test: $(RANKS:%=test-%)

# Runs with one rank, in two processes at a time if pytest-xdist is installed.
test-1:
	$(DOLFINX) timeout --foreground $(TEST_TIMEOUT) sh -c 'python3 -c "import xdist" 2>/dev/null && \
		export PYTEST_ADDOPTS="-n 2 --dist loadfile $$PYTEST_ADDOPTS"; exec "$$@"' sh python3 -m pytest $(PYTEST) $(PYTEST_1)

test-%:
	$(DOLFINX) timeout --foreground $(TEST_TIMEOUT) mpirun -n $* python3 -m pytest $(PYTEST) $(PYTEST_$*)

test-sid:
	@$(MAKE) --no-print-directory test DOLFINX='scripts/with-dolfinx --suite sid'

test-sid-%:
	@$(MAKE) --no-print-directory test-$* DOLFINX='scripts/with-dolfinx --suite sid'

bench-check:
	$(DOLFINX) python3 bench/check.py

sanitize:
	@scripts/sanitize

# Writes the tables of docs/verified.md: our results and the published ones.
verified:
	$(DOLFINX) python3 bench/verified.py --markdown docs/verified.md

figures:
	$(DOLFINX) scripts/figures

lint:
	@scripts/lint

format:
	@scripts/lint --fix

docs:
	@scripts/build-docs

dist:
	$(DOLFINX) scripts/build-dist

image:
	@scripts/build-image

clean:
	@scripts/private-root --clean
	rm -rf build dist .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
