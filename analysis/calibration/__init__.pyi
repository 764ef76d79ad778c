from . import (
    compliance as compliance,
    dic_noise as dic_noise,
    stage_motion as stage_motion,
    timing as timing,
)
from .distortion import Optics as Optics, distortion_of_translation as distortion_of_translation
from .forces import SensorChain as SensorChain
