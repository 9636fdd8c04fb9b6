"""Tracks part meshes of quadrilaterals into rectangles whose inside is regular."""

import numpy as np
import pytest
from quad_meshes import drum, grid, shaken, with_handles

from recon.geometry.control_mesh import ControlMesh
from recon.subdivision.layout import isolated
from recon.subdivision.rectangles import rectangles
from recon.subdivision.tracks import tracks

MESHES = {
    **{f"valence {n}": drum(n, layers=5) for n in (3, 5, 7)},
    **{f"genus {g}": with_handles(g) for g in range(3)},
    "crease": ControlMesh.from_faces(
        drum(6, layers=4).vertices, drum(6, layers=4).faces_of(4), crease_edges=[[0, 1], [1, 2]]
    ),
}


def boxes_of(mesh):
    layout = isolated(mesh)
    sheets = layout.sheets
    on_track = tracks(sheets.faces, sheets.across, layout.regular)
    return layout, on_track, rectangles(sheets.faces, np.where(on_track, -1, sheets.across))


@pytest.mark.parametrize("name", MESHES)
def test_irregular_vertices_lie_at_corners_of_rectangles_alone(name):
    layout, _, boxes = boxes_of(MESHES[name])
    assert sorted(np.concatenate([box.faces.ravel() for box in boxes])) == list(range(len(layout.regular)))
    for box in boxes:
        n, m = box.faces.shape
        for j, i in np.argwhere(~layout.regular[box.faces]):
            # the irregular corner 0 of a quad with side `turn` at the bottom lies at its corner -turn
            right, top = np.array([(0, 0), (0, 1), (1, 1), (1, 0)])[box.turns[j, i]]
            assert (i, j) == ((m - 1) * right if m > 1 else 0, (n - 1) * top if n > 1 else 0)


@pytest.mark.parametrize("name", MESHES)
def test_a_track_is_seen_from_both_sides_and_ends_at_another_or_at_a_border(name):
    layout, on_track, _ = boxes_of(MESHES[name])
    faces, across = layout.sheets.faces, layout.sheets.across
    assert on_track.any()
    assert on_track.ravel()[across[on_track]].all()
    ends = np.concatenate([faces[on_track], np.roll(faces, -1, axis=1)[on_track]])
    free = across < 0
    borders = np.concatenate([faces[free], np.roll(faces, -1, axis=1)[free]])
    uses = np.bincount(ends, minlength=faces.max() + 1) // 2  # each side is seen twice
    alone = np.flatnonzero(uses == 1)
    assert np.isin(alone, np.concatenate([borders, faces[~layout.regular, 0]])).all()


def test_a_regular_mesh_has_no_tracks():
    layout, on_track, boxes = boxes_of(shaken(grid(5, 8)))
    assert layout.regular.all() and not on_track.any()
    assert [box.faces.shape for box in boxes] in ([(5, 8)], [(8, 5)])


def test_rectangles_are_at_most_three_for_four_irregular_quads():
    for mesh in MESHES.values():
        layout, _, boxes = boxes_of(mesh)
        if (layout.sheets.across >= 0).all():
            assert len(boxes) <= 0.75 * (~layout.regular).sum()


def test_a_rectangle_that_meets_itself_at_a_vertex_is_cut_between_the_places():
    n = 6
    low, high = np.arange(n + 1), n + 1 + np.arange(n + 1)
    low[-1] = low[0]  # a row of quads bent round, its ends joined at a corner alone
    faces = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
    across = np.full((n, 4), -1)
    across[:-1, 1], across[1:, 3] = 4 * np.arange(1, n) + 3, 4 * np.arange(n - 1) + 1
    boxes = rectangles(faces, across)
    assert sorted(box.faces.size for box in boxes) == [3, 3]
    assert all(len(np.unique(faces[box.faces])) == 2 * (box.faces.size + 1) for box in boxes)
