"""Shear stress from displacement: the inverse of u_x = D - G*sigma with the displacement D of the
block far away as an unknown.

================  ========================================================  =============================================
For               Method                                                    Function
================  ========================================================  =============================================
every frame       rings of a round contact, from ring means
`axisymmetric.AxisymmetricInversion` fields, live      conjugate gradients in a mask, warm from the
last frame   `conjugate.conjugate_gradient` the paper         Van-Cittert (section 4)
`van_cittert.van_cittert` fields, offline   round part and a smooth remainder, both cross-validated
`regularised.RegularisedInversion` any of them       uncertainty by repetition
`uncertainty.bootstrap`
================  ========================================================  =============================================
"""
