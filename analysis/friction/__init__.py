"""Friction: stick radius, onset of sliding, local law, and Young's modulus from a run.

====================  ==============================================  ==============================
Paper                 Quantity                                        Function
====================  ==============================================  ==============================
Section 3, Figs 7, 8  t_s, Q_s, mu_s, mu_d                            `onset.sliding_onset`
Section 4, Fig. 9     E at which the inverted stress balances Q       `modulus.balance_modulus`
Section 5             c of Cattaneo and Mindlin's profile through     `stick.fit_stick_radius`
                      u_x(r), on every frame
Section 5, Fig. 14    c where the inverted stress is largest          `stress_peak.stress_peak`
Section 6, Fig. 15    mu, L, h and E without a model of the pressure  `local_law.fit_local_law`
Section 2.3.1         p(r) measured, beside Hertz, and Greenwood and  `pressure.check_pressure`
                      Tripp; whether force and traction agree
Sections 3 to 6       E, L and mu(P) of several loads                 `joint.joint_law`
====================  ==============================================  ==============================
"""
