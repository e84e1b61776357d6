"""Quadrature degrees that UFL estimates for a body's form, where they waste most of the time.

UFL adds up the degrees of all factors and adds 2 for each function that is no polynomial. For a
hyperelastic body on hexahedra this gives 1331 points in a cell, where 8 are usual.
"""

from __future__ import annotations

import typing

import numpy as np

import basix
import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives
from ufl.algorithms.estimate_degrees import estimate_total_polynomial_degree

_SIMPLICES = basix.CellType.triangle, basix.CellType.tetrahedron

#: Number of quadrature points over the usual number, above which there is a warning: linear forms
#: on hexahedra have 3.4 times as many points, neo-Hookean ones 16 (quadrilaterals) to 166 times.
WASTE = 8.0

#: Number of needless quadrature points in all cells, below which there is no warning: they take
#: about 0.2 s at most in each assembly.
FEW = 100_000


class Waste(typing.NamedTuple):
    """An estimated quadrature degree that is much higher than usual.

    Attributes:
        degree: Estimated degree.
        points: Number of its points in a cell.
        usual: Degree that is usual for the element.
        usual_points: Number of its points in a cell.
    """

    degree: int
    points: int
    usual: int
    usual_points: int

    def text(self, number: int, seconds: float) -> str:
        """Warning for the body of this number, whose tangent was assembled in some seconds."""
        less = seconds * self.usual_points / self.points
        return (
            f"F: for entry {number} UFL estimates the quadrature degree {self.degree}: "
            f"{self.points} points in each cell, where {self.usual_points}, of degree "
            f"{self.usual}, are usual for its element. Its tangent was assembled in "
            f"{seconds:.2g} s; with these points it would take about {less:.1g} s. Write "
            f"ufl.Measure('dx', domain=mesh, metadata={{'quadrature_degree': {self.usual}}}) in "
            "its form, and compare the results once with a higher degree; a form whose degree is "
            "given is not checked"
        )


def waste(form: ufl.Form, V: fem.FunctionSpace) -> Waste | None:
    """The estimated degree of a form on V, if it has many times the usual number of points.

    Usual are 2k for simplices, and k + 1 points in each direction for other cells, k being the
    degree of the polynomials of V.

    Args:
        form: Tangent of a body.
        V: Function space of the body.
    """
    free = [
        i
        for i in expand_derivatives(form).integrals()
        if i.integral_type() == "cell" and "quadrature_degree" not in i.metadata()
    ]
    if not free:
        return None
    cell = V.mesh.basix_cell()
    k = V.ufl_element().embedded_superdegree
    usual = 2 * k if cell in _SIMPLICES else 2 * k + 1
    degree = max(int(estimate_total_polynomial_degree(i.integrand())) for i in free)
    if cell not in _SIMPLICES:
        degree += V.mesh.topology.dim  # of det J, at least: as in UFL for affine cells
    points, fewer = (np.size(basix.make_quadrature(cell, d)[1]) for d in (degree, usual))
    cells = V.mesh.topology.index_map(V.mesh.topology.dim).size_global
    if points <= WASTE * fewer or (points - fewer) * cells < FEW:
        return None
    return Waste(degree, points, usual, fewer)
