"""The paper as functions on plain arrays, in SI units.

Prevost, Scheibert and Debregeas, "Probing the micromechanics of a multi-contact interface at the
onset of frictional sliding" (2013).

================================  =================================================================
Section, figure or equation       Where it is computed
================================  =================================================================
2.1, forces from cantilevers      `analysis.calibration.forces.SensorChain`
2.3.1, rigid displacement         `analysis.contact.registration.rigid_shift`
2.3.1, Fig. 2b, difference        `analysis.contact.apparent.background_difference`
2.3.1, Fig. 2b, micro-contacts    `analysis.contact.microcontacts.micro_contacts`
2.3.1, Fig. 3, centre, I(r), a    `analysis.contact.apparent.apparent_contact`
2.3.1, Fig. 3b, a_H               `analysis.mechanics.hertz.contact_radius`
2.3.2, Fig. 4, displacement       `analysis.dic.open_tracker` with the method ``direct``
3, Fig. 5, Q(delta) of the model  `analysis.mechanics.cattaneo_mindlin.driven_shear_force`
3, Fig. 7, u_x(r)                 `analysis.contact.rings.ring_means`
3, Figs 7 and 8, t_s, mu_s, mu_d  `analysis.friction.onset.sliding_onset`
4, Eqs 2 and 3, Green's tensor    `analysis.mechanics.half_space.SurfaceGreen`
4, Figs 9 to 11, 13, sigma_xz     `analysis.inversion.van_cittert`, and better ones in
                                  `analysis.inversion`
4, E from the balance with Q      `analysis.friction.modulus.balance_modulus`
5, Fig. 12, u_x of the model      `analysis.mechanics.cattaneo_mindlin.radial_displacement`
5, Fig. 13, sigma of the model    `analysis.mechanics.cattaneo_mindlin.traction`
5, Fig. 14, c of the model        `analysis.mechanics.cattaneo_mindlin.stick_radius`
5, Fig. 14, c measured            `analysis.friction.stress_peak.stress_peak`,
                                  `analysis.friction.stick.fit_stick_radius`
6, Fig. 15, local friction law    `analysis.friction.local_law.fit_local_law`
6, mu p (1 - exp(-s/(mu L)))      `analysis.mechanics.interface.Interface`,
                                  `analysis.mechanics.loading.AxisymmetricLoading`
================================  =================================================================
"""
