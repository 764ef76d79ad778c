"""Friction: stick radius, onset of sliding, local law, and Young's modulus from a run.

====================  =============================================================================  ==================================
Paper                 Quantity
Function
====================  =============================================================================  ==================================
section 3, Figs 7, 8  t_s, Q_s, mu_s, mu_d
`onset.sliding_onset` section 4, Fig. 9     E at which the inverted stress balances Q
`modulus.balance_modulus` section 5             c of Cattaneo and Mindlin's profile through u_x(r),
on every frame             `stick.fit_stick_radius` section 5, Fig. 14    c where the inverted
stress is largest                                         `stress_peak.stress_peak` section 5, Fig.
14    either, corrected to c by one definition, with what noise does to it
`stress_peak.calibrate` section 6, Fig. 15    sigma/p against u_x at all radii: master curve, k =
p/L                        `master_curve.master_curve` section 6, Fig. 15    mu, L, h and E by
fitting the loading solution to u_x(r) and Q                 `local_law.fit_local_law`
====================  =============================================================================  ==================================
"""
