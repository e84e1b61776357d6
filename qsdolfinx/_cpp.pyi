from collections.abc import Sequence
from typing import Any, overload

import numpy
import numpy.typing

class CompressedRows:
    """Rows of this rank by all unknowns; see tangent/products.h."""

    def __init__(
        self,
        offset: numpy.typing.NDArray[numpy.int64],
        column: numpy.typing.NDArray[numpy.int64],
        value: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """First entry of each row, [row + 1]; numbers and values, [entry]."""

class FunctionsOfPieces:
    """How functions move at the points of pieces; see gap/point_rows.h."""

    def __init__(
        self,
        pieces: Pieces,
        field: int,
        rest: numpy.typing.NDArray[numpy.float64],
        moves: bool,
        markers: Sequence[int],
        turning: numpy.typing.NDArray[numpy.float64],
        component: int,
    ) -> None:
        """Of a field of the sides of the slave's nodes, and numbers at the points; collective."""

    def entries(
        self, side: int
    ) -> tuple[
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.float64],
    ]:
        """Unknowns of sides of nodes, of one body (-1 if held), and values, [entry]."""

class GapOperator:
    """Weighted gaps of the slave nodes of this rank; see gap/gap.h."""

    @overload
    def __init__(
        self, slave: Surface, master: Surface | None, points: PairingPoints, jump: bool, rows: int
    ) -> None:
        """Rows are nodes (0), nodes with what is covered of them (1), or points (2); collective."""

    @overload
    def __init__(
        self,
        slave: Surface,
        master: Surface | None,
        points_of: Pieces,
        *,
        alone: numpy.typing.NDArray[numpy.int64],
        weight: numpy.typing.NDArray[numpy.float64],
        far: float,
    ) -> None:
        """Derivative of gaps that follow the bodies, a row for each point of pieces; see gap/gap.h; collective."""

    @overload
    def __init__(
        self,
        slave: Surface,
        master: Surface | None,
        jump_of: Pieces,
        *,
        alone: numpy.typing.NDArray[numpy.int64],
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Jump of places at these points; see gap/gap.h; collective."""

    @overload
    def __init__(
        self,
        slave: Surface,
        master: Surface | None,
        points_of: Pieces,
        slip: SlipOfPieces,
        *,
        works: bool,
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Derivative of slip at these points, or what tractions work on there; collective."""

    @overload
    def __init__(
        self,
        slave: Surface,
        master: Surface | None,
        moving: Pieces,
        slip: SlipOfPieces,
        *,
        leaning: numpy.typing.NDArray[numpy.float64],
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """The former with what points move by; see gap/point_rows.h; collective."""

    @overload
    def __init__(
        self,
        slave: Surface,
        master: Surface | None,
        moving: Pieces,
        *,
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Derivative of gaps with what points move by; see gap/gap.h; collective."""

    @overload
    def __init__(
        self,
        slave: Surface,
        master: Surface | None,
        points_of: Pieces,
        functions: FunctionsOfPieces,
        *,
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Gradients of their field at these points; collective."""

    @property
    def num_rows(self) -> int: ...
    @property
    def turns(self) -> bool:
        """Whether a jump turns with facets."""

    @property
    def width(self) -> int:
        """Values per row: 1, or of a jump those of a node."""

    @property
    def row_node(self) -> numpy.typing.NDArray[numpy.int64]:
        """Index of each row's node in the slave's nodes, [row]; empty if rows are points."""

    @property
    def row_side(self) -> numpy.typing.NDArray[numpy.uint8]:
        """Side of the row's node, [row]; empty if there are none to tell apart."""

    @property
    def row_in_corner(self) -> numpy.typing.NDArray[numpy.uint8]:
        """Whether the node may have a row for each side, likewise."""

    @property
    def row_area(self) -> numpy.typing.NDArray[numpy.float64]:
        """What each row's gap is divided by: S_k, its covered part, or w_p, [row]."""

    @property
    def initial_gap(self) -> numpy.typing.NDArray[numpy.float64]:
        """Initial weighted gap, zero for a jump, [row]."""

    @property
    def slave_sum(self) -> numpy.typing.NDArray[numpy.float64]:
        """Sum of the slave's coefficients, [row][gdim], of a jump [row][1]."""

    def entries(
        self, side: int
    ) -> tuple[
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.int32],
        numpy.typing.NDArray[numpy.float64],
    ]:
        """Of one side: first entry of each row, [row + 1]; place of its node among the columns, [entry]; coefficients, [entry][gdim], of a jump [entry][1], or [entry][gdim * gdim] if it turns."""

    def columns(self, side: int) -> numpy.typing.NDArray[numpy.int64]:
        """Unknowns of one side's nodes, -1 where conditions hold, [column][block]."""

    @property
    def num_sides(self) -> int:
        """2, or 1 if the master is rigid."""

    def apply(
        self, slave: int, master: int, scale: Sequence[float] = [1.0, 1.0]
    ) -> numpy.typing.NDArray[numpy.float64]:
        """Linear part of the gap, [row][width]; collective."""

    def add_transpose(
        self, f: numpy.typing.NDArray[numpy.float64], slave: int, master: int
    ) -> None:
        """Add the transposed operator times f; collective."""

    @property
    def functions(
        self,
    ) -> tuple[
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.float64],
    ]:
        """N_k at points: first entry of each row, [row + 1]; unknowns that stand for a side of a node, and values, [entry]."""

    def at_points(self, nodal: int) -> numpy.typing.NDArray[numpy.float64]:
        """Values at the points of a field on the slave, a component for each side; collective."""

    def add_to_nodes(self, f: numpy.typing.NDArray[numpy.float64], nodal: int) -> None:
        """Add the sums of N_k times values of the points; collective."""

    def raise_nodes(self, f: numpy.typing.NDArray[numpy.float64], nodal: int) -> None:
        """Raise nodes to the largest value of the points beside them; collective."""

    def constrain(self, slave: int, master: int) -> None:
        """Mark constrained unknowns; collective."""

class PairingPoints:
    """Pairing points of one pass; see pairing/pairing.h."""

    @property
    def size(self) -> int: ...
    @property
    def slave(self) -> dict[str, Any]:
        """Arrays of the slave's side: x, dofs, owner, shape_values."""

    @property
    def master(self) -> dict[str, Any]:
        """Those of the master's side."""

    @property
    def multiplier_values(self) -> numpy.typing.NDArray[numpy.float64]:
        """Functions of the multipliers, [point][slave vertex]."""

    @property
    def normal(self) -> numpy.typing.NDArray[numpy.float64]:
        """Unit normals outward of the slave, [point][3]."""

    @property
    def gap(self) -> numpy.typing.NDArray[numpy.float64]:
        """Signed distances, positive when open, [point]."""

    @property
    def weight(self) -> numpy.typing.NDArray[numpy.float64]:
        """Areas, [point]."""

    def with_alone(
        self,
        unknown: numpy.typing.NDArray[numpy.int64],
        weight: numpy.typing.NDArray[numpy.float64],
        far: float,
    ) -> PairingPoints:
        """The same points, and some that see one multiplier each; see pairing/pairing.h."""

    def scaled(self, factor: numpy.typing.NDArray[numpy.float64]) -> PairingPoints:
        """The same points, their weights multiplied by factors [point]."""

    def turning(
        self,
        slave: numpy.typing.NDArray[numpy.float64],
        master: numpy.typing.NDArray[numpy.float64],
    ) -> PairingPoints:
        """The same points, jumps turning with facets: what the nodes of each side add to a jump, [point][node][block][block]."""

    @property
    def num_of_slave(self) -> int:
        """Points of the overlay that facets of the slave were cut for: the first ones."""

    @property
    def num_unpaired(self) -> int:
        """Owned nodes (overlay: facets) that found no partner."""

    @property
    def num_corners(self) -> int:
        """Owned nodes of both surfaces in the corner of several walls."""

    @property
    def by_sides(self) -> bool:
        """Whether nodes in corners have a multiplier for each smooth side."""

    @property
    def in_corner(self) -> numpy.typing.NDArray[numpy.uint8]:
        """Which owned nodes do, [node]; empty if not by_sides."""

class Pieces:
    """Pieces of the overlay; see pairing/pieces.h."""

    @property
    def size(self) -> int: ...
    @property
    def gdim(self) -> int: ...
    @property
    def num_missed(self) -> int:
        """Pieces with a ray that meets no point."""

    @property
    def num_points(self) -> int: ...
    def cover(self) -> numpy.typing.NDArray[numpy.float64]:
        """Areas that points cover of the slave's nodes, [piece, k]."""

    def side_dofs(self) -> numpy.typing.NDArray[numpy.int64]:
        """Unknowns that stand for the sides of these nodes, likewise."""

    def gaps(self) -> numpy.typing.NDArray[numpy.float64]:
        """Distances along the rays, positive when open, [point]."""

    def raise_facets(self, normals: int) -> None:
        """Let facets before vertices stand for a curved surface; collective."""

    def gaps_by_normals(
        self,
    ) -> tuple[
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.float64],
    ]:
        """Derivatives of gaps by the normals that facets are raised with: points, unknowns that stand for components of normals, values."""

    def forces_by_normals(
        self, stress: numpy.typing.NDArray[numpy.float64], slips: bool
    ) -> tuple[
        tuple[
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.float64],
        ],
        tuple[
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.int64],
            numpy.typing.NDArray[numpy.float64],
        ],
    ]:
        """The same of forces of pressures or tractions, on both bodies; rows are unknowns."""

    def functions(self) -> numpy.typing.NDArray[numpy.float64]:
        """Functions of the slave's vertices at the points, [point][k]."""

    def facets(self) -> numpy.typing.NDArray[numpy.int64]:
        """What tells apart between which facets points are, and which was cut, [point][n]."""

    def slave_sizes(self) -> numpy.typing.NDArray[numpy.float64]:
        """Size of the slave's facet at each point, [point]."""

    def x(self) -> numpy.typing.NDArray[numpy.float64]:
        """Where the points are, [point][3]."""

