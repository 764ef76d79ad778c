"""Contact mechanics of a sphere on a plane: closed forms, the surface of the block as an operator,
and loading under a law of friction.

======================================================  =======================================
Quantity                                                Where
======================================================  =======================================
Contact radius, pressure, indentation under P           `hertz`
The same with adhesion; with roughness                  `jkr`; `greenwood_tripp`
Stick radius, shear traction, displacement, Q(D)        `cattaneo_mindlin`
Surface displacement of any traction: half-space,       `half_space.SurfaceGreen`
layer
Local friction law with its memory                      `interface.Interface`
Loading of a round contact under that law               `loading.AxisymmetricLoading`
======================================================  =======================================
"""
