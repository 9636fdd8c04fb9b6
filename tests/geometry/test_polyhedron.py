import numpy as np
import pytest
from numpy.testing import assert_allclose

from recon.errors import BadGeometry, NotManifold
from recon.geometry.mesh import TriangleMesh
from recon.geometry.polyhedron import PlanarFace, Polyhedron, merge_coplanar, mesh_bodies

UPRIGHT = np.eye(3)


def cells_mesh(solid, noise=0.0, turn=UPRIGHT):
    """The surface of unit cells, two triangles a cell side."""
    solid = np.pad(np.asarray(solid, dtype=bool), 1)
    shape = np.array(solid.shape) + 1
    points = np.stack(np.meshgrid(*(np.arange(s, dtype=float) for s in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    unit, quads = np.eye(3, dtype=int), []
    for axis in range(3):
        u, v = unit[(axis + 1) % 3], unit[(axis + 2) % 3]
        for way in (1, -1):
            base = np.argwhere(solid & ~np.roll(solid, -way, axis=axis)) + (unit[axis] if way > 0 else 0)
            around = [base, base + u, base + u + v, base + v][::way]
            quads.append(np.stack([np.ravel_multi_index(tuple(c.T), tuple(shape)) for c in around], axis=1))
    q = np.concatenate(quads)
    faces = np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])
    used, faces = np.unique(faces, return_inverse=True)
    shift = np.random.default_rng(4).uniform(-noise, noise, (len(used), 3))
    return TriangleMesh((points[used] + shift) @ np.asarray(turn).T, faces.reshape(-1, 3))


def stepped_block(n):
    """An L, one arm raised, a square hole through the other: 14 faces, 35 edges, 23 corners, 2 rings, 1 tunnel."""
    solid = np.zeros((7, 7, 2), dtype=bool)
    solid[:3, :, 0] = solid[:, :3, 0] = solid[3:, :3, 1] = True
    solid[1, 5, 0] = False
    return np.kron(solid, np.ones((n, n, n), dtype=bool))


def edges(polyhedron):
    sides = [side for face in polyhedron.faces for loop in face.loops for side in zip(loop, loop[1:] + loop[:1])]
    assert len(sides) == len(set(sides))
    assert {(b, a) for a, b in sides} == set(sides)  # each edge once in each direction
    return {tuple(sorted(side)) for side in sides}


def volume(polyhedron):
    """Divergence theorem over the fans of all loops."""
    total = 0.0
    for face in polyhedron.faces:
        for loop in face.loops:
            p = polyhedron.vertices[list(loop)]
            total += np.einsum("ij,ij->", np.cross(p[1:-1] - 0, p[2:]), np.broadcast_to(p[0], p[2:].shape)) / 6
    return total


def turned(seed):
    matrix = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return matrix * np.sign(np.linalg.det(matrix))


@pytest.mark.parametrize("noise", [0.0, 1e-6])
@pytest.mark.parametrize("turn", [np.eye(3), turned(0), turned(1)], ids=["upright", "turned", "turned too"])
def test_a_stepped_block_of_fine_triangles_has_the_faces_edges_and_corners_counted_by_hand(noise, turn):
    mesh = cells_mesh(stepped_block(3), noise, turn)
    body = merge_coplanar(mesh, max(5 * noise, 1e-9))
    assert (len(body.faces), len(edges(body)), len(body.vertices)) == (14, 35, 23)
    rings = sum(len(face.holes) for face in body.faces)
    assert len(body.vertices) - len(edges(body)) + len(body.faces) - rings == 2 - 2 * 1  # Euler-Poincaré, one tunnel
    assert_allclose(volume(body), mesh.volume(), rtol=1e-6)


@pytest.mark.parametrize("seed", range(25))
def test_unions_of_boxes_keep_their_volume_and_their_edges_match(seed):
    rng = np.random.default_rng(seed)
    solid = np.zeros((6, 6, 6), dtype=bool)
    for _ in range(3):
        low = rng.integers(0, 4, 3)
        high = low + rng.integers(2, 4, 3)
        solid[tuple(slice(a, b) for a, b in zip(low, high))] = True
    mesh = cells_mesh(solid, turn=turned(seed))
    try:
        bodies = mesh_bodies(mesh)
    except NotManifold:
        return  # boxes that meet along an edge only
    body = merge_coplanar(mesh, 1e-9)
    assert len(body.bodies) == len(bodies)
    assert len(edges(body)) >= 12
    assert_allclose(volume(body), solid.sum(), rtol=1e-12)


def test_corners_of_a_noisy_mesh_move_to_where_its_planes_meet():
    noise = 1e-6
    body = merge_coplanar(cells_mesh(np.ones((8, 8, 8)), noise), 5 * noise)
    away = np.abs(body.vertices - np.round(body.vertices)).max()
    for face in body.faces:
        p = body.vertices[list(face.outer)]
        normal = np.cross(p[1] - p[0], p[2] - p[0])
        assert abs((p[3] - p[0]) @ normal) / np.linalg.norm(normal) < 1e-12
    assert away <= 2 * noise


def test_corners_of_an_exact_mesh_stay_where_they_are_to_the_last_bit():
    mesh = cells_mesh(stepped_block(2))
    corners = {tuple(v) for v in mesh.vertices.tolist()}
    assert all(tuple(v) in corners for v in merge_coplanar(mesh, 1e-6).vertices.tolist())


def test_a_void_belongs_to_the_body_around_it_and_a_body_in_the_void_is_its_own():
    solid = np.ones((7, 7, 7), dtype=bool)
    solid[1:6, 1:6, 1:6] = False
    solid[3, 3, 3] = True
    bodies = merge_coplanar(cells_mesh(solid), 1e-9).bodies
    assert sorted(len(body) for body in bodies) == [1, 2]
    assert all(len(shell) == 6 for body in bodies for shell in body)


def test_a_face_whose_hole_touches_itself_comes_apart_into_simple_loops():
    pits = [(1, 1), (2, 2)]  # pyramids sunk into cells of the top that meet in one corner
    mesh = cells_mesh(np.ones((4, 4, 2)))
    points, faces = mesh.vertices.tolist(), mesh.face_vertices
    top = mesh.corners()[:, :, 2].min(axis=1) == mesh.vertices[:, 2].max()
    cell = np.floor(mesh.corners().mean(axis=1)[:, :2] - 1).astype(int).tolist()
    keep = [not (t and tuple(c) in pits) for t, c in zip(top.tolist(), cell)]
    number = {tuple(p): i for i, p in enumerate(points)}
    sunk = []
    for i, j in pits:
        points.append([i + 1.5, j + 1.5, 2.0])
        rim = [number[i + 1.0 + a, j + 1.0 + b, 3.0] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
        sunk += [[rim[k], rim[(k + 1) % 4], len(points) - 1] for k in range(4)]
    body = merge_coplanar(TriangleMesh(points, np.concatenate([faces[keep], sunk])), 1e-9)
    assert sorted(len(face.holes) for face in body.faces)[-2:] == [0, 2]
    assert len(body.faces) == 6 + 8
    assert_allclose(volume(body), 32 - 2 / 3, rtol=1e-12)


def test_curved_surfaces_come_apart_into_flat_pieces_within_the_tolerance():
    n, height = 200, 3.0
    turn = np.arange(n) * 2 * np.pi / n
    ring = np.stack([5 * np.cos(turn), 5 * np.sin(turn), np.zeros(n)], axis=1)
    points = np.concatenate([ring, ring + np.array([0, 0, height]), [[0, 0, 0], [0, 0, height]]])
    a, b = np.arange(n), np.roll(np.arange(n), -1)
    low, high = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    parts = ((a, b, n + b), (a, n + b, n + a), (b, a, low), (n + a, n + b, high))
    faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    mesh = TriangleMesh(points, faces)
    assert len(merge_coplanar(mesh, 1e-9).faces) == n + 2
    tolerance = 0.02
    coarse = merge_coplanar(mesh, tolerance)
    edges(coarse)
    assert 10 < len(coarse.faces) < n
    assert abs(volume(coarse) - mesh.volume()) < 3 * tolerance * 2 * np.pi * 5 * height


def test_a_triangle_without_area_on_an_edge_disappears():
    box = cells_mesh(np.ones((1, 1, 1)))
    a, b, c = box.face_vertices[0].tolist()
    points = [*box.vertices.tolist(), ((box.vertices[a] + box.vertices[b]) / 2).tolist()]
    m = len(points) - 1
    faces = np.concatenate([box.face_vertices[1:], [[a, m, c], [m, b, c], [a, b, m]]])
    body = merge_coplanar(TriangleMesh(points, faces), 1e-9)
    assert (len(body.faces), len(edges(body)), len(body.vertices)) == (6, 12, 8)


@pytest.mark.parametrize("noise", [0.0, 1e-9])
def test_a_sheet_thinner_than_the_tolerance_is_refused(noise):
    box = cells_mesh(np.ones((3, 3, 1)), noise)
    flat = TriangleMesh(box.vertices * [1, 1, 1e-4], box.face_vertices)
    with pytest.raises(NotManifold, match="thinner than the tolerance"):
        merge_coplanar(flat, 1e-2)


def test_meshes_that_bound_nothing_are_refused_with_a_place():
    box = cells_mesh(np.ones((2, 2, 2)))
    inside_out = TriangleMesh(box.vertices, box.face_vertices[:, ::-1])
    one_turned = np.array(box.face_vertices)
    one_turned[5] = one_turned[5, ::-1]
    touching = np.zeros((2, 2, 1))
    touching[0, 0] = touching[1, 1] = 1
    for mesh, problem in (
        (box.part(np.arange(1, box.n_faces)), "open"),
        (inside_out, "inside out"),
        (TriangleMesh(box.vertices, one_turned), "same direction"),
        (cells_mesh(touching), "belongs to 4 faces"),
    ):
        with pytest.raises(NotManifold, match=problem) as refusal:
            mesh_bodies(mesh)
        assert refusal.value.where is not None


def test_a_polyhedron_names_only_what_exists_and_each_face_once():
    points = np.eye(3)
    with pytest.raises(BadGeometry, match="does not exist"):
        Polyhedron(points, (PlanarFace((0, 1, 3)),), (((0,),),))
    with pytest.raises(BadGeometry, match="exactly one shell"):
        Polyhedron(points, (PlanarFace((0, 1, 2)),), (((0,), (0,)),))
