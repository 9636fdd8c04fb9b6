"""Pottery: a broken vessel lacks a piece; the walls around the hole tell what it looked like.

    sherds in pose           smoothed walls          base patch, fitted         trimmed, thick
     _____   _____            ~~~~~   ~~~~~            ~~~~~~~~~~~~~               .-------.
    |_____| |_____|   --->    wall     wall    --->   (  the hole   )    --->     /  piece  \\
     ___       ___            ~~~       ~~~            ~~~~~~~~~~~~~              '---------'

Paper  [kinoshita] Kinoshita, Muraki, Matsuyama, Konno: Piece modeling method around a hole to reconstruct an
       earthenware vessel. Relief is removed as in [taubin1995].
Start  `recon.hole_patch.pipeline`.
"""
