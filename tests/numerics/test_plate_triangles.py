"""Bending of plate triangles: exact where the height is a quadratic, none where it is a plane."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.numerics.plate_triangles import bending_rows
from recon.numerics.tiled_solver import TiledSolver, plane_tiles

HESSIAN = np.array([[2.0, 0.7], [0.7, -1.0]])


def triangles(n: int) -> np.ndarray:
    corners = np.random.default_rng(n).normal(size=(n, 3, 2))
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turned = a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]
    corners[turned] = corners[turned, ::-1]
    return corners


def energy(corners: np.ndarray, hessian: np.ndarray) -> np.ndarray:
    height = 3 + corners @ [1.0, 2.0] + 0.5 * np.einsum("nki,ij,nkj->nk", corners, hessian, corners)
    values = np.concatenate([height[..., None], corners @ hessian + [1.0, 2.0]], axis=2).reshape(-1, 9)
    return (np.einsum("nij,nj->ni", bending_rows(corners), values) ** 2).sum(axis=1)


def test_a_quadratic_bends_by_the_square_of_its_hessian_times_the_area():
    corners = triangles(20)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    assert_allclose(energy(corners, HESSIAN), area * (HESSIAN**2).sum(), rtol=1e-9)


def test_a_plane_does_not_bend():
    assert energy(triangles(20), np.zeros((2, 2))).max() < 1e-18


@pytest.mark.parametrize("most", [30, 1000])
def test_tiles_solve_a_grid_laplacian_and_keep_what_is_held(most):
    from scipy import sparse

    n = 20
    chain = sparse.diags_array([-1.0, 2.1, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    matrix = sparse.csr_array(sparse.kron(chain, sparse.eye_array(n)) + sparse.kron(sparse.eye_array(n), chain))
    places = np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2).astype(float)
    solver = TiledSolver(matrix, plane_tiles(places, most))
    random = np.random.default_rng(0)
    right, start, free = random.normal(size=n * n), random.normal(size=n * n), random.random(n * n) < 0.8
    x = solver.solve(right, start, free, 1e-10)
    assert (x[~free] == start[~free]).all()
    assert np.abs((matrix @ x - right)[free]).max() < 1e-7
