"""Checkpoints: store functions and arrays, and load them on any number of ranks."""

from __future__ import annotations

import json
import pathlib
import shutil
import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem, mesh

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.compat import cell_nodes, coordinate_element, interpolation_points
from qsdolfinx.steps.rendezvous import digests, find

Array = npt.NDArray[np.float64]
Keys = npt.NDArray[np.int64]

_MANIFEST = "checkpoint.json"


class StoredPoints:
    """Points of a checkpoint: keys that identify them on any partition, and values.

    Args:
        comm: Communicator of the ranks, each of which has a share of the points.
        known: Keys of this rank's share, (points, n). Several points may have the same keys.
        values: Their values, (points, m).
    """

    def __init__(self, comm: MPI.Intracomm, known: Keys, values: Array) -> None:
        self._comm, self._known, self._values = comm, known, values

    def find(self, keys: Keys) -> tuple[Keys, Array]:
        """Keys and values of all points that have one of these keys, from any rank. Collective.

        Args:
            keys: The keys, (wanted, n).

        Returns:
            Keys and values, (found, n) and (found, m).
        """
        wanted = np.unique(keys, axis=0)
        number, found = find(self._comm, self._known, self._values, wanted)
        return wanted[number], found


class Checkpoint:
    """State of functions and meshes in a folder.

    Values are stored with the input numbers of their vertices. A program that creates the same
    meshes can therefore load them on another partition and number of ranks. A folder is written
    under another name and renamed when it is complete; only then the folder before is removed.

    Args:
        comm: Communicator of all stored objects.
        folder: The folder.
    """

    def __init__(self, comm: MPI.Intracomm, folder: str | pathlib.Path) -> None:
        self._comm = comm
        self._folder = pathlib.Path(folder)

    def save(
        self,
        functions: typing.Mapping[str, fem.Function],
        meshes: typing.Mapping[str, tuple[mesh.Mesh, Array]],
        values: typing.Mapping[str, typing.Any],
        whole: typing.Mapping[str, typing.Mapping[str, npt.NDArray[typing.Any]]] | None = None,
        points: typing.Mapping[str, tuple[Keys, Array]] | None = None,
    ) -> None:
        """Write a checkpoint. Collective.

        Args:
            functions: Functions with at most one node per vertex, edge, face or cell: P1, P2, MINI
                and mixed spaces of them, piecewise constants; or of quadrature elements.
            meshes: Meshes with the coordinates to store, shape (geometry nodes, 3).
            values: Values that JSON can store, the same on all ranks.
            whole: Arrays of rank 0 for each file, see :meth:`arrays`.
            points: Keys that identify points on any partition, and values of the points, see
                :meth:`points`; shapes (points, n) each. Several points may have the same keys.

        Raises:
            ValueError: If the nodes of a function cannot be identified by vertices.
            OSError: If files cannot be written; the checkpoint before is then unchanged.
        """
        identities = _identities(self._comm, functions, meshes)
        aside = self._folder.with_name(self._folder.name + ".new")
        with collective_errors(self._comm):
            if self._comm.rank == 0:
                shutil.rmtree(aside, ignore_errors=True)
                aside.mkdir(parents=True)
        try:
            with collective_errors(self._comm):
                for name, arrays in (whole or {}).items() if self._comm.rank == 0 else ():
                    np.savez(aside / f"{name}.npz", **arrays)  # type: ignore[arg-type]
            self._write(aside, functions, meshes, dict(values), identities, points or {})
        except Exception:
            if self._comm.rank == 0:  # all ranks have finished writing
                shutil.rmtree(aside, ignore_errors=True)
            raise

    def _write(
        self,
        aside: pathlib.Path,
        functions: typing.Mapping[str, fem.Function],
        meshes: typing.Mapping[str, tuple[mesh.Mesh, Array]],
        values: dict[str, typing.Any],
        identities: dict[str, list[int]],
        points: typing.Mapping[str, tuple[Keys, Array]],
    ) -> None:
        """Write all files into the new folder, and replace the old one by it."""
        with collective_errors(self._comm):
            arrays: dict[str, npt.NDArray[typing.Any]] = {}
            for name, function in functions.items():
                keys, dofs = _function_keys(name, function)
                owned = function.function_space.dofmap
                own = dofs < owned.index_map.size_local * owned.index_map_bs
                arrays[f"{name}/keys"] = keys[own]
                arrays[f"{name}/values"] = function.x.array[dofs[own]][:, None]
            for name, (msh, x) in meshes.items():
                arrays[f"{name}/keys"] = _geometry_keys(msh)
                arrays[f"{name}/values"] = x
            for name, (keys, of_points) in points.items():
                arrays[f"{name}/keys"], arrays[f"{name}/values"] = keys, of_points
            np.savez(aside / f"{self._comm.rank}.npz", **arrays)  # type: ignore[arg-type]
        with collective_errors(self._comm):
            if self._comm.rank == 0:
                content = {"ranks": self._comm.size, "values": values, "of": identities}
                (aside / _MANIFEST).write_text(json.dumps(content))
                self._replace(aside)

    def _replace(self, aside: pathlib.Path) -> None:
        """Replace the old folder by the new one."""
        old = self._folder.with_name(self._folder.name + ".old")
        shutil.rmtree(old, ignore_errors=True)
        if self._folder.exists():
            self._folder.rename(old)
        aside.rename(self._folder)
        shutil.rmtree(old, ignore_errors=True)

    def _read(self) -> tuple[pathlib.Path, dict[str, typing.Any]]:
        """Folder that holds the checkpoint, and its manifest."""
        folder = self._folder
        if not folder.exists():  # a process was stopped between two renames
            folder = folder.with_name(folder.name + ".old")
        if not (folder / _MANIFEST).exists():
            raise FileNotFoundError(f"there is no checkpoint in {self._folder}")
        return folder, json.loads((folder / _MANIFEST).read_text())

    def values(self) -> dict[str, typing.Any]:
        """Read the values only. Collective.

        Raises:
            OSError: If there is no checkpoint.
        """
        with collective_errors(self._comm):
            _, content = self._read()
        return typing.cast(dict[str, typing.Any], content["values"])

    def arrays(self, name: str) -> dict[str, npt.NDArray[typing.Any]] | None:
        """Arrays of a file on rank 0, empty on others; None on rank 0 without the file. Collective.

        Raises:
            OSError: If there is no checkpoint.
        """
        with collective_errors(self._comm):
            folder, _ = self._read()
            if self._comm.rank > 0:
                return {}
            if not (folder / f"{name}.npz").exists():
                return None
            with np.load(folder / f"{name}.npz") as file:
                return {key: file[key] for key in file.files}

    def points(self, name: str) -> StoredPoints | None:
        """Stored points, of which each rank has a share; None if there are none. Collective.

        Args:
            name: Name of the stored points.

        Raises:
            OSError: If there is no checkpoint.
        """
        with collective_errors(self._comm):
            known, values = self._stored([name])[name]
        if not self._comm.allreduce(known.shape[1], op=MPI.MAX):
            return None
        return StoredPoints(self._comm, *_as_wide(self._comm, known, values))

    def _stored(self, names: typing.Iterable[str]) -> dict[str, tuple[Keys, Array]]:
        """Keys and values in this rank's share of the files; one rank reads each file.

        Names that are not in these files have empty arrays.
        """
        folder, content = self._read()
        parts: dict[str, list[tuple[Keys, Array]]] = {name: [] for name in names}
        for rank in range(self._comm.rank, content["ranks"], self._comm.size):
            with np.load(folder / f"{rank}.npz") as file:
                for name, part in parts.items():
                    if f"{name}/keys" in file:
                        part.append((file[f"{name}/keys"], file[f"{name}/values"]))
        return {name: _joined(part) for name, part in parts.items()}

    def load(
        self,
        functions: typing.Mapping[str, fem.Function],
        meshes: typing.Mapping[str, tuple[mesh.Mesh, Array]],
    ) -> None:
        """Read a checkpoint into the functions and coordinates. Collective.

        Raises:
            OSError: If there is no checkpoint.
            ValueError: If the checkpoint is of another problem; nothing is changed then.
        """
        identities = _identities(self._comm, functions, meshes)
        with collective_errors(self._comm):
            _, content = self._read()
            for name, identity in identities.items():
                if name not in content["of"]:
                    raise ValueError(f"{name}: is not in the checkpoint {self._folder}")
                if content["of"][name] != identity:
                    raise ValueError(
                        f"{name}: the checkpoint {self._folder} is of another mesh or space"
                    )
            targets: dict[str, tuple[Keys, Array, typing.Callable[[Array], None]]] = {}
            for name, function in functions.items():
                keys, dofs = _function_keys(name, function)
                targets[name] = keys, np.full((len(keys), 1), np.nan), _writer(function, dofs)
            for name, (msh, x) in meshes.items():
                targets[name] = _geometry_keys(msh), np.full_like(x, np.nan), _copier(x)
            stored = self._stored(targets)
        for name, (keys, found, _) in targets.items():
            number, values = find(self._comm, *_as_wide(self._comm, *stored[name]), keys)
            found[number] = values
        with collective_errors(self._comm):
            for name, (_, found, _) in targets.items():
                if np.isnan(found).any():
                    raise ValueError(f"{name}: the checkpoint {self._folder} is incomplete")
        for _, found, write in targets.values():
            write(found)


