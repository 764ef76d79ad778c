from .distortion import Optics as Optics, distortion_of_translation as distortion_of_translation
from .forces import SensorChain as SensorChain
from .motion import (
    Backlash as Backlash,
    PeriodicError as PeriodicError,
    Straightness as Straightness,
    Velocity as Velocity,
    backlash as backlash,
    periodic_error as periodic_error,
    steady_velocity as steady_velocity,
    straightness as straightness,
)
