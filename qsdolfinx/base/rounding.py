"""What counts as rounding: three sizes, relative to the values that are compared.

Results do not depend on them: ``tests/base/test_rounding.py`` changes each by a factor.
"""

#: Relative size of rounding errors of a few operations in double precision.
ROUNDING = 1e-10

#: Relative size of errors that linear solvers, and sums over a mesh, leave in a value.
SOLVED = 1e-6

#: Error of coordinates from a file in single precision, over the size of a facet.
SINGLE = 1e-5
