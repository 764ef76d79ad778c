"""Contact mechanics: pressure, traction, surface displacement and loading curve of a sphere on a plane, in closed form.

===========  ==========================================================  =======================================
Paper        Quantity                                                    Function
===========  ==========================================================  =======================================
section 2    contact radius and pressure under a normal force P          `hertz.contact_radius`, `hertz.pressure`
section 5    stick radius c of a shear force Q                           `cattaneo_mindlin.stick_radius`
section 5    shear traction, surface displacement inside and outside     `cattaneo_mindlin.traction`, `.displacement`
Fig. 5       shear force Q against the distance driven                   `cattaneo_mindlin.driven_shear_force`
===========  ==========================================================  =======================================
"""
