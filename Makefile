# Every command runs through scripts/with-dolfinx: DOLFINx is that of this machine, or else of a
# private Debian tree made on first use, and qsdolfinx is built when its sources have changed.

DOLFINX = scripts/with-dolfinx
# Numbers of MPI ranks that the tests run with.
RANKS = 1 2 3
# Arguments for pytest (--share, --all-cases: see CONTRIBUTING.md; PYTEST_N: with N ranks), and seconds after
# which a test run is given up.
PYTEST = -q --share
TEST_TIMEOUT = 2400
# The command of `make demo`.
DEMO = python3 demos/patch_test.py --plot patch_test.png

.PHONY: help demo test test-sid bench-check verified sanitize figures lint format docs dist image clean
.NOTPARALLEL:

help:
	@echo 'make demo      run the patch test and draw patch_test.png'
	@echo 'make test      run the tests with $(RANKS) MPI ranks'
	@echo 'make test-N    run them with N ranks (RANKS="1 4": with 1 and 4; PYTEST="-k gap": some of them)'
	@echo 'make test-sid  run them with $(RANKS) MPI ranks and the DOLFINx of Debian sid, in a tree of its own'
	@echo 'make bench-check  compare ratios of speed and memory with recorded ones'
	@echo 'make verified  solve what others have solved, and write docs/verified.md'
	@echo 'make sanitize  run the tests of the kernels with AddressSanitizer and UBSan'
	@echo 'make figures   draw the pictures of docs/gallery.md again'
	@echo 'make lint      check style and types'
	@echo 'make format    format Python and C++'
	@echo 'make docs      build the documentation in build/docs'
	@echo 'make dist      build source archive and wheel in dist/, and try them in a new environment'
	@echo 'make image     build the container image, run the demo and the tests in it (docker, podman or buildah)'
	@echo 'make clean     remove everything that was built, the private Debian tree included'

demo:
	$(DOLFINX) $(DEMO)

test: $(RANKS:%=test-%)

# One rank each in two processes, where pytest-xdist is installed.
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

# Results beside those of others: the tables of docs/verified.md.
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
