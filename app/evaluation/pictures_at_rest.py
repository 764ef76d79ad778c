"""What the pictures of the free and of the pressed block show before anything moves: the contact,
and what stays in every picture.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from analysis.arrays import Array
from analysis.contact.apparent import ApparentContact, apparent_contact
from analysis.contact.marks import Marks
from analysis.dic import Tracker
from analysis.dic.fixed_pattern import Pull, fixed_pattern, pull_of
from app.evaluation.conclusions import attempt
from app.settings.sections import Config

OUTSIDE = 1.3  # distance in contact radii beyond which the block moves as the drive does
UNDO = "--set camera.fixed_pattern=undo"


def without(marks: Marks | None, image: Array) -> Array:
    """The image without the marks that stay in every picture, if there are any."""
    return image if marks is None else marks.taken_off(image)


def find_contact(
    config: Config,
    background: Array | None,
    image: Array,
    tracker: Tracker | None,
    notes: list[str],
) -> ApparentContact:
    """Centre and apparent radius from the difference to the background; without one the picture's
    middle, and a note that says so. The tracker, if any, is the background's and is closed.
    """
    if background is None:
        found = ApparentContact(
            notes=("contact: no background image was taken, so a is not measured",)
        )
    else:
        search = partial(
            apparent_contact,
            background,
            image,
            take_marks_off=config.camera.fixed_pattern != "ignore",
            tracker=tracker,
        )
        found = attempt(notes, "contact", search, ApparentContact())
    if found.marks is not None:
        is_undone = config.camera.fixed_pattern == "undo"
        off = "every image" if is_undone else "the images in which the contact is looked for"
        more = "" if is_undone else "; for the others replay with " + UNDO
        notes.append(f"picture: {found.marks}. They are taken off {off}{more}")
    if all(map(math.isfinite, found.centre_px)):
        return found
    notes.extend((*found.notes, "contact: rings are drawn about the picture's middle"))
    rows, columns = image.shape
    return replace(found, centre_px=((columns - 1) / 2, (rows - 1) / 2))


def find_pull(
    config: Config,
    background: Array | None,
    reference: Array,
    found: ApparentContact,
    notes: list[str],
) -> Pull | None:
    """How what stays in the picture while the block moves, as the background tells it, pulls
    displacements, where that is to be undone. Notes say what was found.
    """
    difference, asked = found.difference, config.camera.fixed_pattern
    is_asked = asked != "ignore" and config.dic.update == "never"
    if difference is None or background is None or not is_asked:
        return None
    rows, columns = (np.arange(n) for n in reference.shape)
    x, y = found.centre_px
    is_outside = np.hypot(columns - x, rows[:, None] - y) > OUTSIDE * found.radius_px
    usable = (difference != 0) & is_outside
    if found.marks is not None:
        usable.reshape(-1)[found.marks.where] = False
    background = without(found.marks, background)
    pattern = fixed_pattern(background, difference, usable, found.shift_px)
    if pattern is None or not pattern.is_certain:
        return None
    sentence = (
        f"picture: {100 * pattern.share:.2f} +- {100 * pattern.share_sd:.2g} % of its grey levels"
        " stay while the block moves (unequal pixels, dirt), which pulls displacements towards zero"
    )
    if asked == "tell":
        notes.append(f"{sentence} and makes L too small; replay with {UNDO}")
        return None
    pull = pull_of(pattern, config.correlation, without(found.marks, reference), difference)
    notes.append(
        f"{sentence} by up to {pull.largest_px:.3f} px; u_x(r) and what follows from it are"
        f" corrected, to {100 * pull.relative_sd:.0f} % of that, fields are not"
    )
    return pull
