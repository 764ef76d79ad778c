from .adhesion import adhesion_test as adhesion_test
from .distortion import Optics as Optics, distortion_of_translation as distortion_of_translation
from .forces import SensorChain as SensorChain
from .radius_law import radius_law as radius_law
from .roughness import roughness as roughness
