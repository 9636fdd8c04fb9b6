"""A thick piece between two bumpy sheets, cut along a wavy loop."""

import numpy as np
from scipy.interpolate import make_interp_spline

from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.trimmed import ThickPiece, TrimLoop, TrimmedSurface
from recon.numerics.bspline_basis import uniform_knots


def bumpy_sheet(height, seed, bump=0.3, n=12):
    x, y = np.meshgrid(np.linspace(0, 10, n), np.linspace(0, 10, n), indexing="ij")
    z = height + np.random.default_rng(seed).uniform(-bump, bump, x.shape) - 0.05 * ((x - 5) ** 2 + (y - 5) ** 2)
    return BSplineSurface(3, 3, uniform_knots(n, 3), uniform_knots(n, 3), np.stack([x, y, z], axis=-1))


def wavy_loop(n_curves, radius):
    def around(turn):
        r = radius * (1 + 0.13 * np.sin(5 * turn))
        return 0.5 + r[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)

    corners = np.linspace(0, 2 * np.pi, n_curves + 1)
    at_corners = around(corners)
    at_corners[-1] = at_corners[0]
    curves = []
    for k in range(n_curves):
        turn = np.linspace(corners[k], corners[k + 1], 8 + 100 // n_curves)
        spline = make_interp_spline(turn, around(turn), k=3)
        points = np.array(spline.c)
        points[0], points[-1] = at_corners[k], at_corners[k + 1]
        curves.append(BSplineCurve(3, spline.t, points))
    return TrimLoop(tuple(curves))


def thick_piece(n_walls, *, bump=0.3, samples=80):
    """Ruled walls through `samples` points of each pcurve: the more, the nearer the walls end at the sheets."""
    outer = TrimmedSurface(bumpy_sheet(1.0, 0, bump), (wavy_loop(n_walls, 0.3),))
    inner = TrimmedSurface(bumpy_sheet(-0.5, 1, bump), (wavy_loop(n_walls, 0.28),))
    walls = []
    for over, under in zip(outer.loops[0].pcurves, inner.loops[0].pcurves):
        t = np.linspace(*over.domain, samples)
        rims = [
            make_interp_spline(t, sheet.surface.point(pcurve.point(t)), k=3)
            for sheet, pcurve in ((outer, over), (inner, under))
        ]
        net = np.stack([np.array(rim.c) for rim in rims], axis=1)
        walls.append(BSplineSurface(3, 1, rims[0].t, [0, 0, 1, 1], net))
    return ThickPiece(outer, inner, tuple(walls))
