"""Make sectors of spur gears: involute teeth by NumPy, triangles by gmsh, plane strain."""

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

from common.bodies import gmsh_mesh

E, NU, MODULE, ANGLE = 210e3, 0.3, 4.0, np.radians(20)  # MPa, -, mm; pressure angle


def involute(angle):
    """Return the involute function inv α = tan α − α."""
    return np.tan(angle) - angle


class Profile:
    """A tooth of a spur gear without profile shift; radii in mm, angles from its middle."""

    def __init__(self, teeth):
        self.teeth, self.pitch = teeth, 2 * np.pi / teeth
        self.radius = MODULE * teeth / 2
        self.base = self.radius * np.cos(ANGLE)
        self.tip, self.root = self.radius + MODULE, self.radius - 1.25 * MODULE
        self.rim = self.root - 2.5 * MODULE

    def half_thickness(self, r):
        """Return the angle from the middle to the flank, at radii from the base circle on."""
        return np.pi / (2 * self.teeth) + involute(ANGLE) - involute(np.arccos(self.base / r))

    def flank(self, h):
        """Return points from tip to root, shape (n, 2): angles and radii, at most h apart.

        The length of an involute grows with the square of its roll angle; below the base circle
        there is a fillet.
        """
        roll = np.sqrt((self.tip / self.base) ** 2 - 1)
        n = int(np.ceil(self.base * roll**2 / 2 / h))
        r = self.base * np.sqrt(1 + roll**2 * np.linspace(1, 0, n + 1))
        angle = self.half_thickness(np.maximum(r, self.base))
        s = np.linspace(0, 1, 7)[1:, None]  # a parabola to the root circle
        foot, corner = np.array([angle[-1], self.base]), np.array([angle[-1], self.root])
        end = corner + np.array([(self.pitch / 2 - angle[-1]) * 0.7, 0])
        fillet = (1 - s) ** 2 * foot + 2 * s * (1 - s) * corner + s**2 * end
        return np.concatenate([np.stack([angle, r], axis=-1), fillet])

    def outline(self, middles, h):
        """Return the outline of a sector with teeth at these angles: anticlockwise, fine flanks."""
        fine, coarse = self.flank(h), self.flank(max(h, 0.8)) * [-1, 1]
        tooth = np.concatenate([coarse[::-1], fine])
        teeth = [tooth + np.array([middle, 0]) for middle in middles]
        ends = middles[0] - self.pitch / 2, middles[-1] + self.pitch / 2
        start, end = ([[angle, self.root]] for angle in ends)
        rim = np.stack([np.linspace(*ends[::-1], 12), np.full(12, self.rim)], axis=-1)
        angle, r = np.concatenate([start, *teeth, end, rim]).T
        return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)


class Gear:
    """Elastic sector of a gear; its rim is turned.

    Args:
        comm: Communicator.
        teeth: Number of teeth of the whole gear.
        middles: Angles of the teeth in the sector.
        center: Position of the axis.
        h: Size of facets on the flanks in contact.
    """

    def __init__(self, comm, teeth, middles, center, h):
        self.profile, self.center = Profile(teeth), np.array(center)
        profile = self.profile

        def draw(gmsh):
            geo, outline = gmsh.model.geo, profile.outline(middles, h)
            points = [geo.addPoint(*x, 0) for x in outline]
            lines = [geo.addLine(*ends) for ends in zip(points, np.roll(points, -1), strict=True)]
            geo.addPlaneSurface([geo.addCurveLoop(lines)])
            geo.synchronize()
            length = np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1)
            for line, size in zip(lines, length, strict=True):
                cells = 1 if size < 1.2 else round(size / 1.2)
                gmsh.model.mesh.setTransfiniteCurve(line, cells + 1)

        self.mesh = msh = gmsh_mesh(comm, 2, draw)
        self.x = msh.geometry.x[:, :2].copy()
        V = self.V = fem.functionspace(msh, ("Lagrange", 1, (2,)))

        def on_flank(x):
            offset = np.arctan2(x[1], x[0])[:, None] - middles
            offset = (offset + np.pi) % (2 * np.pi) - np.pi
            offset = np.take_along_axis(offset, np.abs(offset).argmin(axis=1)[:, None], 1)[:, 0]
            return (np.hypot(x[0], x[1]) > profile.base - 1e-6) & (offset > 0)

        at_rim = lambda x: np.hypot(x[0], x[1]) < profile.rim + 1e-3  # noqa: E731
        self.flanks = mesh.locate_entities_boundary(msh, 1, on_flank)
        rim = mesh.locate_entities_boundary(msh, 1, at_rim)
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        self.stress = qs.materials.linear_elastic(self.u, E, NU)
        self.F = ufl.inner(self.stress, ufl.grad(v)) * ufl.dx
        self.turned = fem.Function(V)
        self.bcs = [fem.dirichletbc(self.turned, fem.locate_dofs_topological(V, 1, rim))]

    def place(self, angle, further):
        """Turn the mesh by an angle, and the rim a little further; return the contact surface."""
        c, s = np.cos(angle), np.sin(angle)
        self.mesh.geometry.x[:, :2] = self.x @ [[c, s], [-s, c]] + self.center
        x, y = self.center
        self.turned.interpolate(lambda p: further * np.stack([y - p[1], p[0] - x]))
        self.u.x.array[:] = 0
        return qs.Surface(self.V, facets=self.flanks)
