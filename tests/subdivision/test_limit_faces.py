"""Faces laid over limit surfaces: no gap, tangent planes alike across every smooth edge, on the limit surface."""

import numpy as np
import pytest
from hull_meshes import ball, bumpy_ball, disc
from limit_meshes import crossed, dual, halved, opened, prism, ringed, semi_sharp
from quad_meshes import creased, drum, grid, shaken, with_handles, without_faces

from recon.geometry.control_mesh import ControlMesh
from recon.numerics.halfedges import edge_table
from recon.subdivision.limit_faces import limit_faces, natural_scheme
from recon.subdivision.limit_surface import Scheme, limit_points, tessellate
from recon.subdivision.polygons import settled, split_polygons, split_triangles


def triangles(mesh, **marks):
    return ControlMesh.from_faces(mesh.vertices, mesh.face_vertices, **marks)


def creased_ball():
    mesh = ball(40, 7)
    above = mesh.vertices[mesh.face_vertices].mean(axis=1)[:, 2] > 0.0
    rim = edge_table(mesh.face_vertices[above])
    return triangles(mesh, crease_edges=rim.edges[rim.uses == 1])


QUADS = {
    **{f"valence {n}": shaken(drum(n), 0.05) for n in range(3, 9)},
    **{f"genus {g}": shaken(with_handles(g), 0.05) for g in range(4)},
    "sheet": shaken(grid(6, 7)),
    "open": shaken(without_faces(drum(5), [0, 1, 3, 20, 24])),
    "crease": shaken(creased(drum(5, layers=3), np.arange(10, 20)), 0.05),
    "cube with sharp edges": ControlMesh.from_faces(
        with_handles(0).vertices,
        with_handles(0).faces_of(4),
        crease_edges=edge_table(with_handles(0).faces_of(4)).edges,
    ),
}
DART = ControlMesh.from_faces(drum(6).vertices, drum(6).faces_of(4), crease_edges=[[0, 1], [1, 2]])
TRIANGLES = {
    "ball": triangles(ball(14, 1)),
    "bumpy ball": triangles(bumpy_ball(60)),
    "disc": triangles(disc(30, 2)),
    "creased ball": creased_ball(),
    "ball with a dart": triangles(ball(40, 7), crease_edges=[ball(40, 7).face_vertices[0, :2]]),
}
POLYGONS = {
    "prism": prism(5),
    "dual": dual(triangles(ball(8, 1))),
    "triangles": triangles(ball(6, 1)),
    "open polygons": opened(dual(triangles(ball(10, 3))), 0),
    "polygons with a crease": ringed(prism(7), 13),
}
SEMI_SHARP = [
    (Scheme.CATMULL_CLARK, "semi-sharp quads", semi_sharp(shaken(with_handles(1), 0.05), 0.8, 0)),
    (Scheme.CATMULL_CLARK, "semi-sharp polygons", semi_sharp(prism(5), 1.5, 1)),
    (Scheme.LOOP, "semi-sharp triangles", semi_sharp(halved(shaken(with_handles(0), 0.05), 0), 0.8, 2)),
]
CASES = (
    [(Scheme.CATMULL_CLARK, name, mesh) for name, mesh in {**QUADS, "dart": DART}.items()]
    + [(Scheme.DOO_SABIN, name, mesh) for name, mesh in {**QUADS, "dart": DART}.items()]
    + [(Scheme.LOOP, name, mesh) for name, mesh in TRIANGLES.items()]
    + [(Scheme.DOO_SABIN, name, mesh) for name, mesh in POLYGONS.items()]
    + [(scheme, "crossed", crossed(scheme)) for scheme in (Scheme.CATMULL_CLARK, Scheme.DOO_SABIN)]
    + SEMI_SHARP
)
OPEN = ("sheet", "open", "disc", "open polygons", "crossed")
SPLIT = {Scheme.CATMULL_CLARK: split_polygons, Scheme.LOOP: split_triangles, Scheme.DOO_SABIN: lambda mesh: mesh}


