from .apparent import (
    ApparentContact as ApparentContact,
    apparent_contact as apparent_contact,
    background_difference as background_difference,
)
from .microcontacts import micro_contacts as micro_contacts
from .orientation import Direction as Direction, drive_direction as drive_direction
from .registration import rigid_shift as rigid_shift
from .rings import Rings as Rings, central_value as central_value, ring_means as ring_means
from .smooth import smooth_contact as smooth_contact
