"""The apparent contact: registration, background difference, centre, radius, ring means."""

from typing import TYPE_CHECKING

from analysis.exports import exports

if TYPE_CHECKING:
    from analysis.contact.apparent import (
        ApparentContact as ApparentContact,
        apparent_contact as apparent_contact,
        background_difference as background_difference,
    )
    from analysis.contact.microcontacts import micro_contacts as micro_contacts
    from analysis.contact.orientation import (
        Direction as Direction,
        drive_direction as drive_direction,
    )
    from analysis.contact.registration import rigid_shift as rigid_shift
    from analysis.contact.rings import (
        Rings as Rings,
        central_value as central_value,
        ring_means as ring_means,
    )
else:
    __all__, __getattr__, __dir__ = exports(
        __name__,
        {
            "apparent": "ApparentContact apparent_contact background_difference",
            "microcontacts": "micro_contacts",
            "orientation": "Direction drive_direction",
            "registration": "rigid_shift",
            "rings": "Rings central_value ring_means",
        },
    )
