import numpy as np
import pytest
from exact_shapes import (
    assert_sound,
    barrel,
    box_mesh,
    disk,
    edges_of,
    quarters,
    shapes_in,
    sphere,
    swapped,
    together,
    torus,
    volume,
)
from numpy.testing import assert_allclose
from OCP.BRep import BRep_Tool
from OCP.TopoDS import TopoDS
from scipy.interpolate import make_interp_spline
from thick_pieces import thick_piece

from brep_export.curves import curve_from_kernel
from brep_export.solids import lip_solid, mesh_solid, network_solid, polyhedron_solid, thick_solid, triangle_solid
from brep_export.surfaces import surface_from_kernel
from recon.errors import NotManifold, NoWall
from recon.geometry.bspline import BSplineCurve, BSplineSurface
from recon.geometry.mesh import TriangleMesh
from recon.geometry.patches import connect
from recon.geometry.polyhedron import PlanarFace, Polyhedron
from recon.geometry.trimmed import LipPiece, ThickPiece, TrimLoop, TrimmedSurface
from recon.tolerance import Tolerance

TOLERANCE = Tolerance()


def counts(shape):
    return tuple(len(shapes_in(shape, kind)) for kind in ("SOLID", "SHELL", "FACE", "EDGE", "VERTEX"))


def square_tube():
    """A 4 x 4 x 2 block with a 2 x 2 hole through it, its two ringed faces with a hole each."""
    ring = [(0, 0), (4, 0), (4, 4), (0, 4), (1, 1), (3, 1), (3, 3), (1, 3)]
    points = np.array([(x, y, z) for z in (0, 2) for x, y in ring], dtype=float)
    sides = [PlanarFace((k, (k + 1) % 4, 8 + (k + 1) % 4, 8 + k)) for k in range(4)]
    hole = [PlanarFace((4 + (k + 1) % 4, 4 + k, 12 + k, 12 + (k + 1) % 4)) for k in range(4)]
    ends = [PlanarFace((3, 2, 1, 0), ((4, 5, 6, 7),)), PlanarFace((8, 9, 10, 11), ((15, 14, 13, 12),))]
    faces = tuple(ends + sides + hole)
    return Polyhedron(points, faces, ((tuple(range(len(faces))),),))


def test_a_block_with_a_hole_through_it():
    solid = polyhedron_solid(square_tube())
    assert_sound(solid)
    assert counts(solid) == (1, 1, 10, 24, 16)
    assert_allclose(volume(solid), (16 - 4) * 2, rtol=1e-12)


@pytest.mark.parametrize(
    "make", [triangle_solid, lambda mesh: mesh_solid(mesh, TOLERANCE)], ids=["triangles", "merged"]
)
@pytest.mark.parametrize("scale", [1e-2, 1.0, 1e5])
def test_a_void_is_an_inner_shell_and_its_volume_is_missing(make, scale):
    mesh = together(box_mesh([0, 0, 0], [3 * scale] * 3), box_mesh([scale] * 3, [2 * scale] * 3, inside_out=True))
    solid = make(mesh)
    assert_sound(solid)
    assert counts(solid)[:2] == (1, 2)
    assert_allclose(volume(solid), 26 * scale**3, rtol=1e-9)


def test_two_bodies_that_touch_in_a_corner_share_nothing():
    compound = mesh_solid(together(box_mesh([0, 0, 0], [1, 1, 1]), box_mesh([1, 1, 1], [2, 2, 2])), TOLERANCE)
    assert_sound(compound)
    assert counts(compound) == (2, 2, 12, 24, 16)
    assert_allclose(volume(compound), 2, rtol=1e-12)


def test_a_body_inside_the_void_of_another_is_a_body_of_its_own():
    nested = together(
        box_mesh([0] * 3, [5] * 3), box_mesh([1] * 3, [4] * 3, inside_out=True), box_mesh([2] * 3, [3] * 3)
    )
    compound = triangle_solid(nested)
    assert_sound(compound)
    assert counts(compound)[:2] == (2, 3)
    assert_allclose(volume(compound), 125 - 27 + 1, rtol=1e-12)