class RayFacet:
    """A facet at its present place; see sliding/ray.h."""

    def __init__(
        self,
        num_vertices: int,
        degree: int,
        x: numpy.typing.NDArray[numpy.float64],
        orientation: float = 1.0,
    ) -> None:
        """From its trace nodes, [node][3]."""

class RayPoints:
    """Where rays begin and end."""

    def __init__(
        self,
        xi: numpy.typing.NDArray[numpy.float64],
        zeta: numpy.typing.NDArray[numpy.float64],
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """From places on the facet that is cut, guesses on the other one, both [point][2], and areas."""

    @property
    def zeta(self) -> numpy.typing.NDArray[numpy.float64]:
        """Places on the other facet, [point][2]."""

    @property
    def t(self) -> numpy.typing.NDArray[numpy.float64]:
        """Lengths of the rays, negative in penetration, [point]."""

class RowSums:
    """What is added to a matrix; see tangent/row_sums.h."""

    def __init__(self, matrix: int) -> None:
        """Of a matrix that must outlive it and is not assembled here."""

    def add_entries(
        self,
        rows: numpy.typing.NDArray[numpy.int64],
        columns: numpy.typing.NDArray[numpy.int64],
        values: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Add entries in any order, of any rank's rows; negative numbers are left out."""

    def add_squares(
        self,
        numbers: numpy.typing.NDArray[numpy.int64],
        values: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Add matrices, [block][row][row], by numbers [block][row]; negative ones are left out."""

    def insert(self) -> None:
        """Add all to the matrix."""

class SearchRadius:
    """How far from each other points may be that are paired: one distance, or the size of the larger facet there, if that is less."""

    def __init__(self, largest: float, by_size: bool = False) -> None: ...
    @property
    def largest(self) -> float:
        """Anywhere."""

class SlipOfPieces:
    """Slip at the points of pieces; see gap/point_rows.h."""

    def __init__(
        self, pieces: Pieces, slave: int, master: int, of_tool: numpy.typing.NDArray[numpy.float64]
    ) -> None:
        """From where nodes were when it began; collective."""

    @property
    def slip(self) -> numpy.typing.NDArray[numpy.float64]:
        """Of the slave against the master, [point][3]."""

    @property
    def normal(self) -> numpy.typing.NDArray[numpy.float64]:
        """Outward of the slave, [point][3]."""

    @property
    def arc(self) -> numpy.typing.NDArray[numpy.float64]:
        """Way along the facets over the slip, its chord, [point]."""

    @property
    def gap(self) -> numpy.typing.NDArray[numpy.float64]:
        """Gap of the same places when slip began, positive in penetration, [point]."""

class StackedRows:
    """Rows of points by all unknowns; see tangent/products.h."""

    def __init__(self, num_points: int, components: int) -> None: ...
    @property
    def components(self) -> int: ...
    def add_gaps(
        self,
        gap: GapOperator,
        side: int,
        numbers: numpy.typing.NDArray[numpy.int64],
        factor: float,
        first: int,
    ) -> None:
        """Add a factor times one side of an operator, in components from the first on; `numbers` are those of its unknowns, [column][block], negative where they are held."""

    def add_rows(self, rows: CompressedRows, factor: float, first: int, width: int) -> None:
        """Add a factor times rows, `width` for each point, likewise."""

    def entries(
        self,
    ) -> tuple[
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.float64],
    ]:
        """Rows, columns and values, [entry]."""

class Surface:
    """Distributed contact surface; see surface/surface.h."""

    def __init__(
        self,
        comm: int,
        gdim: int,
        block: int,
        num_vertices: int,
        x: numpy.typing.NDArray[numpy.float64],
        degree: int,
        dofs: numpy.typing.NDArray[numpy.int64],
        owner: numpy.typing.NDArray[numpy.int32],
        inside: numpy.typing.NDArray[numpy.float64],
        local_size: int,
        axisymmetric: bool,
        key: numpy.typing.NDArray[numpy.float64] | None = None,
    ) -> None:
        """Collective."""

    def move(
        self, x: numpy.typing.NDArray[numpy.float64], inside: numpy.typing.NDArray[numpy.float64]
    ) -> None:
        """Let the facets have other coordinates; collective."""

    def follow(self, trace_x: numpy.typing.NDArray[numpy.float64]) -> None:
        """Let the nodes of the trace have other coordinates, [facet][node][3]; local."""

    def measure_nodes(self) -> None:
        """Areas and normals of the nodes after `follow`; collective."""

    @property
    def facet_size_range(self) -> list[float]:
        """Smallest and largest facet size; collective."""

    @property
    def facet_x(self) -> numpy.typing.NDArray[numpy.float64]:
        """Coordinates of the vertices, [facet][vertex][3]."""

    @property
    def facet_dofs(self) -> numpy.typing.NDArray[numpy.int64]:
        """Global unknowns of the trace, [facet][node][block]."""

    def sides_of_facets(
        self, chosen: numpy.typing.NDArray[numpy.uint8]
    ) -> numpy.typing.NDArray[numpy.uint8]:
        """Smooth side of chosen nodes that a facet belongs to, 0 at others, [facet][vertex]; collective."""

    @property
    def vertex_side(self) -> numpy.typing.NDArray[numpy.uint8]:
        """Number of the smooth side of its vertices that a facet is part of, [facet][vertex]."""

    @property
    def node_dofs(self) -> numpy.typing.NDArray[numpy.int64]:
        """Global unknowns of the owned nodes, [node][block]."""

    @property
    def node_x(self) -> numpy.typing.NDArray[numpy.float64]:
        """Their coordinates, [node][3]."""

    @property
    def node_area(self) -> numpy.typing.NDArray[numpy.float64]:
        """Their areas S_k, [node]."""

    @property
    def node_facet_size(self) -> numpy.typing.NDArray[numpy.float64]:
        """Sizes of the largest facets at them, [node]."""

    @property
    def node_normal(self) -> numpy.typing.NDArray[numpy.float64]:
        """Their averaged outward unit normals, [node][3]."""

def add_curvature(
    sums: RowSums,
    pieces: Pieces,
    pressure: numpy.typing.NDArray[numpy.float64],
    moves: bool,
    numbers: Sequence[numpy.typing.NDArray[numpy.int64]],
    scale: Sequence[float],
) -> None:
    """Add how forces of pressures change as gaps bend and points move; numbers are those of unknowns, [piece][node][gdim]."""

def add_products(
    sums: RowSums, left: StackedRows, right: StackedRows, D: numpy.typing.NDArray[numpy.float64]
) -> None:
    """Add Lᵀ D R; D has a number for each row, or a matrix [component][component] for each point."""

def add_slip_curvature(
    sums: RowSums,
    pieces: Pieces,
    traction: numpy.typing.NDArray[numpy.float64],
    moves: bool,
    numbers: Sequence[numpy.typing.NDArray[numpy.int64]],
    scale: Sequence[float],
) -> None:
    """Add how forces of given tractions at points change, likewise."""

def closest_facets(
    nodes: Surface, surface: Surface, radius: SearchRadius
) -> tuple[numpy.typing.NDArray[numpy.uint8], numpy.typing.NDArray[numpy.float64]]:
    """Which owned nodes find a facet, [node], and the closest points, [node][3]; collective."""

def closest_point(
    num_vertices: int, vertices: numpy.typing.NDArray[numpy.float64], p: Sequence[float]
) -> tuple[float, list[float], list[float]]:
    """Closest point of one facet to p: distance, reference coordinates, position."""

def closest_points(
    x: numpy.typing.NDArray[numpy.float64],
    normal: numpy.typing.NDArray[numpy.float64],
    own: Surface,
    surface: Surface,
    radius: float,
) -> dict[str, Any]:
    """Of points x [point][3] of a surface the closest ones of another: found [point], x, normal and mean_normal of all facets there [point][3], dofs [point][node][block], owner and shape_values [point][node] of the facet; collective."""

def conforming_points(
    slave: Surface,
    master: Surface,
    radius: SearchRadius,
    piece_x: numpy.typing.NDArray[numpy.float64],
    piece_w: numpy.typing.NDArray[numpy.float64],
    edge_x: numpy.typing.NDArray[numpy.float64],
    edge_w: numpy.typing.NDArray[numpy.float64],
    slave_lift: int,
    slave_known: bool,
    slave_heights: numpy.typing.NDArray[numpy.float64],
    master_lift: int,
    master_known: bool,
    master_heights: numpy.typing.NDArray[numpy.float64],
) -> tuple[numpy.typing.NDArray[numpy.float64], float]:
    """Where surfaces are curved the same way, [point][slave, master, gap, weight], and the area of all that is paired on this rank; collective."""

def count_degenerate(num_vertices: int, x: numpy.typing.NDArray[numpy.float64]) -> int:
    """Number of facets x [facet][vertex][3] without area, or not convex."""

def count_entries(block: int) -> numpy.typing.NDArray[numpy.int32]:
    """Number of entries in own and in other columns, [2][row]."""

def edge_heights(surface: Surface) -> numpy.typing.NDArray[numpy.float64]:
    """How far the surface that facets stand for is over the middles of their edges, along their normals, [facet][edge]; collective."""

def face_tool(
    points: PairingPoints,
    keep: numpy.typing.NDArray[numpy.uint8],
    normal: numpy.typing.NDArray[numpy.float64],
    gap: numpy.typing.NDArray[numpy.float64],
    group: int,
) -> None:
    """Set normals and gaps, and drop points; see pairing/rigid.h."""

def facet_curvature(surface: Surface) -> numpy.typing.NDArray[numpy.float64]:
    """Curvature of the facets, [facet][xx, yy, zz, xy, xz, yz]; collective."""

def forget_master(points: PairingPoints) -> None:
    """Forget the unknowns of the master."""

def free_unknowns(pieces: Pieces, side: int, markers: int) -> numpy.typing.NDArray[numpy.int64]:
    """Unknowns of the slave (0) or master (1), negative where they are held, [piece][node][gdim]. Collective."""

def heights_at(
    surface: Surface,
    known: bool,
    heights: numpy.typing.NDArray[numpy.float64],
    x: numpy.typing.NDArray[numpy.float64],
    w: numpy.typing.NDArray[numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]:
    """Heights over the facets at quadrature points, facet by facet, of given heights at their nodes of degree 2 or of a curvature found from the facets' turning; collective."""

def insert_contact(
    gap: GapOperator,
    stiffness: numpy.typing.NDArray[numpy.float64],
    blocks: Sequence[int],
    scale: Sequence[float],
    pattern: bool,
) -> None:
    """Add Gᵀ D G to the blocks (ss, sm, ms, mm)."""

def insert_friction(
    jump: GapOperator,
    normal: GapOperator,
    stiffness: numpy.typing.NDArray[numpy.float64],
    coupling: numpy.typing.NDArray[numpy.float64],
    blocks: Sequence[int],
    scale: Sequence[float],
) -> None:
    """Add Jᵀ (D J + c G) to the blocks (ss, sm, ms, mm)."""

def keep_points(points: PairingPoints, which: numpy.typing.NDArray[numpy.uint8]) -> None:
    """Forget points but those, [point]."""

def mean_of_rows(
    x: numpy.typing.NDArray[numpy.float64], rows: numpy.typing.NDArray[numpy.int32]
) -> numpy.typing.NDArray[numpy.float64]:
    """Means of points x [point][3], one of each row of their numbers, [row][3]."""

def overlay_pieces(
    slave: Surface,
    master: Surface,
    both: bool,
    radius: SearchRadius,
    piece_x: numpy.typing.NDArray[numpy.float64],
    piece_w: numpy.typing.NDArray[numpy.float64],
    edge_x: numpy.typing.NDArray[numpy.float64],
    edge_w: numpy.typing.NDArray[numpy.float64],
) -> Pieces:
    """Pieces of surfaces that follow their bodies; collective."""

def overlay_surfaces(
    slave: Surface,
    master: Surface,
    both: bool,
    radius: SearchRadius,
    normals: int,
    piece_x: numpy.typing.NDArray[numpy.float64],
    piece_w: numpy.typing.NDArray[numpy.float64],
    edge_x: numpy.typing.NDArray[numpy.float64],
    edge_w: numpy.typing.NDArray[numpy.float64],
    slave_lift: int,
    slave_known: bool,
    slave_heights: numpy.typing.NDArray[numpy.float64],
    master_lift: int,
    master_known: bool,
    master_heights: numpy.typing.NDArray[numpy.float64],
) -> PairingPoints:
    """Pairing points on the overlay; the last arguments are a Relief each; collective."""

def pair_surfaces(
    slave: Surface,
    master: Surface,
    both: bool,
    radius: SearchRadius,
    normals: int,
    corners: bool = False,
) -> PairingPoints:
    """Nodal pairing points; collective."""

def pair_vertices(
    slave: Surface, master: Surface, which: numpy.typing.NDArray[numpy.uint8], radius: SearchRadius
) -> PairingPoints:
    """Points at some owned nodes of the slave, [node], with the closest places on the master; collective."""

def points_between(
    slave: Surface,
    master: Surface | None,
    x: numpy.typing.NDArray[numpy.float64],
    dofs: numpy.typing.NDArray[numpy.int64],
    owner: numpy.typing.NDArray[numpy.int32],
    values: numpy.typing.NDArray[numpy.float64],
    master_x: numpy.typing.NDArray[numpy.float64],
    master_dofs: numpy.typing.NDArray[numpy.int64],
    master_owner: numpy.typing.NDArray[numpy.int32],
    master_values: numpy.typing.NDArray[numpy.float64],
    multiplier_values: numpy.typing.NDArray[numpy.float64],
    side: numpy.typing.NDArray[numpy.uint8],
    normal: numpy.typing.NDArray[numpy.float64],
    gap: numpy.typing.NDArray[numpy.float64],
    weight: numpy.typing.NDArray[numpy.float64],
) -> PairingPoints:
    """Points between places that are known: of both sides positions [point][3], unknowns [point][node][block], owners and trace functions [point][node], the functions of the multipliers [point][slave vertex], and which of a vertex' multipliers they are of [point], normals, gaps and areas. A rigid master has no unknowns."""

def points_of_pieces(slave: Surface, master: Surface | None, pieces: Pieces) -> PairingPoints:
    """Points of pieces as pairing points without normals."""

def put_rows(
    block: int,
    matrix: int,
    rows: numpy.typing.NDArray[numpy.int32],
    row_numbers: Sequence[numpy.typing.NDArray[numpy.int64]],
    column_numbers: Sequence[numpy.typing.NDArray[numpy.int64]],
    mode: int,
) -> None:
    """Put rows of one body's block into the matrix of all bodies."""

def ray_curvature(
    cut: RayFacet,
    other: RayFacet,
    cut_is_slave: bool,
    points: RayPoints,
    pressure: numpy.typing.NDArray[numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]:
    """Second derivatives of the sum of weights times pressures times gaps, these held."""

def ray_functions(
    cut: RayFacet, other: RayFacet, cut_is_slave: bool, points: RayPoints
) -> numpy.typing.NDArray[numpy.float64]:
    """Those of the slave's vertex functions there, [point][vertex][node][3]."""

def ray_gaps(
    cut: RayFacet, other: RayFacet, cut_is_slave: bool, points: RayPoints
) -> numpy.typing.NDArray[numpy.float64]:
    """Gradients of the gaps of points, [point][node][3], the slave's nodes first."""

def ray_slip(
    cut: RayFacet,
    other: RayFacet,
    cut_is_slave: bool,
    points: RayPoints,
    cut_start: numpy.typing.NDArray[numpy.float64],
    other_start: numpy.typing.NDArray[numpy.float64],
) -> tuple[
    numpy.typing.NDArray[numpy.float64],
    numpy.typing.NDArray[numpy.float64],
    numpy.typing.NDArray[numpy.float64],
    numpy.typing.NDArray[numpy.float64],
]:
    """Slip at points since nodes were there, and the slave's normal, [point][3]; its gradient, and what tractions work on, [point][node][slip][component]."""

def ray_slip_curvature(
    cut: RayFacet,
    other: RayFacet,
    cut_is_slave: bool,
    points: RayPoints,
    tractions: numpy.typing.NDArray[numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]:
    """The derivative of the sum of weights times what tractions work on."""

def relief_nodes(surface: Surface) -> numpy.typing.NDArray[numpy.float64]:
    """Nodes of degree 2 on the flat facets, [facet][node][3]."""

def relief_normals(surface: Surface) -> numpy.typing.NDArray[numpy.float64]:
    """Outward unit normals of the flat facets there, [facet][node][3]."""

def sample_facets(
    slave: Surface, x: numpy.typing.NDArray[numpy.float64], w: numpy.typing.NDArray[numpy.float64]
) -> PairingPoints:
    """Quadrature points on the facets, without a master."""

def sample_nodes(slave: Surface) -> PairingPoints:
    """Points at the nodes, without a master."""

def sample_vertices(slave: Surface, which: numpy.typing.NDArray[numpy.uint8]) -> PairingPoints:
    """Points at some owned nodes, [node], of any degree, without a master."""

def set_places(
    matrix: int, rows: numpy.typing.NDArray[numpy.int64], columns: numpy.typing.NDArray[numpy.int64]
) -> None:
    """Fix the pattern of a matrix; places may be on any rank's rows and repeat. Collective."""

def set_values(matrix: int, values: numpy.typing.NDArray[numpy.float64]) -> None:
    """Replace the entries of a matrix, in the order of its places. Collective."""

def share_out_hardly_covered(points: PairingPoints, slave: Surface, least: float) -> int:
    """Let neighbours carry the multipliers of nodes that are hardly covered; collective."""

def solve_rays(cut: RayFacet, other: RayFacet, points: RayPoints) -> bool:
    """Find the ends of the rays, if all have one."""

def trace_gradients(
    num_vertices: int, degree: int, xi: numpy.typing.NDArray[numpy.float64]
) -> numpy.typing.NDArray[numpy.float64]:
    """Their derivatives, [point][node][2]."""

def trace_values(
    num_vertices: int, degree: int, xi: numpy.typing.NDArray[numpy.float64]
) -> numpy.typing.NDArray[numpy.float64]:
    """Trace functions at points of a facet, [point][node]."""

def vertex_pieces(
    slave: Surface,
    master: Surface,
    of_master: bool,
    which: numpy.typing.NDArray[numpy.uint8],
    weight: numpy.typing.NDArray[numpy.float64],
    radius: SearchRadius,
) -> Pieces:
    """Points at vertices of either, of surfaces that follow their bodies; collective."""

def with_traces(
    points: PairingPoints,
    block: int,
    slave_dofs: numpy.typing.NDArray[numpy.int64],
    slave_owner: numpy.typing.NDArray[numpy.int32],
    slave_values: numpy.typing.NDArray[numpy.float64],
    master_dofs: numpy.typing.NDArray[numpy.int64],
    master_owner: numpy.typing.NDArray[numpy.int32],
    master_values: numpy.typing.NDArray[numpy.float64],
) -> PairingPoints:
    """The same points for another field on the same facets, without corners."""

def within_body(
    surface: Surface,
    x: numpy.typing.NDArray[numpy.float64],
    normal: numpy.typing.NDArray[numpy.float64],
    facet: numpy.typing.NDArray[numpy.int64],
) -> numpy.typing.NDArray[numpy.uint8]:
    """Whether places just outside of points of a body's boundary are within the body, [point]; collective."""
