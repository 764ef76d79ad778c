from .ageing import fit_ageing as fit_ageing, slide_friction as slide_friction
from .cycles import (
    branches as branches,
    interface_stiffness as interface_stiffness,
    local_work as local_work,
    loop_work as loop_work,
    masing_deviation as masing_deviation,
    precursor_slip as precursor_slip,
)
from .joint import joint_law as joint_law
from .largest_stress import stress_peak as stress_peak
from .law_of_fields import friction_law as friction_law
from .local_law import LocalLaw as LocalLaw, fit_local_law as fit_local_law, law_of as law_of
from .modulus import balance_modulus as balance_modulus
from .onset import Onset as Onset, sliding_onset as sliding_onset
from .pressure import check_pressure as check_pressure
from .stick import StickFit as StickFit, fit_stick_radius as fit_stick_radius
