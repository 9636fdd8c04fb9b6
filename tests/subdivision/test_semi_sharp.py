"""Semi-sharp creases follow the papers' rules, and are gone after as many steps as they are sharp."""

import numpy as np
import pytest
from hull_meshes import ball
from limit_meshes import faces_of, prism, semi_sharp
from numpy.testing import assert_allclose
from plain_subdivision import catmull_clark_step, plain
from quad_meshes import drum, grid, shaken, with_handles
from scipy.spatial import cKDTree

from recon.errors import BadGeometry
from recon.geometry.control_mesh import ControlMesh
from recon.subdivision import loop
from recon.subdivision.doo_sabin import doo_sabin_patches
from recon.subdivision.limit_surface import limit_patches
from recon.subdivision.polygons import n_steps, settled, split_polygons, split_triangles
from recon.subdivision.semi_sharp import mesh_edges, refuse_cones
from recon.subdivision.sheets import cut_along_creases

QUADS = {"handle": shaken(with_handles(1), 0.05), "drum": shaken(drum(5), 0.05), "sheet": shaken(grid(4, 3))}
TRIANGLES = ControlMesh.from_faces(ball(20, 3).vertices, ball(20, 3).face_vertices)


def marked(mesh, edges, sharpness):
    return ControlMesh.from_faces(
        mesh.vertices, faces_of(mesh), crease_edges=edges, crease_sharpness=np.broadcast_to(sharpness, len(edges))
    )


def some_edges(mesh, seed=0):
    ends = mesh_edges(mesh).ends
    return ends[np.random.default_rng(seed).choice(len(ends), len(ends) // 3, replace=False)]


@pytest.mark.parametrize("sharpness", [0.4, 1.0, 1.7, (0.2, 2.9)])
@pytest.mark.parametrize("name", QUADS)
def test_semi_sharp_creases_go_the_way_of_the_paper(name, sharpness):
    mesh = QUADS[name]
    edges = some_edges(mesh)
    each = np.random.default_rng(1).uniform(*np.broadcast_to(sharpness, 2), len(edges))
    found = settled(marked(mesh, edges, each), split_polygons)
    expected = plain(mesh)
    expected = expected._replace(creases={tuple(sorted(e)): s for e, s in zip(edges.tolist(), each.tolist())})
    for _ in range(int(np.ceil(each.max()))):
        expected = catmull_clark_step(expected)
    assert found.n_vertices == len(expected.points) and not found.is_semi_sharp
    assert cKDTree(expected.points).query(found.vertices)[0].max() < 1e-14


@pytest.mark.parametrize("split, mesh", [(split_polygons, QUADS["handle"]), (split_triangles, TRIANGLES)])
def test_a_sharpness_of_one_is_one_step_of_a_crease_for_ever(split, mesh):
    edges = some_edges(mesh)
    once, ever = split(marked(mesh, edges, 1.0)), split(marked(mesh, edges, np.inf))
    assert_allclose(once.vertices, ever.vertices, atol=1e-15)
    assert len(once.crease_edges) == 0 and len(ever.crease_edges) == 2 * len(edges)


@pytest.mark.parametrize("split, mesh", [(split_polygons, QUADS["handle"]), (split_triangles, TRIANGLES)])
def test_half_a_step_lies_half_way(split, mesh):
    edges = some_edges(mesh)
    smooth, half, sharp = (split(m).vertices for m in (mesh, marked(mesh, edges, 0.5), marked(mesh, edges, 1.0)))
    assert_allclose(half, (smooth + sharp) / 2, atol=1e-15)


def test_where_creases_differ_those_that_end_weigh():
    # a vertex on a crease for ever, where two others of sharpness 0.3 and 0.7 end: half corner, half curve
    mesh = grid(4, 4)
    middle, through, ending = 12, [[7, 12], [12, 17]], [[11, 12], [12, 13]]
    made = split_polygons(
        ControlMesh.from_faces(
            mesh.vertices, mesh.faces_of(4), crease_edges=through + ending, crease_sharpness=[np.inf, np.inf, 0.3, 0.7]
        )
    )
    at = mesh.vertices
    curve = 0.75 * at[middle] + 0.125 * (at[7] + at[17])
    assert_allclose(made.vertices[middle], (at[middle] + curve) / 2, atol=1e-15)


def test_a_semi_sharp_corner_stays_and_then_goes():
    mesh = grid(4, 4)
    corner = ControlMesh.from_faces(mesh.vertices, mesh.faces_of(4), corner_vertices=[12], corner_sharpness=[1.25])
    once = split_polygons(corner)
    assert_allclose(once.vertices[12], mesh.vertices[12], atol=0)
    assert once.corner_sharpness[once.corner_vertices == 12].tolist() == [0.25]
    plain_twice, twice = split_polygons(split_polygons(mesh)), split_polygons(once)
    smooth = split_polygons(ControlMesh.from_faces(once.vertices, once.faces_of(4)))
    assert_allclose(twice.vertices[12], 0.25 * once.vertices[12] + 0.75 * smooth.vertices[12], atol=1e-15)
    assert len(twice.face_starts) == len(plain_twice.face_starts) and 12 not in twice.corner_vertices


def test_triangles_are_split_as_loops_masks_do():
    mesh = marked(TRIANGLES, some_edges(TRIANGLES), np.inf)
    sheets, behind = cut_along_creases(mesh, 3)
    step, split = loop.refine(sheets), split_triangles(mesh)
    assert_allclose(
        split.vertices[split.faces_of(3)], (step.matrix @ mesh.vertices[behind])[step.sheets.faces], atol=1e-15
    )


def test_steps_are_counted_to_the_smooth_end():
    assert [n_steps(semi_sharp(TRIANGLES, 1.0, 0)), n_steps(TRIANGLES)] == [2, 0]


def test_a_cone_is_refused_by_its_place():
    with pytest.raises(BadGeometry, match="no sharp edge"):
        refuse_cones(ControlMesh.from_faces(TRIANGLES.vertices, faces_of(TRIANGLES), corner_vertices=[3]))
    refuse_cones(semi_sharp(TRIANGLES, 1.0, 0))


def test_creases_that_take_too_many_faces_are_refused():
    with pytest.raises(BadGeometry, match=r"steps until its creases are smooth take over 250,000 faces"):
        settled(marked(QUADS["handle"], some_edges(QUADS["handle"]), 9.5), split_polygons)


def test_limit_patches_ask_for_refinement_and_doo_sabin_for_sharp_creases():
    mesh = marked(QUADS["handle"], some_edges(QUADS["handle"]), 0.5)
    with pytest.raises(BadGeometry, match="before they are refined away"):
        limit_patches(semi_sharp(TRIANGLES, 1.0, 0))
    with pytest.raises(BadGeometry, match="no meaning in Doo-Sabin"):
        doo_sabin_patches(mesh)


@pytest.mark.parametrize("sharpness", [0.0, -1.0, np.nan])
def test_a_sharpness_is_above_nothing(sharpness):
    with pytest.raises(BadGeometry, match="above 0"):
        ControlMesh.from_faces(
            prism(3).vertices, faces_of(prism(3)), crease_edges=[[0, 1]], crease_sharpness=[sharpness]
        )
