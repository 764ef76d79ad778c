"""From what the instruments read to what they measured: forces, and places in the picture."""

from typing import TYPE_CHECKING

from analysis.exports import exports

if TYPE_CHECKING:
    from analysis.calibration.distortion import (
        Optics as Optics,
        distortion_of_translation as distortion_of_translation,
    )
    from analysis.calibration.forces import SensorChain as SensorChain
else:
    __all__, __getattr__, __dir__ = exports(
        __name__,
        {
            "distortion": "Optics distortion_of_translation",
            "forces": "SensorChain",
        },
    )
