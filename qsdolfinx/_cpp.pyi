"""The C++ extension; see the headers in cpp/."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Ranks = npt.NDArray[np.int32]

class Surface:
    def __init__(
        self,
        comm: int,
        gdim: int,
        num_vertices: int,
        x: Array,
        degree: int,
        dofs: Indices,
        owner: Ranks,
        inside: Array,
        local_size: int,
        axisymmetric: bool,
    ) -> None: ...
    def move(self, x: Array, inside: Array) -> None: ...
    @property
    def facet_size_range(self) -> list[float]: ...
    @property
    def facet_x(self) -> Array: ...
    @property
    def facet_dofs(self) -> Indices: ...
    @property
    def node_dofs(self) -> Indices: ...
    @property
    def node_x(self) -> Array: ...
    @property
    def node_area(self) -> Array: ...
    @property
    def node_normal(self) -> Array: ...

def mean_of_rows(x: Array, rows: Ranks) -> Array: ...
def count_degenerate(num_vertices: int, x: Array) -> int: ...

class PairingPoints:
    @property
    def size(self) -> int: ...
    @property
    def slave(self) -> dict[str, Any]: ...
    @property
    def master(self) -> dict[str, Any]: ...
    @property
    def normal(self) -> Array: ...
    @property
    def gap(self) -> Array: ...
    @property
    def weight(self) -> Array: ...
    @property
    def multiplier_values(self) -> Array: ...
    @property
    def num_unpaired(self) -> int: ...

def overlay_surfaces(
    slave: Surface,
    master: Surface,
    both: bool,
    radius: float,
    normals: int,
    piece_x: Array,
    piece_w: Array,
    edge_x: Array,
    edge_w: Array,
) -> PairingPoints: ...
def pair_surfaces(
    slave: Surface, master: Surface, both: bool, radius: float, normals: int
) -> PairingPoints: ...
def closest_facets(
    nodes: Surface, surface: Surface, radius: float
) -> tuple[npt.NDArray[np.uint8], Array]: ...
def closest_point(
    num_vertices: int, vertices: Array, p: Array
) -> tuple[float, list[float], list[float]]: ...
def sample_nodes(slave: Surface) -> PairingPoints: ...
def sample_facets(slave: Surface, x: Array, w: Array) -> PairingPoints: ...
def face_tool(
    points: PairingPoints, keep: npt.NDArray[np.uint8], normal: Array, gap: Array, group: int
) -> None: ...
def forget_master(points: PairingPoints) -> None: ...

class GapOperator:
    def __init__(
        self,
        slave: Surface,
        master: Surface | None,
        points: PairingPoints,
        jump: bool,
        by_cover: bool,
    ) -> None: ...
    @property
    def num_rows(self) -> int: ...
    @property
    def width(self) -> int: ...
    @property
    def row_node(self) -> Indices: ...
    @property
    def row_area(self) -> Array: ...
    @property
    def initial_gap(self) -> Array: ...
    @property
    def slave_sum(self) -> Array: ...
    def apply(self, slave: int, master: int, scale: tuple[float, float] = (1.0, 1.0)) -> Array: ...
    def add_transpose(self, f: Array, slave: int, master: int, slave_only: bool) -> None: ...
    def constrain(self, slave: int, master: int) -> None: ...

def insert_contact(
    gap: GapOperator,
    stiffness: Array,
    blocks: list[int],
    scale: tuple[float, float],
    slave_only: bool,
    pattern: bool,
) -> None: ...
def insert_friction(
    jump: GapOperator,
    normal: GapOperator,
    stiffness: Array,
    coupling: Array,
    blocks: list[int],
    scale: tuple[float, float],
    slave_only: bool,
) -> None: ...
def put_rows(
    block: int,
    matrix: int,
    rows: Ranks,
    row_numbers: tuple[Indices, Indices],
    column_numbers: tuple[Indices, Indices],
    mode: int,
) -> None: ...
def count_entries(block: int) -> Ranks: ...
