"""Terrain: contour lines to a mountain whose faces meet in common tangent planes.

The heights of a map are known along its contours alone. Between them the strips are tiled, two triangles at a time
become a four-sided patch, and every patch is one polynomial surface over its piece of the map:

     z = 140  ----o-------o-----o----        contour edges: curves in plan, constant height
                 / \\  Q  / \\ S /             tiling edges:  straight in plan, quintic in height
                / S \\   /   \\ /              Q quad, S sleeve, T terminal, J junction
     z = 120  -o-----o-o-----o-------        free vertices on ridges, valleys, summits, pits and saddles

Paper  [zhang2006] Zhang, Konno, Tokuyama: Curve mesh reconstruction based on mountain contours.
Start  `recon.terrain.pipeline`.
"""