def _writer(function: fem.Function, dofs: npt.NDArray[np.int32]) -> typing.Callable[[Array], None]:
    def write(values: Array) -> None:
        function.x.array[dofs] = values[:, 0]

    return write


def _copier(x: Array) -> typing.Callable[[Array], None]:
    def write(values: Array) -> None:
        x[:] = values

    return write


def _joined(parts: list[tuple[Keys, Array]]) -> tuple[Keys, Array]:
    """Keys and values of several files; none, of no columns, of no file."""
    if not parts:
        return np.zeros((0, 0), np.int64), np.zeros((0, 0))
    return np.concatenate([k for k, _ in parts]), np.concatenate([v for _, v in parts])


def _as_wide(comm: MPI.Intracomm, known: Keys, values: Array) -> tuple[Keys, Array]:
    """Give arrays of ranks that have read no file as many columns as others have. Collective."""
    width = np.array([known.shape[1], values.shape[1]])
    comm.Allreduce(MPI.IN_PLACE, width, op=MPI.MAX)
    if len(known) == 0:
        return np.zeros((0, width[0]), np.int64), np.zeros((0, width[1]))
    return known, values


def _identities(
    comm: MPI.Intracomm,
    functions: typing.Mapping[str, fem.Function],
    meshes: typing.Mapping[str, tuple[mesh.Mesh, Array]],
) -> dict[str, list[int]]:
    """Identify meshes and spaces on any partition. Collective.

    Returns:
        Number of unknowns and a digest of the cells, by name.
    """
    of = {name: [_digest(comm, msh), msh.geometry.dim] for name, (msh, _) in meshes.items()}
    for name, function in functions.items():
        V = function.function_space
        size = V.dofmap.index_map.size_global * V.dofmap.index_map_bs
        of[name] = [_digest(comm, V.mesh), size]
    return of


