from collections.abc import Sequence
from typing import Any, overload

import numpy
import numpy.typing

class BlockProduct:
    """Products with a body's matrix; see linear/block_product.h."""

    def __init__(self, matrix: int) -> None:
        """For a matrix that must outlive this object; collective."""

    @staticmethod
    def is_for(matrix: int) -> bool:
        """Whether a matrix has blocks of size 2 or 3."""

    def apply(self, x: int, y: int) -> None:
        """Write the product of the matrix and a vector x to y; collective."""

class CompressedRows:
    """Rows of this rank over all unknowns; see tangent/products.h."""

    def __init__(
        self,
        offset: numpy.typing.NDArray[numpy.int64],
        column: numpy.typing.NDArray[numpy.int64],
        value: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """First entry of each row, [row + 1]; column numbers and values, [entry]."""

class GapOperator:
    """Operator of the weighted gaps of the slave nodes of this rank; see gap/gap.h."""

    @overload
    def __init__(
        self, slave: Surface, master: Surface | None, points: PairingPoints, jump: bool, rows: int
    ) -> None:
        """Rows are nodes (0), nodes with their covered areas (1), or points (2); collective."""

    @overload
    def __init__(
        self,
        master: Surface | None,
        points_of: Pieces,
        *,
        alone: numpy.typing.NDArray[numpy.int64],
        weight: numpy.typing.NDArray[numpy.float64],
        far: float,
    ) -> None:
        """Derivative of gaps with updated geometry, a row for each point of pieces; see gap/gap.h."""

    @overload
    def __init__(
        self,
        master: Surface | None,
        jump_of: Pieces,
        *,
        alone: numpy.typing.NDArray[numpy.int64],
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Relative position at the points of pieces; see gap/gap.h."""

    @overload
    def __init__(
        self,
        master: Surface | None,
        points_of: Pieces,
        slip: SlipOfPieces,
        *,
        works: bool,
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Derivative of slip at the points of pieces, or the variation that tractions work on."""

    @property
    def num_rows(self) -> int: ...
    @property
    def turns(self) -> bool:
        """Whether a jump is co-rotated with facets."""

    @property
    def width(self) -> int:
        """Values per row: 1, or for a jump the unknowns of a node."""

    @property
    def row_node(self) -> numpy.typing.NDArray[numpy.int64]:
        """Index of each row's node in the slave's nodes, [row]; empty if rows are points."""

    @property
    def row_side(self) -> numpy.typing.NDArray[numpy.uint8]:
        """Smooth side of the row's node, [row]; empty if sides are not distinguished."""

    @property
    def row_in_corner(self) -> numpy.typing.NDArray[numpy.uint8]:
        """Whether the row's node may have a row for each side, [row]; empty likewise."""

    @property
    def row_area(self) -> numpy.typing.NDArray[numpy.float64]:
        """Area by which each row's gap is divided: S_k, its covered part, or w_p, [row]."""

    @property
    def initial_gap(self) -> numpy.typing.NDArray[numpy.float64]:
        """Initial weighted gap, zero for a jump, [row]."""

    @property
    def slave_sum(self) -> numpy.typing.NDArray[numpy.float64]:
        """Sum of the slave's coefficients, [row][gdim], for a jump [row][1]."""

    def entries(
        self, side: int
    ) -> tuple[
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.int32],
        numpy.typing.NDArray[numpy.float64],
    ]:
        """Entries of one side: first entry of each row, [row + 1]; column node of each entry, [entry]; coefficients, [entry][gdim], for a jump [entry][1], or [entry][gdim * gdim] if it is co-rotated."""

    def columns(self, side: int) -> numpy.typing.NDArray[numpy.int64]:
        """Unknowns of one side's nodes, -1 where Dirichlet conditions hold, [column][block]."""

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
        """N_k at points: first entry of each row, [row + 1]; unknowns that represent a side of a node, and values, [entry]."""

    def at_points(self, nodal: int) -> numpy.typing.NDArray[numpy.float64]:
        """Values of a field on the slave, with a component for each side, at the points; collective."""

    def add_to_nodes(self, f: numpy.typing.NDArray[numpy.float64], nodal: int) -> None:
        """Add the sums of N_k times the values at the points to the nodes; collective."""

    def raise_nodes(self, f: numpy.typing.NDArray[numpy.float64], nodal: int) -> None:
        """Raise the values of nodes to the largest value at the points beside them; collective."""

    def constrain(self, slave: int, master: int) -> None:
        """Mark constrained unknowns; collective."""

class KeptPairs:
    """Pairs of facets of two surfaces that move, searched for again when one may be missing; see search/kept_pairs.h."""

    def __init__(self, radius: SearchRadius, skin: float = 0.0) -> None: ...
    @property
    def num_evaluations(self) -> int:
        """Number of uses so far."""

    @property
    def num_searches(self) -> int:
        """Number of searches among them."""

class PairingPoints:
    """Contact quadrature points of one choice of the slave; see pairing/pairing.h."""

    @property
    def size(self) -> int: ...
    @property
    def slave(self) -> dict[str, Any]:
        """Arrays of the slave's side: x, dofs, owner, shape_values."""

    @property
    def master(self) -> dict[str, Any]:
        """Arrays of the master's side: x, dofs, owner, shape_values."""

    @property
    def multiplier_values(self) -> numpy.typing.NDArray[numpy.float64]:
        """Functions of the multipliers, [point][slave vertex]."""

    @property
    def faced(self) -> numpy.typing.NDArray[numpy.int64]:
        """First numbers of the vertices of the facet of a rigid tool, -1 for none, [point][vertex]."""

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
        """The same points, and stand-alone points with one multiplier each; see pairing/pairing.h."""

    def scaled(self, factor: numpy.typing.NDArray[numpy.float64]) -> PairingPoints:
        """The same points, their weights multiplied by factors [point]."""

    def turning(
        self,
        slave: numpy.typing.NDArray[numpy.float64],
        master: numpy.typing.NDArray[numpy.float64],
    ) -> PairingPoints:
        """The same points with co-rotated jumps, from the contributions of the nodes of each side to a jump, [point][node][block][block]."""

    @property
    def num_of_slave(self) -> int:
        """Number of points of the overlay on facets of the slave; they come first."""

    @property
    def num_unpaired(self) -> int:
        """Number of owned nodes (overlay: facets) for which no partner was found."""

    @property
    def num_corners(self) -> int:
        """Number of owned nodes of both surfaces in the corner of several walls."""

    @property
    def by_sides(self) -> bool:
        """Whether nodes in corners have a multiplier for each smooth side."""

    @property
    def in_corner(self) -> numpy.typing.NDArray[numpy.uint8]:
        """Whether an owned node has several multipliers, [node]; empty if not by_sides."""

class Pieces:
    """Pieces (segments) of the overlay; see pairing/pieces.h."""

    @property
    def size(self) -> int: ...
    @property
    def gdim(self) -> int: ...
    @property
    def num_missed(self) -> int:
        """Number of pieces with a ray that meets no point."""

    @property
    def num_points(self) -> int: ...
    def cover(self) -> numpy.typing.NDArray[numpy.float64]:
        """Covered areas of the slave's nodes, [piece, k]."""

    def side_dofs(self) -> numpy.typing.NDArray[numpy.int64]:
        """Unknowns that represent the sides of these nodes, [piece, k]."""

    def gaps(self) -> numpy.typing.NDArray[numpy.float64]:
        """Distances along the rays, positive when open, [point]."""

    def raise_facets(self, normals: int) -> None:
        """Let forces at vertices act along the normals of a curved surface; collective."""

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
        """Derivatives of forces of pressures or tractions, on both bodies, by these normals; rows are unknowns."""

    def functions(self) -> numpy.typing.NDArray[numpy.float64]:
        """Functions of the slave's vertices at the points, [point][k]."""

    def facets(self) -> numpy.typing.NDArray[numpy.int64]:
        """Identification of the two facets of each point and of the facet that was cut, [point][n]."""

    @property
    def vertex(self) -> numpy.typing.NDArray[numpy.int64]:
        """Numbers of the owned nodes that are the points; empty for facets that were cut."""

    def slave_sizes(self) -> numpy.typing.NDArray[numpy.float64]:
        """Size of the slave's facet at each point, [point]."""

    def x(self) -> numpy.typing.NDArray[numpy.float64]:
        """Positions of the points, [point][3]."""

class RayFacet:
    """A facet in its current configuration; see sliding/ray.h."""

    def __init__(
        self,
        num_vertices: int,
        degree: int,
        x: numpy.typing.NDArray[numpy.float64],
        orientation: float = 1.0,
    ) -> None:
        """From its trace nodes, [node][3]."""

class RayPoints:
    """Starts and ends of rays."""

    def __init__(
        self,
        xi: numpy.typing.NDArray[numpy.float64],
        zeta: numpy.typing.NDArray[numpy.float64],
        weight: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """From reference coordinates on the facet that is cut, guesses on the other facet, both [point][2], and areas."""

    @property
    def zeta(self) -> numpy.typing.NDArray[numpy.float64]:
        """Reference coordinates on the other facet, [point][2]."""

    @property
    def t(self) -> numpy.typing.NDArray[numpy.float64]:
        """Lengths of the rays, negative in penetration, [point]."""

class RowSums:
    """Entries to be added to a matrix; see tangent/row_sums.h."""

    def __init__(self, matrix: int) -> None:
        """For a matrix that must outlive this object."""

    def add_entries(
        self,
        rows: numpy.typing.NDArray[numpy.int64],
        columns: numpy.typing.NDArray[numpy.int64],
        values: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Add entries in any order, in rows of any rank; negative numbers are left out."""

    def add_squares(
        self,
        numbers: numpy.typing.NDArray[numpy.int64],
        values: numpy.typing.NDArray[numpy.float64],
    ) -> None:
        """Add matrices, [block][row][row], with row numbers [block][row]; negative numbers are left out."""

    def insert(self) -> None:
        """Insert all entries into the matrix, and assemble it. Collective."""

class SearchRadius:
    """Search distance, up to which points are paired: one value, or the size of the larger facet there, if this is less."""

    def __init__(self, largest: float, by_size: bool = False) -> None: ...
    @property
    def largest(self) -> float:
        """Largest search distance anywhere."""

class SlipOfPieces:
    """Slip at the points of pieces; see gap/point_rows.h."""

    def __init__(
        self, pieces: Pieces, slave: int, master: int, of_tool: numpy.typing.NDArray[numpy.float64]
    ) -> None:
        """From the positions of the nodes when slip began; collective."""

    @property
    def slip(self) -> numpy.typing.NDArray[numpy.float64]:
        """Slip of the slave against the master, [point][3]."""

    @property
    def normal(self) -> numpy.typing.NDArray[numpy.float64]:
        """Normals outward of the slave, [point][3]."""

    @property
    def arc(self) -> numpy.typing.NDArray[numpy.float64]:
        """Arc length along the facets divided by the slip, which is its chord, [point]."""

    @property
    def gap(self) -> numpy.typing.NDArray[numpy.float64]:
        """Gap of the same material points when slip began, positive in penetration, [point]."""

    def turns(self, pieces: Pieces) -> numpy.typing.NDArray[numpy.float64]:
        """Rotation of vectors that turn with the facets of slip since slip began, [point][3][3]."""

class StackedRows:
    """Rows of points over all unknowns; see tangent/products.h."""

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
        """Add a factor times one side of an operator, in components from `first` on; `numbers` are the numbers of its unknowns, [column][block], negative where a Dirichlet condition holds."""

    def add_rows(self, rows: CompressedRows, factor: float, first: int, width: int) -> None:
        """Add a factor times rows, `width` for each point, in components from `first` on."""

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
        """Set new coordinates of the facets; collective."""

    def follow(self, trace_x: numpy.typing.NDArray[numpy.float64]) -> None:
        """Set new coordinates of the nodes of the trace, [facet][node][3]; local."""

    def measure_nodes(self) -> None:
        """Compute areas and normals of the nodes after `follow`; collective."""

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
        """Number of the smooth side to which a facet belongs at its vertices, [facet][vertex]."""

    @property
    def node_dofs(self) -> numpy.typing.NDArray[numpy.int64]:
        """Global unknowns of the owned nodes, [node][block]."""

    @property
    def node_x(self) -> numpy.typing.NDArray[numpy.float64]:
        """Coordinates of the owned nodes, [node][3]."""

    @property
    def node_area(self) -> numpy.typing.NDArray[numpy.float64]:
        """Areas S_k of the owned nodes, [node]."""

    @property
    def node_facet_size(self) -> numpy.typing.NDArray[numpy.float64]:
        """Sizes of the largest facets at the owned nodes, [node]."""

    @property
    def node_normal(self) -> numpy.typing.NDArray[numpy.float64]:
        """Averaged outward unit normals at the owned nodes, [node][3]."""

def add_point_forces(
    sums: RowSums,
    pieces: Pieces,
    slip: SlipOfPieces | None,
    *,
    factors: Sequence[numpy.typing.NDArray[numpy.float64]],
    derivatives: Sequence[numpy.typing.NDArray[numpy.float64]],
    values: Sequence[numpy.typing.NDArray[numpy.float64]],
    fields: Sequence[int],
    missing: Sequence[int],
    begun: Sequence[int],
    moves: bool,
    gaps_move: bool,
    function_rows: numpy.typing.NDArray[numpy.int64],
    functions: Sequence[CompressedRows],
    own: bool,
    numbers: Sequence[numpy.typing.NDArray[numpy.int64]],
    scale: Sequence[float],
    tool: int,
    way: Sequence[float],
) -> None:
    """Add the derivative of the forces and of the equations of multipliers at the points of pieces: factors γ, a, and that of N in R_λ; derivatives D and those of r by λ; pressures, tractions, r, vectors that turn with facets, their components along normals, and the part of the trials that turns, with its derivatives by functions; λ, and a field of that part; see tangent/point_forces.h. Collective."""

def add_products(
    sums: RowSums, left: StackedRows, right: StackedRows, D: numpy.typing.NDArray[numpy.float64]
) -> None:
    """Add Lᵀ D R to a matrix; D has a number for each row, or a matrix [component][component] for each point."""

alike_cosine: float = 0.5

def closest_facets(
    nodes: Surface, surface: Surface, radius: SearchRadius
) -> tuple[numpy.typing.NDArray[numpy.uint8], numpy.typing.NDArray[numpy.float64]]:
    """Whether a facet was found for each owned node, [node], and the closest points, [node][3]; collective."""

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
    """Closest points of a surface to the points x [point][3] of another: found [point], x, normal and mean_normal of all facets there [point][3], dofs [point][node][block], owner and shape_values [point][node] of the facet; collective."""

def conforming_points(
    slave: Surface,
    master: Surface,
    radius: SearchRadius,
    piece_x: numpy.typing.NDArray[numpy.float64],
    piece_w: numpy.typing.NDArray[numpy.float64],
    edge_x: numpy.typing.NDArray[numpy.float64],
    edge_w: numpy.typing.NDArray[numpy.float64],
    slave_is_flat: bool,
    master_is_flat: bool,
) -> tuple[PairingPoints, numpy.typing.NDArray[numpy.float64]]:
    """Paired points of the slave, whose gap is the change of the gap by chord errors, and those where both surfaces are curved the same way, [point][slave, master, gap, weight]; collective."""

def count_degenerate(num_vertices: int, x: numpy.typing.NDArray[numpy.float64]) -> int:
    """Number of facets x [facet][vertex][3] that have no area or are not convex."""

def count_entries(block: int) -> numpy.typing.NDArray[numpy.int32]:
    """Numbers of entries in columns of this rank and in other columns, [2][row]."""

def edge_heights(surface: Surface) -> numpy.typing.NDArray[numpy.float64]:
    """Heights of the surface that the facets approximate above the middles of their edges, along the facets' normals, and their weights in a mean, [facet][edge][2]; collective."""

def face_tool(
    points: PairingPoints,
    keep: numpy.typing.NDArray[numpy.uint8],
    normal: numpy.typing.NDArray[numpy.float64],
    gap: numpy.typing.NDArray[numpy.float64],
    group: int,
) -> None:
    """Set normals and gaps, and remove points; see pairing/rigid.h."""

def facet_curvature(surface: Surface) -> numpy.typing.NDArray[numpy.float64]:
    """Curvature of the facets, [facet][xx, yy, zz, xy, xz, yz]; collective."""

facing_cosine: float = -0.1

def flat_nodes(surface: Surface) -> numpy.typing.NDArray[numpy.float64]:
    """Nodes of degree 2 on the flat facets, [facet][node][3]."""

def flat_normals(surface: Surface) -> numpy.typing.NDArray[numpy.float64]:
    """Outward unit normals of the flat facets at their nodes of degree 2, [facet][node][3]."""

def forget_master(points: PairingPoints) -> None:
    """Remove the unknowns of the master; `faced` identifies its facets from then on."""

def free_unknowns(pieces: Pieces, side: int, markers: int) -> numpy.typing.NDArray[numpy.int64]:
    """Unknowns of the slave (0) or master (1), negative where a Dirichlet condition holds, [piece][node][gdim]. Collective."""

def heights_at(
    surface: Surface,
    heights: numpy.typing.NDArray[numpy.float64] | None,
    x: numpy.typing.NDArray[numpy.float64],
    w: numpy.typing.NDArray[numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]:
    """Heights above the flat facets at quadrature points, facet by facet, of curved facets with given heights at their nodes of degree 2, or from the angles between facets; collective."""

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
    """Keep only the points that are marked in `which`, [point]."""

def mean_of_rows(
    x: numpy.typing.NDArray[numpy.float64], rows: numpy.typing.NDArray[numpy.int32]
) -> numpy.typing.NDArray[numpy.float64]:
    """Means of points x [point][3], one mean for each row of point numbers, [row][3]."""

def overlay_pieces(
    slave: Surface,
    master: Surface,
    both: bool,
    pairs: KeptPairs,
    piece_x: numpy.typing.NDArray[numpy.float64],
    piece_w: numpy.typing.NDArray[numpy.float64],
    edge_x: numpy.typing.NDArray[numpy.float64],
    edge_w: numpy.typing.NDArray[numpy.float64],
) -> Pieces:
    """Pieces of the overlay of surfaces with updated geometry; collective."""

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
    slave_heights: numpy.typing.NDArray[numpy.float64] | None = None,
    master_heights: numpy.typing.NDArray[numpy.float64] | None = None,
) -> PairingPoints:
    """Pairing points on the overlay; heights of curved facets, [facet][node]; collective."""

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

def passed_depths(
    surface: Surface,
    num_pieces: int,
    facet_x: numpy.typing.NDArray[numpy.float64],
    x: numpy.typing.NDArray[numpy.float64],
    normal: numpy.typing.NDArray[numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]:
    """Depths of paths within bodies that points have passed through, [point], 0 for all others; facet_x are the facets' vertices, [time][facet][vertex][3], x and normal the points and their normals, [time][point][3], at the ends of the pieces of the motion; collective."""

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
    """Points from given positions: for both sides positions [point][3], unknowns [point][node][block], owners and trace functions [point][node]; the functions of the multipliers [point][slave vertex], the number of the vertex' multiplier they belong to [point], normals, gaps and areas. A rigid master has no unknowns."""

def points_of_pieces(slave: Surface, master: Surface | None, pieces: Pieces) -> PairingPoints:
    """Points of pieces as pairing points without normals."""

def processor_level() -> str:
    """Level of x86-64 instructions that this processor has, "x86-64-v3" or ""."""

def put_rows(
    block: int,
    matrix: int,
    rows: numpy.typing.NDArray[numpy.int32],
    row_numbers: Sequence[numpy.typing.NDArray[numpy.int64]],
    column_numbers: Sequence[numpy.typing.NDArray[numpy.int64]],
    mode: int,
) -> None:
    """Insert rows of one body's block into the matrix of all bodies."""

def ray_curvature(
    cut: RayFacet,
    other: RayFacet,
    cut_is_slave: bool,
    points: RayPoints,
    pressure: numpy.typing.NDArray[numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]:
    """Second derivatives of the sum of weights times pressures times gaps, for constant weights and pressures."""

def ray_functions(
    cut: RayFacet, other: RayFacet, cut_is_slave: bool, points: RayPoints
) -> numpy.typing.NDArray[numpy.float64]:
    """Gradients of the slave's vertex functions at points, [point][vertex][node][3]."""

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
    """Slip at points since the nodes were at the start positions, and the slave's normal, [point][3]; the gradient of the slip, and the variation that tractions work on, [point][slip][node][component]."""

def ray_slip_curvature(
    cut: RayFacet,
    other: RayFacet,
    cut_is_slave: bool,
    points: RayPoints,
    tractions: numpy.typing.NDArray[numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]:
    """Derivative of the sum of weights times the virtual work of constant tractions."""

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
    """Fix the non-zero pattern of a matrix; places may be in rows of any rank and repeat. Collective."""

def set_values(matrix: int, values: numpy.typing.NDArray[numpy.float64]) -> None:
    """Replace the entries of a matrix, in the order of its places. Collective."""

def share_out_hardly_covered(points: PairingPoints, slave: Surface, least: float) -> int:
    """Condense the multipliers of hardly covered nodes onto their neighbours; collective."""

def solve_rays(cut: RayFacet, other: RayFacet, points: RayPoints) -> bool:
    """Solve for the ends of the rays; return whether all were found."""

def trace_gradients(
    num_vertices: int, degree: int, xi: numpy.typing.NDArray[numpy.float64]
) -> numpy.typing.NDArray[numpy.float64]:
    """Derivatives of the trace functions, [point][node][2]."""

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
    """Points at vertices of the slave or the master, for surfaces with updated geometry; collective."""

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
