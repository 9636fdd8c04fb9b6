"""Subdivision surfaces: masks, limits, patches. What the fit of scans moves, and what becomes faces of a solid.

    control mesh        sheets                limit patches           patch network
     o----o----o       cut along creases,     evaluated anywhere      for a kernel: sides
     |    |    |  -->  so that a sheet is --> with derivatives,  -->  shared, tangent planes
     o----o----o       smooth inside          to the last digit       alike across them

Paper  [loop1987], [stam1998].
"""