def _digest(comm: MPI.Intracomm, msh: mesh.Mesh) -> int:
    """Sum of digests of the cells' sorted input numbers. Collective."""
    count = msh.topology.index_map(msh.topology.dim).size_local
    nodes = np.sort(msh.geometry.input_global_indices[cell_nodes(msh)[:count]], axis=1)
    total = np.array(digests(nodes).sum(dtype=np.uint64))
    comm.Allreduce(MPI.IN_PLACE, total)
    return int(total)


def _geometry_keys(msh: mesh.Mesh) -> Keys:
    return np.asarray(msh.geometry.input_global_indices, dtype=np.int64)[:, None]


def _function_keys(name: str, function: fem.Function) -> tuple[Keys, npt.NDArray[np.int32]]:
    """Local unknowns, and keys that identify them on any partition.

    Returns:
        Keys, shape (unknowns, n): number of the field, component, and the sorted input numbers of
        the vertices of the unknown's vertex, edge, face or cell; and the unknowns.

    Raises:
        ValueError: If more than one node belongs to such an entity, or a node has a direction,
            unless the nodes are the points of a quadrature rule.
    """
    keys, unknowns = [], []
    for number, V in enumerate(_leaves(function.function_space)):
        layout, topology = V.dofmap.dof_layout, _cell_topology(V.mesh)
        several = any(
            len(layout.entity_dofs(dim, j)) > 1
            for dim, n in enumerate(topology)
            for j in range(len(n))
        )
        at_points = bool(getattr(V.ufl_element(), "is_quadrature", False))
        if (several and not at_points) or V.element.needs_dof_transformations:
            raise ValueError(
                f"{name}: a checkpoint holds functions with one node per vertex, edge, face or "
                "cell, or at quadrature points"
            )
        field_keys, field_unknowns = _point_keys(V) if at_points else _leaf_keys(V)
        head = np.full((len(field_keys), 1), number)
        keys.append(np.hstack([head, field_keys]))
        unknowns.append(field_unknowns)
    every = np.concatenate(unknowns)
    dofs, first = np.unique(every, return_index=True)
    return np.vstack(keys)[first], dofs.astype(np.int32)