def along_edges(mosaic, n=7):
    """For every use of an edge: its number, the gap to its curve, and unit normals (n, 3) of the patch along it."""
    shares = np.linspace(0.002, 0.998, n)
    for p, patch in enumerate(mosaic.patches):
        (u0, u1), (v0, v1) = patch.domain
        for side in range(4):
            for k in range(*mosaic.side_starts[4 * p + side : 4 * p + side + 2]):
                curve = mosaic.edge_curves[mosaic.side_edges[k]]
                first, last = curve.domain
                start, end = mosaic.side_ranges[k]
                t, one = start + shares * (end - start), np.ones(n)
                uv = np.stack(((t, v0 * one), (u1 * one, t), (t, v1 * one), (u0 * one, t))[side], axis=1)
                gap = np.abs(patch.point(uv) - curve.point(first + shares * (last - first))).max()
                normal = np.cross(patch.derivative(uv, 1, 0), patch.derivative(uv, 0, 1))
                yield int(mosaic.side_edges[k]), gap, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def mean_edge(mesh):
    sides = mesh.vertices[mesh.face_corners] - mesh.vertices[mesh.face_corners[mesh.next_corners()]]
    return np.linalg.norm(sides, axis=1).mean()


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]}, {case[1]}")
def test_faces_join_without_a_gap_and_smoothly(case):
    scheme, name, mesh = case
    faces = limit_faces(mesh, scheme)
    size = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    assert faces.mosaic.is_closed == (name not in OPEN)
    assert faces.off <= 0.005 * mean_edge(mesh)
    seen, angles = {}, []
    for edge, gap, normals in along_edges(faces.mosaic):
        assert gap <= 1e-9 * size
        if edge in seen and faces.mosaic.smooth_edges[edge]:
            sine = np.linalg.norm(np.cross(seen[edge], normals), axis=1)
            angles.append(np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", seen[edge], normals))).max())
        seen[edge] = normals
    assert max(angles, default=0.0) <= 0.01


@pytest.mark.parametrize("case", CASES[::3], ids=lambda case: f"{case[0]}, {case[1]}")
def test_points_of_the_limit_surface_lie_on_the_faces(case):
    scheme, _, mesh = case
    mosaic = limit_faces(mesh, scheme).mosaic
    dense = tessellate(settled(mesh, SPLIT[scheme]), scheme=scheme, halvings=2).vertices
    t = np.linspace(0.0, 1.0, 25)
    drawn = []
    for patch in mosaic.patches:
        (u0, u1), (v0, v1) = patch.domain
        cells = 2 * max(round(u1 - u0), round(v1 - v0), 1)
        u, v = (x.ravel() for x in np.meshgrid(*(np.linspace(0, 1, len(t) * cells // 2 + 1),) * 2))
        drawn.append(patch.point(np.column_stack([u0 + u * (u1 - u0), v0 + v * (v1 - v0)])))
    from scipy.spatial import cKDTree

    distance = cKDTree(np.concatenate(drawn)).query(dense)[0]
    # samples of the faces are at most this far apart
    assert distance.max() <= 0.06 * mean_edge(mesh)
    assert np.median(distance) <= 0.03 * mean_edge(mesh)


def test_regular_meshes_become_one_exact_face():
    mesh = grid(6, 7)
    faces = limit_faces(mesh, Scheme.CATMULL_CLARK)
    assert (len(faces.mosaic.patches), faces.n_exact, faces.off) == (1, 1, 0.0)
    patch = faces.mosaic.patches[0]
    rng = np.random.default_rng(0)
    face, v, w = rng.integers(mesh.n_faces, size=200), *rng.random((2, 200))
    exact = limit_points(mesh, (face, v, w), scheme=Scheme.CATMULL_CLARK)[:, 0]
    # the sheet is a height over the plane with even steps: parameters are its plan coordinates, either way round
    plan = np.column_stack([face // 7 + v, face % 7 + w])
    found = [
        np.abs(patch.point(uv) - exact).max()
        for a in (plan, [6.0, 0.0] + plan * [-1, 1], [0.0, 7.0] + plan * [1, -1], [6.0, 7.0] - plan)
        for uv in (a, a[:, ::-1])
        if (uv.max(axis=0) <= [patch.domain[0][1] + 1e-9, patch.domain[1][1] + 1e-9]).all()
    ]
    assert min(found) < 1e-13


def test_a_torus_is_cut_so_that_no_face_meets_itself():
    n = 12
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    a, b = 2 * np.pi * i / n, 2 * np.pi * j / n
    points = np.column_stack([(3 + np.cos(b)) * np.cos(a), (3 + np.cos(b)) * np.sin(a), np.sin(b)])
    step_i, step_j = (i + 1) % n * n + j, i * n + (j + 1) % n
    quads = np.stack([i * n + j, step_i, (i + 1) % n * n + (j + 1) % n, step_j], axis=1)
    faces = limit_faces(ControlMesh.from_faces(points, quads), Scheme.CATMULL_CLARK)
    mosaic = faces.mosaic
    owners = np.repeat(np.arange(4 * len(mosaic.patches)) // 4, np.diff(mosaic.side_starts))
    pairs = np.stack([owners, mosaic.side_edges], axis=1)
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    assert faces.off == 0.0
    assert len(mosaic.patches) <= 9


@pytest.mark.parametrize("scheme", [Scheme.CATMULL_CLARK, Scheme.DOO_SABIN])
def test_rectangles_are_the_same_surface_as_single_quads(scheme):
    from recon.subdivision.quad_faces import catmull_clark_faces, doo_sabin_faces

    make = catmull_clark_faces if scheme == Scheme.CATMULL_CLARK else doo_sabin_faces
    mesh = shaken(drum(5, layers=6), 0.03)
    one, many = make(mesh), make(mesh, grouped=False)
    assert len(one.mosaic.patches) < 0.5 * len(many.mosaic.patches)
    assert one.mosaic.is_closed and many.mosaic.is_closed


def test_triangles_of_isolated_irregular_vertices_are_not_refined():
    mesh = split_loop(TRIANGLES["ball"])
    assert len(limit_faces(mesh, Scheme.LOOP).mosaic.patches) == mesh.n_faces
    assert len(limit_faces(TRIANGLES["ball"], Scheme.LOOP).mosaic.patches) < 4 * TRIANGLES["ball"].n_faces


def split_loop(mesh):
    from recon.subdivision.loop import refine
    from recon.subdivision.sheets import cut_along_creases

    sheets, behind = cut_along_creases(mesh, 3)
    step = refine(sheets)
    return ControlMesh.from_faces(step.matrix @ mesh.vertices[behind], step.sheets.faces)


def test_mixed_faces_are_split_into_quads_with_the_same_surface():
    mesh = shaken(drum(5))
    once, direct = split_polygons(mesh), np.arange(mesh.n_faces)
    corner = limit_points(mesh, (direct, 0.0 * direct, 0.0 * direct), scheme=Scheme.CATMULL_CLARK)[:, 0]
    split = limit_points(once, (4 * direct, 0.0 * direct, 0.0 * direct), scheme=Scheme.CATMULL_CLARK)[:, 0]
    assert np.abs(corner - split).max() < 1e-13


def test_the_scheme_follows_from_the_faces():
    assert natural_scheme(TRIANGLES["ball"]) == Scheme.LOOP
    assert natural_scheme(QUADS["sheet"]) == Scheme.CATMULL_CLARK
    mixed = ControlMesh.from_faces(np.eye(5, 3), [[0, 1, 2], [0, 2, 3, 4]])
    assert natural_scheme(mixed) == Scheme.CATMULL_CLARK