def test_a_triangle_solid_has_the_volume_of_its_mesh_and_shares_all_corners_and_edges():
    n = 12
    turn, tilt = np.meshgrid(np.arange(2 * n) * np.pi / n, np.arange(1, n) * np.pi / n)
    rings = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=-1)
    at = np.arange(rings.size // 3).reshape(rings.shape[:2])
    after = np.roll(at, -1, axis=1)
    top, bottom = np.full(2 * n, at.size), np.full(2 * n, at.size + 1)
    quads = [(at[:-1], at[1:], after[1:]), (at[:-1], after[1:], after[:-1])]
    fans = [(top, at[0], after[0]), (bottom, after[-1], at[-1])]
    faces = np.concatenate([np.stack([c.ravel() for c in corners], axis=1) for corners in quads + fans])
    mesh = TriangleMesh(np.concatenate([rings.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]]), faces)
    solid = triangle_solid(mesh)
    assert_sound(solid)
    assert counts(solid) == (1, 1, mesh.n_faces, 3 * mesh.n_faces // 2, mesh.n_vertices)
    assert_allclose(volume(solid), mesh.volume(), rtol=1e-12)


@pytest.mark.parametrize(
    ("mesh", "problem"),
    [
        (box_mesh([0] * 3, [1] * 3, inside_out=True), "inside out"),
        (box_mesh([0] * 3, [1] * 3).part(np.arange(11)), "open"),
        (together(box_mesh([0] * 3, [1] * 3), box_mesh([0.2] * 3, [0.8] * 3)), "material of another"),
        (
            TriangleMesh(
                box_mesh([0] * 3, [1] * 3).vertices, np.concatenate([box_mesh([0] * 3, [1] * 3).face_vertices] * 2)
            ),
            "belongs to 4 faces",
        ),
    ],
    ids=["inside out", "open", "one in another", "double"],
)
def test_meshes_that_bound_no_body_are_refused_with_a_place(mesh, problem):
    for make in (triangle_solid, lambda m: mesh_solid(m, TOLERANCE)):
        with pytest.raises(NotManifold, match=problem) as refusal:
            make(mesh)
        assert refusal.value.where is not None


def test_a_polyhedron_inside_out_is_refused_not_turned():
    tube = square_tube()
    turned = tuple(PlanarFace(f.outer[::-1], tuple(h[::-1] for h in f.holes)) for f in tube.faces)
    with pytest.raises(NotManifold, match="inside out"):
        polyhedron_solid(Polyhedron(tube.vertices, turned, tube.bodies))


@pytest.mark.parametrize(
    ("patches", "expected"),
    [
        ([torus(3, 1)], 2 * np.pi**2 * 3),
        ([swapped(torus(3, 1))], 2 * np.pi**2 * 3),
        ([sphere(2)], 4 / 3 * np.pi * 8),
        ([swapped(q) for q in quarters(sphere(2))], 4 / 3 * np.pi * 8),
        ([barrel(2, 2, 5), disk(2, 0), disk(2, 5)], np.pi * 4 * 5),
        ([barrel(3, 0, 4), disk(3, 0)], np.pi * 9 * 4 / 3),
    ],
    ids=["torus", "torus inward", "sphere", "sphere inward", "cylinder", "cone"],
)
def test_closed_networks_are_solids_of_known_volume_whichever_way_their_patches_point(patches, expected):
    solid = network_solid(connect(patches, 1e-7), TOLERANCE)
    assert_sound(solid)
    assert_allclose(volume(solid), expected, rtol=1e-7)


def test_open_networks_and_several_parts_are_no_solid():
    with pytest.raises(NotManifold, match="open"):
        network_solid(connect(quarters(sphere(2))[:3], 1e-7), TOLERANCE)
    with pytest.raises(NotManifold, match="2 closed parts"):
        network_solid(connect([sphere(1), torus(9, 1)], 1e-7), TOLERANCE)


@pytest.mark.parametrize("n_walls", [1, 2, 4, 7])
def test_a_thick_piece_is_one_solid_with_a_face_for_each_sheet_and_wall(n_walls):
    solid = thick_solid(thick_piece(n_walls), TOLERANCE)
    assert_sound(solid)
    assert counts(solid) == (1, 1, 2 + n_walls, 3 * n_walls, 2 * n_walls)


def test_flat_sheets_and_upright_walls_enclose_area_times_height():
    piece = thick_piece(4, bump=0.0)
    outer = piece.outer
    net = np.array(outer.surface.control_net)
    top, bottom = net.copy(), net.copy()
    top[..., 2], bottom[..., 2] = 1.5, 0.0
    sheets = [
        TrimmedSurface(BSplineSurface(3, 3, outer.surface.knots_u, outer.surface.knots_v, n), outer.loops)
        for n in (top, bottom)
    ]
    walls = []
    for wall in piece.wall:
        rim = np.array(wall.control_net[:, 0])
        upright = np.stack([rim, rim], axis=1)
        upright[:, 0, 2], upright[:, 1, 2] = 1.5, 0.0
        walls.append(BSplineSurface(3, 1, wall.knots_u, wall.knots_v, upright))
    solid = thick_solid(ThickPiece(sheets[0], sheets[1], tuple(walls)), TOLERANCE)
    assert_sound(solid)
    loop = sheets[0].surface.point(outer.loops[0].polygon(2000))
    x, y = loop[:, 0], loop[:, 1]
    ring_area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert_allclose(volume(solid, 1e-7), 1.5 * ring_area, rtol=1e-4)


@pytest.mark.parametrize("samples", [30, 60])
def test_edges_of_a_thick_piece_have_a_tolerance_that_covers_the_gap_and_little_more(samples):
    solid = thick_solid(thick_piece(2, samples=samples), TOLERANCE)
    for face in map(TopoDS.Face_s, shapes_in(solid, "FACE")):
        surface = surface_from_kernel(BRep_Tool.Surface_s(face))
        for edge in edges_of(face):
            domain = BRep_Tool.Range_s(edge)
            at = np.linspace(*domain, 2000)
            in_space = curve_from_kernel(BRep_Tool.Curve_s(edge, *domain)).point(at)
            pcurve = BRep_Tool.CurveOnSurface_s(edge, face, *domain)
            on_face = surface.point([pcurve.Value(t).Coord() for t in at.tolist()])
            gap = np.linalg.norm(in_space - on_face, axis=1).max()
            assert gap <= BRep_Tool.Tolerance_s(edge) <= TOLERANCE.fit


def test_a_wall_that_misses_its_sheet_is_refused():
    piece = thick_piece(4)
    net = np.array(piece.wall[2].control_net)
    net[3:6, 0, 2] += 0.5
    torn = BSplineSurface(3, 1, piece.wall[2].knots_u, piece.wall[2].knots_v, net)
    with pytest.raises(NoWall, match="wall 2 and the outer sheet"):
        thick_solid(ThickPiece(piece.outer, piece.inner, (*piece.wall[:2], torn, piece.wall[3])), TOLERANCE)


def test_a_thick_piece_with_its_sheets_exchanged_is_refused():
    piece = thick_piece(3)
    walls = tuple(BSplineSurface(3, 1, w.knots_u, w.knots_v, w.control_net[:, ::-1]) for w in piece.wall)
    with pytest.raises(NotManifold, match="inside out"):
        thick_solid(ThickPiece(piece.inner, piece.outer, walls), TOLERANCE)


def flat_rim(n_walls, *, depth=12.0, width=10.0, thickness=3.0):
    """A hairpin of constant section along x, cut off by upright curved cuts: its volume is known by integration."""
    s = np.linspace(-depth, depth, 401)
    half = thickness / 2
    turn = np.clip(s / half, -np.pi / 2, np.pi / 2)
    down = np.maximum(np.abs(s) - half * np.pi / 2, 0.0)
    section = np.stack([half * np.sin(turn), half * np.cos(turn) - down], axis=1)
    profile = make_interp_spline(s, section, k=3)
    net = np.stack([np.column_stack([np.full(len(profile.c), x), profile.c]) for x in (-width, width)])
    surface = BSplineSurface(1, 3, [-width, -width, width, width], profile.t, net)
    t = np.linspace(0.0, np.pi, 40 * n_walls + 1)
    chains = [np.stack([-7.0 * np.cos(t), way * 9.0 * np.sin(t)], axis=1) for way in (-1.0, 1.0)]
    curves, walls = [[], []], []
    for k in range(n_walls):
        rows = np.s_[40 * k : 40 * k + 41]
        rims = []
        for uv, row in zip(chains, curves):
            spline = make_interp_spline(t[rows], np.column_stack([uv, surface.point(uv)])[rows], k=3)
            control = np.array(spline.c)
            control[0], control[-1] = spline(t[rows][0]), spline(t[rows][-1])
            row.append(BSplineCurve(3, spline.t, control[:, :2]))
            rims.append(control[:, 2:])
        walls.append(BSplineSurface(3, 1, spline.t, [0, 0, 1, 1], np.stack(rims, axis=1)))
    loop = TrimLoop((*curves[0], *(c.reversed() for c in reversed(curves[1]))))
    return LipPiece(TrimmedSurface(surface, (loop,)), tuple(walls))


@pytest.mark.parametrize("n_walls", [1, 4])
def test_a_piece_of_a_rim_is_a_sound_solid(n_walls):
    solid = lip_solid(flat_rim(n_walls), TOLERANCE)
    assert_sound(solid)
    assert counts(solid)[:3] == (1, 1, 1 + n_walls)


def test_a_piece_of_a_rim_encloses_what_lies_under_its_face():
    # upright cuts: the area between both chains, seen from the side, times the thickness, the round of the lip apart
    half, t = 1.5, np.linspace(0.0, np.pi, 20001)
    s = 9.0 * np.sin(t)
    turn = np.minimum(s / half, np.pi / 2)
    area = half**2 * (turn - np.sin(turn) * np.cos(turn)) + 2 * half * np.maximum(s - half * np.pi / 2, 0.0)
    expected = np.trapezoid(area, -7.0 * np.cos(t))
    assert_allclose(volume(lip_solid(flat_rim(4), TOLERANCE), 1e-6), expected, rtol=2e-3)


def test_a_fracture_that_misses_the_rim_is_refused():
    piece = flat_rim(4)
    net = np.array(piece.wall[1].control_net)
    net[10:13, 0, 1] += 0.5
    torn = BSplineSurface(3, 1, piece.wall[1].knots_u, piece.wall[1].knots_v, net)
    with pytest.raises(NoWall, match="wall 1 and the outer edge"):
        lip_solid(LipPiece(piece.face, (piece.wall[0], torn, *piece.wall[2:])), TOLERANCE)
