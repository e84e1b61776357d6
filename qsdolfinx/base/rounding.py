"""What counts as rounding, or as nothing: sizes relative to the values that are compared.

Results do not depend on the first three: ``tests/base/test_rounding.py`` changes each by a factor.
"""

#: Relative size of rounding errors of a few operations in double precision. With less than about
#: 1e-15, equal numbers would differ.
ROUNDING = 1e-10

#: Relative size of errors that linear solvers, and sums over a mesh, leave in a value. It is above
#: the tolerances of solves, and below what changes a result.
SOLVED = 1e-6

#: Error of coordinates from a file in single precision, over the size of a facet. With less,
#: vertices of one plane would not be on it.
SINGLE = 1e-5

#: Gap, depth or length over the smallest facet below which nothing is said of it. Where two meshes
#: of one geometry meet, correct results have smaller ones; ten times this is an error that matters.
NOTICED = 0.01
