"""The surface that a ball draws which rolls along two others: the rounding of their edge.

         n_a            a, b   the two surfaces, by their signed distances d and normals n
    ------|---- a       c      centre of the ball: d_a(c) = s_a r, d_b(c) = s_b r, sides s of -1 or 1
          c-. x         x - c  from the centre to a place, at right angles to the way of the centre
          |  '.         on the rounding where x - c lies between the directions to the two touching points
               b
All lengths in voxels or in model units, as the surfaces.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.analytic import AnalyticSurface

__all__ = ["Rolled", "rolled"]

Floats = NDArray[np.float64]

ROUNDS = 6  # of Newton's for the centre, exact for planes after one
FLAT = 0.05  # 1 - cosine of the normals' angle, below which there is no edge to round


@dataclass(frozen=True, eq=False)
class Rolled:
    """Where the ball is for each of n places.

    centre    (n, 3)
    distance  (n,) from the rounding, positive outside the ball
    between   (n, 2) how much of the way from the centre to the place runs toward a, and toward b: both positive on the
              rounding itself
    weight    (n, 2) how much the distance grows with d_a and with d_b at the centre
    """

    centre: Floats
    distance: Floats
    between: Floats
    weight: Floats

    @property
    def on_it(self) -> NDArray[np.bool_]:
        """Whether the ball touches the place between its two touching points."""
        return np.asarray((self.between > 0.0).all(axis=1))


def rolled(x: Floats, a: AnalyticSurface, b: AnalyticSurface, *, sides: tuple[float, float], radius: float) -> Rolled:
    """The ball of a radius that rolls along two surfaces, nearest to each place (n, 3)."""
    centre = x.copy()
    for _ in range(ROUNDS):
        normals = np.stack([a.normal(centre), b.normal(centre)], axis=1)
        miss = np.column_stack([s.distance(centre) - side * radius for s, side in zip((a, b), sides)])
        centre = centre - np.einsum("nk,nkc->nc", _solved(normals, miss), normals)
    normals = np.stack([a.normal(centre), b.normal(centre)], axis=1)
    arm = x - centre
    length = np.maximum(np.linalg.norm(arm, axis=1), 1e-12)
    weight = _solved(normals, np.einsum("nkc,nc->nk", normals, arm / length[:, None]))
    # toward a is -s_a n_a, so what of the arm runs there has the sign of -s_a times its share of n_a
    return Rolled(centre, length - radius, -np.array(sides) * weight * length[:, None], weight)


def _solved(normals: Floats, right: Floats) -> Floats:
    """Shares (n, 2) of the two normals (n, 2, 3) with the products `right` with them."""
    cosine = np.einsum("nc,nc->n", normals[:, 0], normals[:, 1])
    det = np.maximum(1.0 - cosine**2, FLAT)
    return np.column_stack([right[:, 0] - cosine * right[:, 1], right[:, 1] - cosine * right[:, 0]]) / det[:, None]
