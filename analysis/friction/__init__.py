"""Friction: stick radius, onset of sliding, local law, cycles, ageing, and Young's modulus from a
run.
"""

from typing import TYPE_CHECKING

from analysis.exports import exports

if TYPE_CHECKING:
    from analysis.friction.ageing import fit_ageing as fit_ageing, slide_friction as slide_friction
    from analysis.friction.cycles import (
        branches as branches,
        interface_stiffness as interface_stiffness,
        local_work as local_work,
        loop_work as loop_work,
        masing_deviation as masing_deviation,
        precursor_slip as precursor_slip,
    )
    from analysis.friction.joint import joint_law as joint_law
    from analysis.friction.largest_stress import stress_peak as stress_peak
    from analysis.friction.law_of_fields import friction_law as friction_law
    from analysis.friction.local_law import (
        LocalLaw as LocalLaw,
        fit_local_law as fit_local_law,
        law_of as law_of,
    )
    from analysis.friction.modulus import balance_modulus as balance_modulus
    from analysis.friction.onset import Onset as Onset, sliding_onset as sliding_onset
    from analysis.friction.pressure import check_pressure as check_pressure
    from analysis.friction.stick import StickFit as StickFit, fit_stick_radius as fit_stick_radius
else:
    __all__, __getattr__, __dir__ = exports(
        __name__,
        {
            "ageing": "fit_ageing slide_friction",
            "cycles": "branches interface_stiffness local_work loop_work"
            " masing_deviation precursor_slip",
            "joint": "joint_law",
            "largest_stress": "stress_peak",
            "law_of_fields": "friction_law",
            "local_law": "LocalLaw fit_local_law law_of",
            "modulus": "balance_modulus",
            "onset": "Onset sliding_onset",
            "pressure": "check_pressure",
            "stick": "StickFit fit_stick_radius",
        },
    )
