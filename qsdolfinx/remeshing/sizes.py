"""Cell sizes for remeshing: checks, and sizes from curvature, distance or a field."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la, mesh

from qsdolfinx.base.checks import (
    FUNCTION,
    MESH,
    POSITIVE,
    check,
    check_array,
    instance,
    require,
)
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.compat import cell_nodes
from qsdolfinx.remeshing.outline import Outline, gather, listed
from qsdolfinx.remeshing.reference import Triangles, closest_on_segments
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]
#: A length, a function of points (3, n), or a field on the old mesh; for a list the smallest.
Size = (
    float
    | typing.Callable[[Array], npt.ArrayLike]
    | fem.Function
    | typing.Sequence["float | typing.Callable[[Array], npt.ArrayLike] | fem.Function"]
)


def check_size(msh: mesh.Mesh, size: typing.Any) -> None:
    """Raise an error for an argument that is not a size.

    Raises:
        TypeError: If it is neither a number nor a function nor a list of these.
        ValueError: If a number is not positive, a Function not scalar or on another mesh.
    """
    if isinstance(size, (list, tuple)):
        require(len(size) > 0, "size: must not be an empty list")
        for one in size:
            check_size(msh, one)
    elif isinstance(size, fem.Function):
        require(size.function_space.mesh is msh, "size: must be a Function on the body's mesh")
        require(size.ufl_shape == (), "size: must be a scalar Function")
    elif not callable(size):
        check(POSITIVE, size=size)


def kinds(size: typing.Any) -> str:
    """Kind of a size, which must be the same on all ranks."""
    if isinstance(size, (list, tuple)):
        return "[" + ", ".join(kinds(one) for one in size) + "]"
    if isinstance(size, fem.Function):
        return "a Function"
    return "a function" if callable(size) else f"{float(size):.17g}"


def nodal_sizes(msh: mesh.Mesh, x: Array, size: typing.Any) -> Array:
    """Sizes at the nodes of a mesh, shape (geometry nodes,). Collective.

    Args:
        msh: The mesh.
        x: Coordinates of its nodes, shape (geometry nodes, 3).
        size: Size as in :func:`qs.remesh`.

    Raises:
        ValueError: If a size is not positive and finite, or has a wrong shape.
    """
    if isinstance(size, (list, tuple)):
        return np.asarray(np.min([nodal_sizes(msh, x, one) for one in size], axis=0))
    if isinstance(size, fem.Function):
        values = _least_at_nodes(size)
    else:
        with collective_errors(msh.comm):
            found = np.asarray(size(x.T) if callable(size) else size)
            fits = found.shape in ((), (len(x),)) and found.dtype.kind in "fiu"
            require(fits, "size: must return a real number for each of its points, shape (n,)")
            values = np.broadcast_to(found, (len(x),)).astype(np.float64)
    with collective_errors(msh.comm):
        good = np.isfinite(values) & (values > 0)
        require(good.all(), "size: must be positive and finite everywhere")
    return np.array(values)


def _least_at_nodes(size: fem.Function) -> Array:
    """Smallest value at each node of the mesh, over the cells at this node. Collective."""
    msh = size.function_space.mesh
    of_cells = fem.Function(fem.functionspace(msh, ("DG", 1)))
    of_cells.interpolate(size)
    out = np.full(len(msh.geometry.x), np.inf)
    values = of_cells.x.array[of_cells.function_space.dofmap.list]
    np.minimum.at(out, cell_nodes(msh), values.astype(np.float64))
    return out


def at_nodes(function: fem.Function) -> Array:
    """Values of a function at the nodes of its mesh, which is straight. Collective.

    Returns:
        Shape (geometry nodes,), or (geometry nodes, components).
    """
    msh, shape = function.function_space.mesh, function.ufl_shape
    space = fem.functionspace(msh, ("Lagrange", 1, shape))
    linear = fem.Function(space)
    linear.interpolate(function)
    values = linear.x.array.reshape(-1, *shape)
    out = np.zeros((len(msh.geometry.x), *shape))
    out[cell_nodes(msh)] = values[space.dofmap.list]
    return out


def limit_growth(outline: Outline, gradation: float) -> Outline:
    """Limit the growth of sizes from node to node to a part of their distance."""
    pairs = {(i, j) for i in range(outline.gdim + 1) for j in range(i)}
    a, b = np.unique(
        np.sort(np.concatenate([outline.cells[:, p] for p in pairs]), axis=1), axis=0
    ).T
    way = gradation * np.linalg.norm(outline.x[a] - outline.x[b], axis=1)
    sizes = outline.sizes.copy()
    while True:
        new = sizes.copy()
        np.minimum.at(new, a, sizes[b] + way)
        np.minimum.at(new, b, sizes[a] + way)
        if np.array_equal(new, sizes):
            return outline._replace(sizes=new)
        sizes = new


def size_from_curvature(
    body: mesh.Mesh | fem.Function, angle: float, smallest: float, largest: float
) -> fem.Function:
    """Compute cell sizes for a given angle between the facets of a curved boundary. Collective.

    Rank 0 needs the whole boundary.

    Args:
        body: Body as in :func:`qs.remesh`.
        angle: Angle between neighbouring facets (radians). Edges with an angle of more than π/4 are
            sharp and do not count.
        smallest: Smallest size (length).
        largest: Largest size (length), where the boundary is not curved, and within the body.

    Returns:
        Function of degree 1 on the old mesh.

    Raises:
        ValueError: If a number is not positive, or ``largest`` is less than ``smallest``.
    """
    check(instance((mesh.Mesh, fem.Function), "a mesh or a displacement"), body=body)
    msh, x = where(body)
    with checked(msh.comm) as same:
        same(POSITIVE, angle=angle, smallest=smallest, largest=largest)
        require(smallest <= largest, "largest: must not be less than smallest")
    outline = gather(msh, x, np.full(len(x), largest), None)
    found = None if outline is None else _curved(outline, angle)
    sizes = msh.comm.bcast(found, root=0)
    every = msh.comm.gather(np.unique(_keys(msh)), root=0)
    keys = msh.comm.bcast(None if every is None else np.unique(np.concatenate(every)), root=0)
    local = sizes[np.searchsorted(keys, _keys(msh))]
    return _function(msh, np.clip(local, smallest, largest))


def _keys(msh: mesh.Mesh) -> npt.NDArray[np.int64]:
    return np.asarray(msh.geometry.input_global_indices, dtype=np.int64)


def _curved(outline: Outline, angle: float) -> Array:
    """Radius of curvature times angle at the nodes; inf on flat parts."""
    x, facets = outline.x, outline.facets
    out = np.full(len(x), np.inf)
    corners = x[facets]
    middle = corners.mean(axis=1)
    if outline.gdim == 3:
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    else:
        along = corners[:, 1] - corners[:, 0]
        normal = np.stack([along[:, 1], -along[:, 0], 0 * along[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sides: dict[tuple[int, ...], list[int]] = {}
    for i, facet in enumerate(listed(facets)):
        for skip in range(len(facet)):
            ridge = tuple(sorted(facet[:skip] + facet[skip + 1 :]))
            sides.setdefault(ridge, []).append(i)
    for ridge, pair in sides.items():
        if len(pair) != 2:
            continue
        first, second = pair
        turn = float(np.arccos(np.clip(normal[first] @ normal[second], -1.0, 1.0)))
        if 0 < turn <= np.pi / 4 + SOLVED:
            radius = float(np.linalg.norm(middle[first] - middle[second])) / turn
            nodes = list(ridge)
            out[nodes] = np.minimum(out[nodes], angle * radius)
    return out


def _function(msh: mesh.Mesh, values: Array) -> fem.Function:
    """Function of degree 1 with given values at the nodes of the mesh."""
    out = fem.Function(fem.functionspace(msh, ("Lagrange", 1)))
    out.x.array[out.function_space.dofmap.list] = values[cell_nodes(msh)]
    out.x.scatter_forward()
    return out


def size_from_distance(
    tool: RigidSurface, near: float, far: float, reach: float
) -> typing.Callable[[Array], Array]:
    """Make cell sizes that grow linearly with the distance from a rigid tool. Collective.

    The distance is that from the present position of the tool.

    Args:
        tool: The tool. If it has facets, they are gathered on all ranks.
        near: Size at the tool (length).
        far: Size at the distance ``reach`` and beyond (length).
        reach: Distance from the tool (length).

    Returns:
        A function of points (3, n), for :func:`qs.remesh`.

    Raises:
        TypeError: If ``tool`` is not a rigid tool.
        ValueError: If a length is not positive.
    """
    check(instance(RigidSurface, "a RigidSurface"), tool=tool)
    with checked(tool.comm) as same:
        same(POSITIVE, near=near, far=far, reach=reach)
    distance = _distance(tool)

    def size(x: Array) -> Array:
        part = np.clip(np.abs(distance(np.ascontiguousarray(x.T))) / reach, 0.0, 1.0)
        return np.asarray(near + (far - near) * part)

    return size


def _distance(tool: RigidSurface) -> typing.Callable[[Array], Array]:
    position = tool.position.copy()
    if tool.is_analytic:
        return lambda points: tool.distance(points, position)[0]
    facets = np.concatenate(tool.comm.allgather(tool.facet_positions(position)))
    if facets.shape[1] == 2:

        def of_segments(points: Array) -> Array:
            p, q = facets[None, :, 0], facets[None, :, 1]
            t = closest_on_segments(points[:, None], p, q)
            at = p + t[..., None] * (q - p)
            return np.asarray(np.linalg.norm(at - points[:, None], axis=2).min(axis=1))

        return of_segments
    if facets.shape[1] == 4:
        facets = np.concatenate([facets[:, [0, 1, 2]], facets[:, [1, 3, 2]]])
    x = facets.reshape(-1, 3)
    triangles = np.arange(len(x)).reshape(-1, 3)
    search = Triangles(x, triangles)

    def of_triangles(points: Array) -> Array:
        found, weights = search.closest(points)
        at = np.einsum("pi,pij->pj", weights, x[triangles[found]])
        return np.asarray(np.linalg.norm(at - points, axis=1))

    return of_triangles


def size_from_field(
    field: typing.Any, values: npt.ArrayLike, sizes: npt.ArrayLike, body: mesh.Mesh
) -> fem.Function:
    """Compute cell sizes from a field, such as a strain, by linear interpolation. Collective.

    Args:
        field: Scalar Function or UFL expression on the body's mesh; its means around the vertices
            are used.
        values: Values of the field in ascending order, shape (n,).
        sizes: Cell sizes at these values (length), shape (n,).
        body: The mesh.

    Returns:
        Function of degree 1 on ``body``.

    Raises:
        ValueError: If the values are not in ascending order, or a size is not positive.
    """
    check(MESH, body=body)
    with checked(body.comm) as same:
        at = check_array("values", values, (None,))
        wanted = check_array("sizes", sizes, at.shape)
        require(len(at) > 0 and np.all(np.diff(at) > 0), "values: must ascend")
        require(np.all(wanted > 0), "sizes: must be positive")
        same(values=at, sizes=wanted)
    out = fem.Function(fem.functionspace(body, ("Lagrange", 1)))
    v = ufl.TestFunction(out.function_space)
    sums = [
        _assembled(f * v * ufl.dx(domain=body))
        for f in (field, fem.Constant(body, np.float64(1.0)))
    ]
    out.x.array[:] = np.interp(sums[0] / sums[1], at, wanted)
    out.x.scatter_forward()
    return out


def _assembled(form: typing.Any) -> Array:
    b = fem.assemble_vector(fem.form(form))
    b.scatter_reverse(la.InsertMode.add)
    b.scatter_forward()
    return np.array(b.array)


def where(body: mesh.Mesh | fem.Function) -> tuple[mesh.Mesh, Array]:
    """The mesh of a body, and the coordinates of its nodes, displaced if a displacement is given.

    Collective.

    Raises:
        ValueError: If a displacement has another number of components than the mesh.
    """
    if isinstance(body, mesh.Mesh):
        return body, np.array(body.geometry.x, dtype=np.float64)
    check(FUNCTION, body=body)
    msh = body.function_space.mesh
    gdim = msh.geometry.dim
    require(body.ufl_shape == (gdim,), f"body: a displacement must have {gdim} components")
    element = body.function_space.sub(0).element.basix_element
    require(not element.discontinuous, "body: a displacement must be continuous, such as P1")
    x = np.array(msh.geometry.x, dtype=np.float64)
    x[:, :gdim] += at_nodes(body)
    return msh, x
