"""Voxels: a binary grid to a clean boundary, sharp edges kept, error bounded, and to CAD faces.

    o o o . .          .----.               .-------.
    o o o o .           \\    '--.           \\        \\        marching cubes -> feature voxels -> constrained
    o o o o o   --->     \\       '--  --->   \\        '--     edge collapse
    o o o o o             '---------          '-----------

Paper  [nakamura] Nakamura, Nishio, Kobori: Generation of boundary representation from binary voxel data.
Start  `recon.voxel_mesh.pipeline`.
"""
