"""Shear stress from displacement: the inverse of u_x = D - G*sigma with the displacement D of the
block far away as an unknown.

===============  ====================================  ============================================
For              Method                                Function
===============  ====================================  ============================================
Every frame      Rings of a round contact, from ring   `axisymmetric.AxisymmetricInversion`
                 means
Fields, live     Conjugate gradients in a mask, warm   `conjugate.conjugate_gradient`
                 from the last frame
The paper        Van-Cittert (section 4)               `van_cittert.van_cittert`
Fields, offline  Round part and a smooth remainder,    `regularised.RegularisedInversion`
                 both cross-validated
===============  ====================================  ============================================
"""
