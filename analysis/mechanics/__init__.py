"""Contact mechanics of a sphere on a plane: closed forms, the surface of the block as an operator,
and loading under a law of friction.

===========================================================  =======================================================
Quantity                                                     Where
===========================================================  =======================================================
contact radius, pressure, indentation under P                `hertz`
the same with adhesion; with roughness                       `jkr`; `greenwood_tripp`
stick radius, shear traction, surface displacement, Q(D)     `cattaneo_mindlin`
surface displacement of any traction: half-space, layer      `half_space.SurfaceGreen`
local friction law with its memory                           `interface.Interface`
loading under that law: round contact; any, on a grid        `loading.AxisymmetricLoading`;
`loading_grid`
===========================================================  =======================================================
"""
