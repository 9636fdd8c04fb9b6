"""Drawings: the solids with planar faces that three views can mean, every one of them.

    three views            cells of space, each solid or empty          the solids
     +--+  +--+             .---.---.
     |  |  |  |    --->     | a | b |    what each line of    --->      all of them,
     +--+  +--+             '---'---'    sight may meet                 drawn again as given
     +--+

The paper chooses among candidate faces, and a face may cover a union of minimal regions, of which there are too many.
Here the same problem is posed on cells:

    paper                                   here
    2D points and edges                     points and edges of a `ViewGraph`
    unit, a 3D face                         fragment, a minimal region of a candidate plane; larger faces appear when
                                            coplanar fragments are merged
    label: absent, facing, facing away      the cells on the two sides of a fragment: alike, empty before solid, solid
                                            before empty
    conditions (3) and (4)                  hold for every choice of solid cells
    conditions (1), (2), (5)                clauses on what is nearest left and right of each drawn edge

Paper  [watanabe] Watanabe, Nishihara, Ikeda: Understanding orthographic views by retrieving consistent interpretations
       of faces. Candidate vertices and edges, and the lines along which candidate faces cut each other, are those of
       [wesley1981].
Start  `recon.three_view.pipeline`.
"""
