"""What the pictures of a session show of a motion: of a block that touches nothing, or of marks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from app.settings.config import from_record

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from app.session.reader import SessionReader
    from app.settings.sections import Config

BOX_PX = 40  # of the boxes whose median is the motion
# of the displacements of one picture: by noise, and the share of its motion that a lens adds
SPREAD_PX, SPREAD = 0.1, 0.03


@dataclass(frozen=True)
class SeenMotion:
    """Times of the middle of each exposure (s, from the first sample), and the displacement since
    the first of these pictures, pixels; all of shape (frames,).
    """

    time_s: NDArray[Any]
    ux_px: NDArray[Any]
    uy_px: NDArray[Any]


def settings_of(reader: SessionReader) -> Config:
    """The settings that a session was recorded with."""
    return from_record(reader.header.config_toml, f"{reader.path}: settings")


def times_of_frames(reader: SessionReader, most: int, from_s: float = 0.0) -> dict[int, float]:
    """Number and middle of the exposure (s) of up to so many frames, evenly chosen."""
    rate = reader.header.sample_rate_hz
    late = settings_of(reader).camera.exposure_samples(rate) / 2
    triggers = reader.triggers()
    triggers = triggers[triggers["received"] & (triggers["sample"] >= from_s * rate)]
    every = max(1, -(-len(triggers) // most))
    return {int(t["index"]): (float(t["sample"]) + late) / rate for t in triggers[::every]}


def seen_motion(
    reader: SessionReader, times: dict[int, float], region: tuple[str, ...] = ()
) -> SeenMotion:
    """What the pictures of some frames, with their times, show of the motion since the first.

    Parameters
    ----------
    region : tuple of str
        Polygons as in `dic.region`: where it is looked at.

    Raises
    ------
    ValueError
        What is seen does not move as a whole.
    """
    import numpy as np

    from analysis.dic import open_tracker

    asked = settings_of(reader).dic
    box = asked.box if region else max(BOX_PX, asked.box)
    dic = replace(asked, box=box, step=max(box // 2, 1), update="never", region=region)
    dic = replace(dic, method="shared") if region and dic.method == "direct" else dic
    seen: list[tuple[float, float]] = []
    spread, tracker = 0.0, None
    for frame in times:
        image = reader.frame(frame)[2]
        tracker = tracker or open_tracker(dic, image)
        field = tracker.track(image)
        known = np.isfinite(field.ux_px)
        if not known.any():
            seen.append((np.nan, np.nan))
            continue
        ux, uy = (float(np.median(u[known])) for u in (field.ux_px, field.uy_px))
        seen.append((ux, uy))
        off = 1.4826 * float(np.median(np.abs(field.ux_px[known] - ux)))
        spread = max(spread, off - SPREAD * float(np.hypot(ux, uy)))
    if tracker is not None:
        tracker.close()
    if spread > SPREAD_PX:
        raise ValueError(
            f"motion: the displacements of one picture differ by {spread:.2g} px, up to"
            f" {SPREAD_PX:g} px are those of what moves as a whole; let the block touch nothing"
        )
    moved = np.reshape(seen, (-1, 2))
    return SeenMotion(np.array(list(times.values())), moved[:, 0], moved[:, 1])
