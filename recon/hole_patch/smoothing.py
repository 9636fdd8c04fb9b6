"""The relief is taken off the wall: Taubin's low-pass filter, all its steps at once.

Two umbrella steps in turn, `x += λ Δx` and `x += μ Δx`, shrink what is rough and leave what is smooth. A thousand
pairs of them are one polynomial in the umbrella operator, and a Chebyshev series of some eighty terms is that
polynomial to ten digits:

    f(k)^pairs  1 +--.                                      k     frequency, an eigenvalue of K = -Δ, 0 <= k <= 2
                  |   \\          f = (1 - λk)(1 - μk)      k_pb  pass band: f(k_pb) = 1
                0 +----`--------------------+ k            W     1 - K: the mean over the one-ring, -1 <= W <= 1
                     k_pb                   2              T_n   Chebyshev polynomial, T_n+1 = 2 W T_n - T_n-1

Paper  [taubin1995]; step sizes by [kinoshita], from k_pb = 1/λ + 1/μ and f(1) = -f(2).
"""

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, sparse

from recon.errors import BadOption
from recon.geometry.mesh import TriangleMesh
from recon.numerics.halfedges import free_edges, vertex_adjacency, vertex_normals

__all__ = ["Boundary", "Factors", "taubin_factors", "transfer", "ring_mean_operator", "taubin_smooth"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SERIES_ERROR = 1e-13
MOST_SWELLING = 100.0


class Boundary(Enum):
    """What becomes of the vertices on the border of an open mesh; the paper gives no rule.

    HELD      they stay where they are: the rim keeps its line, and its relief, which reaches a few edges inward
    ALONG     they are smoothed with their two neighbours on the border only: a jagged rim is straightened and shrinks
    FREE      no rule: the surface stays nearest to the wall, but its rim creeps inward by a few edges
    LEVELLED  as FREE, then every vertex is put back sideways, so that it moved along the normal only: the rim loses its
              relief and keeps its line; not for sheets bent sharply within a few edges of the rim
    """

    HELD = "held"
    ALONG = "along"
    FREE = "free"
    LEVELLED = "levelled"


class Factors(NamedTuple):
    """Step sizes of a pair: λ > 0 shrinks, μ < -λ inflates."""

    shrink: float
    inflate: float


def taubin_factors(pass_band: float) -> Factors:
    """Step sizes λ and μ with 1/λ + 1/μ = `pass_band` and f(1) = -f(2).

    Both follow from p = λμ = -2 / (5 - 3 k_pb) and λ + μ = k_pb p, so a pair without a pass band cannot be asked for.
    Raises  BadOption unless 0 < pass_band < 1.
    Paper   [taubin1995], [kinoshita].
    """
    if not 0.0 < pass_band < 1.0:
        raise BadOption("pass band", f"must lie between 0 and 1, not {pass_band}; 0.01 to 0.1 is usual")
    product = -2.0 / (5.0 - 3.0 * pass_band)
    half = 0.5 * pass_band * product
    root = float(np.sqrt(half * half - product))
    return Factors(half + root, half - root)


def transfer(k: Floats, *, pass_band: float, pairs: int) -> Floats:
    """Factor by which `pairs` pairs of steps scale a wave of frequency k: ((1 - λk)(1 - μk))^pairs."""
    lam, mu = taubin_factors(pass_band)
    return ((1.0 - lam * k) * (1.0 - mu * k)) ** pairs


def taubin_smooth(
    mesh: TriangleMesh, *, pass_band: float = 0.01, pairs: int = 1000, boundary: Boundary = Boundary.HELD
) -> TriangleMesh:
    """Low-pass filter the vertices so that the relief goes and the vessel keeps its size.

    mesh       any triangles; vertices without faces stay
    pass_band  0 < k_pb < 1, frequencies below it are kept
    pairs      number of λ|μ pairs, not of half steps
    boundary   what becomes of the border
    Promises   same faces, same vertex order; equal to the loop over all steps to 1e-10 of the mesh's size.
    Raises     BadOption when a number makes no sense or the pass band would swell.
    Paper      [taubin1995], transfer function; [kinoshita], step sizes and 1000 pairs.
    """
    series = _series(pass_band, pairs)
    origin = mesh.vertices.mean(axis=0) if mesh.n_vertices else np.zeros(3)
    operator = ring_mean_operator(mesh, boundary)
    smooth = _apply(series, operator, mesh.vertices - origin) + origin
    held = operator.diagonal() == 1.0
    smooth[held] = mesh.vertices[held]
    if boundary is Boundary.LEVELLED:
        normals = vertex_normals(smooth, mesh.face_vertices)
        height = np.einsum("ij,ij->i", smooth - mesh.vertices, normals)
        smooth = mesh.vertices + height[:, None] * normals
    return TriangleMesh(smooth, mesh.face_vertices, mesh.name)


def ring_mean_operator(mesh: TriangleMesh, boundary: Boundary = Boundary.HELD) -> sparse.csr_array:
    """(V, V) sparse W that replaces each vertex by the mean over its one-ring; the umbrella operator is W - 1.

    Rows sum to 1, and a vertex that is held has a one on the diagonal. W is a symmetric matrix with rows scaled, below
    a block for the border; so its eigenvalues are real and lie in [-1, 1] whatever the rule for the border.
    """
    ring = vertex_adjacency(mesh.face_vertices, mesh.n_vertices)
    if boundary in (Boundary.HELD, Boundary.ALONG):
        border = free_edges(mesh.face_vertices)
        inside = np.ones(mesh.n_vertices)
        inside[border] = 0.0
        ring = sparse.diags_array(inside) @ ring
        if boundary is Boundary.ALONG:
            ring = ring + _links(border, mesh.n_vertices)
    degree = np.asarray(ring.sum(axis=1)).ravel()
    alone = (degree == 0).astype(np.float64)
    return sparse.csr_array(sparse.diags_array(1.0 / np.maximum(degree, 1.0)) @ ring + sparse.diags_array(alone))


def _links(edges: Ints, n_vertices: int) -> sparse.csr_array:
    """(V, V) symmetric matrix with a one for every pair of `edges`."""
    rows, columns = np.concatenate([edges, edges[:, ::-1]]).T
    return sparse.csr_array(sparse.coo_array((np.ones(len(rows)), (rows, columns)), shape=(n_vertices, n_vertices)))


def _series(pass_band: float, pairs: int) -> Floats:
    """Chebyshev coefficients of the transfer function over w = 1 - k in [-1, 1], cut where it is too small to see.

    The samples at Chebyshev nodes give the coefficients by one cosine transform; doubled until the tail is nil.
    The function is a polynomial of degree 2 * pairs, which bounds the doubling.
    """
    lam, mu = taubin_factors(pass_band)
    if pairs < 0:
        raise BadOption("pairs", f"must not be negative, not {pairs}")
    swelling = pairs * float(np.log1p(-0.25 * (lam + mu) ** 2 / (lam * mu)))
    if swelling > np.log(MOST_SWELLING):
        raise BadOption("pass band", f"{pass_band} with {pairs} pairs swells the shape; take less of either")
    n = 64
    while True:
        n = min(n, 2 * pairs + 1)
        nodes = np.cos(np.pi * (np.arange(n) + 0.5) / n)
        series = fft.dct(transfer(1.0 - nodes, pass_band=pass_band, pairs=pairs), type=2) / n
        series[0] *= 0.5
        # The power carries `pairs` roundings: below them a coefficient is noise, and no doubling makes it smaller.
        large = np.flatnonzero(np.abs(series) > max(SERIES_ERROR, 4.0 * pairs * np.finfo(float).eps))
        kept = int(large.max(initial=0)) + 1
        if kept <= n // 2 or n == 2 * pairs + 1:
            return series[:kept]
        n *= 2


def _apply(series: Floats, operator: sparse.csr_array, x: Floats) -> Floats:
    """Sum of series[n] T_n(operator) x by the three-term recurrence, stable while the spectrum is in [-1, 1]."""
    before, now = x, operator @ x
    total = series[0] * before + (series[1] * now if len(series) > 1 else 0.0)
    for weight in series[2:]:
        before, now = now, 2.0 * (operator @ now) - before
        total += weight * now
    return np.asarray(total)
