"""Scans to subdivision surfaces: control points move by what the scan is away from the surface.

    scan, 100,000 points      control mesh, 1,500 points       limit surface
       . :. .:. :.                 o---------o                   .-~~~~-.
     .:. : .:. :..:     QEM      /   \\     /   \\      fit        (        )     every control point moves until the
     : .:. :. .: :     ---->    o-----o---o-----o    ---->      (        )      foot points of the scan are near
       .: :. .:                  \\   /     \\   /                  `-____-'

Paper  [maekawa2009] surfaces fitted without a linear system; [marinov2005] the method it is compared with.
Start  `recon.geometric_fit.pipeline`; `spline_fit` for one B-spline or NURBS face, `curve_fit` for rows of points.
"""