def _leaves(V: fem.FunctionSpace) -> list[fem.FunctionSpace]:
    """The scalar and blocked spaces of a mixed space."""
    if V.num_sub_spaces == 0 or V.dofmap.dof_layout.block_size > 1:
        return [V]
    return [leaf for i in range(V.num_sub_spaces) for leaf in _leaves(V.sub(i))]


def _cell_topology(msh: mesh.Mesh) -> list[list[list[int]]]:
    """Vertices of the reference cell's entities of each dimension."""
    cell = getattr(basix.CellType, msh.topology.cell_type.name)
    return basix.topology(cell)


def _cell_vertices(msh: mesh.Mesh) -> Keys:
    """Input numbers of the vertices of this rank's cells, (cells, vertices)."""
    layout = coordinate_element(msh).create_dof_layout()
    places = [layout.entity_dofs(0, v)[0] for v in range(len(_cell_topology(msh)[0]))]
    return np.asarray(msh.geometry.input_global_indices[cell_nodes(msh)[:, places]], dtype=np.int64)


def _unrolled(V: fem.FunctionSpace) -> Keys:
    """Local unknowns of the cells, consecutive for each node, (cells, unknowns)."""
    bs, unrolled = V.dofmap.dof_layout.block_size, V.dofmap.list
    if V.dofmap.bs == bs:
        # A rank may have no cells: reshape cannot infer the size then.
        width = unrolled.shape[1] * bs
        unrolled = (unrolled[:, :, None] * bs + np.arange(bs)).reshape(len(unrolled), width)
    return np.asarray(unrolled, dtype=np.int64)


def _point_keys(V: fem.FunctionSpace) -> tuple[Keys, Keys]:
    """Keys and local unknowns of a quadrature element.

    A partition may permute a cell's vertices, and so its points. Points are therefore numbered by
    their barycentric weights, with the vertices in the order of their input numbers.
    """
    kind = getattr(basix.CellType, V.mesh.topology.cell_type.name)
    linear = basix.create_element(basix.ElementFamily.P, kind, 1)
    points = interpolation_points(V)
    weights: Array = np.round(np.asarray(linear.tabulate(0, points))[0, :, :, 0], 9)
    nodes, unrolled, bs = _cell_vertices(V.mesh), _unrolled(V), V.dofmap.dof_layout.block_size
    order = np.argsort(nodes, axis=1)
    number = np.empty((len(nodes), len(points)), dtype=np.int64)
    for turned in np.unique(order, axis=0):
        alike = (order == turned).all(axis=1)
        rank = np.empty(len(points), dtype=np.int64)
        rank[np.lexsort(weights[:, turned].T)] = np.arange(len(points))
        number[alike] = rank
    place = (number[:, :, None] * bs + np.arange(bs)).reshape(unrolled.shape)
    vertices = np.repeat(np.sort(nodes, axis=1), unrolled.shape[1], axis=0)
    return np.hstack([place.reshape(-1, 1), vertices]), unrolled.ravel()


def vertex_unknowns(V: fem.FunctionSpace) -> tuple[Keys, Keys]:
    """First unknown on this rank of each vertex of the cells, and the vertex' input number."""
    keys, unknowns = _leaf_keys(V)
    of_vertices = (keys[:, 0] == 0) & (keys[:, 1] >= 0) & np.all(keys[:, 2:] < 0, axis=1)
    return unknowns[of_vertices], keys[of_vertices, 1]


def _leaf_keys(V: fem.FunctionSpace) -> tuple[Keys, Keys]:
    """Keys and local unknowns of a scalar or blocked space."""
    msh, layout = V.mesh, V.dofmap.dof_layout
    topology, nodes, unrolled = _cell_topology(msh), _cell_vertices(msh), _unrolled(V)
    vertex_count, bs = len(topology[0]), layout.block_size
    keys, unknowns = [], []
    for dim, entities in enumerate(topology):
        for j, vertices in enumerate(entities):
            dofs = layout.entity_dofs(dim, j)
            for dof in dofs:
                name = np.full((len(nodes), vertex_count + 1), -1, dtype=np.int64)
                name[:, 1 : 1 + len(vertices)] = np.sort(nodes[:, vertices], axis=1)
                for component in range(bs):
                    name[:, 0] = component
                    keys.append(name.copy())
                    unknowns.append(unrolled[:, dof * bs + component].astype(np.int64))
    return np.vstack(keys), np.concatenate(unknowns)
