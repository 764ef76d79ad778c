from . import (
    compliance as compliance,
    dic_noise as dic_noise,
    photon_transfer as photon_transfer,
    pixel_map as pixel_map,
    scale as scale,
    stage_motion as stage_motion,
    targets as targets,
    timing as timing,
)
from .adhesion import adhesion_test as adhesion_test
from .cross_talk import calibrate_loads as calibrate_loads, pressed_share as pressed_share
from .distortion import Optics as Optics, distortion_of_translation as distortion_of_translation
from .forces import SensorChain as SensorChain
from .radius_law import radius_law as radius_law
from .roughness import roughness as roughness
from .sensor_noise import sensor_noise as sensor_noise
from .sensor_response import sensor_response as sensor_response
