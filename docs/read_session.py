"""The load curve of a session, the stick radius at its end and the mean grey level of an image:
``python read_session.py SESSION.h5``.
"""

import sys

import numpy as np

from slipscope import Session

with Session(sys.argv[1]) as session:
    time_s, normal_n, shear_n = session.forces  # one row per sample, NaN where one is missing
    last = session.results[-1]  # of the last analysed frame; c is stick_radius_m
    print(f"{len(time_s)} samples, {len(session.frames)} triggers, lost: {session.lost_frames}")
    print(
        f"Q = {last['shear_force_n']:.3f} N: c = {last['stick_radius_m'] * 1e3:.2f} +-"
        f" {last['stick_radius_sd_m'] * 1e3:.2f} mm"
    )
    print(f"mean grey level of frame {last['frame']}: {session.frames[last['frame']].mean():.1f}")
    print(f"largest u_x: {np.nanmax(session.fields[-1].ux_m) * 1e6:.2f} um")
