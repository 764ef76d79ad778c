"""One frame in, one snapshot out: the analysis that live runs and replays share, step by step and
without side effects elsewhere.
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.arrays import Array, Bool
from analysis.contact.apparent import ApparentContact
from analysis.contact.orientation import Direction, drive_direction
from analysis.contact.registration import background_tracker
from analysis.contact.rings import Rings, central_value, ring_means
from analysis.dic import Tracker, open_tracker
from analysis.dic.field import Field
from analysis.dic.fixed_pattern import Pull
from analysis.dic.rolling_shutter import RollingShutter
from analysis.dic.threads import together
from analysis.dic.updating import UpdatingTracker
from analysis.friction.stick import fit_stick_radius
from analysis.undistorted import ideal_displacement
from app.evaluation.ahead import Ahead
from app.evaluation.conclusions import Conclusion, attempt, conclude
from app.evaluation.frame_analysis import Following
from app.evaluation.history import DriveForces
from app.evaluation.pictures_at_rest import OUTSIDE, find_contact, find_pull, without
from app.evaluation.roundness import Roundness
from app.evaluation.setup import (
    full_slip_stress,
    grid_of,
    hertz_radius_m,
    is_behind,
    pixel_correction,
    places_m,
    shutter_from,
)
from app.evaluation.tractions import Tractions, mask_radius_m
from app.records.effort import Effort, Product
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import (
    Conditions,
    ContactResult,
    DisplacementField,
    FrameMotion,
    Phase,
    RingProfile,
    Snapshot,
    Stick,
    StressProfile,
    Traction,
)
from app.records.summary import Summary
from app.settings.sections import Config

EFFORT = Effort()
LOG = logging.getLogger(__name__)
REGION = 1.2  # correlated region in mask radii: D needs displacements beyond the mask
CENTRE_SHARE = 0.3  # u_x at the centre is extrapolated from this share of a
OUTER_RINGS = 4  # outside that radius, that an inversion needs to tell D
SPARE_RINGS = 2  # further ones that are measured, as the block moves out of their places
MOVED_PX = 0.1  # least motion whose direction is the block's, within a degree or so
TURNED = math.radians(5.0)  # least angle of the drive that is noted


class Pipeline:
    """Background, reference, displacement field, ring means, stick radius: the state of the
    analysis of one session.

    Frames must come in order. The result of a frame depends on the background and reference frames;
    those analysed in between only start its search, which can change a displacement by a small part
    of its uncertainty. With a rolling shutter (`camera.readout`) it depends on the frame before it,
    too. The same frames give the same bits.

    Everything but the displacement field, which is that of the image, is along the drive, wherever
    it goes in the picture. A frame's direction is that of the block's own motion in it, as soon as
    it has moved.

    Parameters
    ----------
    config : Config
    pattern : PixelPattern, optional
        Dark level and gain of each pixel, which are undone in every picture first.
    """

    def __init__(self, config: Config, pattern: PixelPattern | None = None) -> None:
        self.config = config
        self.pattern, self._even = pattern, pixel_correction(pattern)
        self.grid = grid_of(config)
        self._pixel_m = config.camera.pixel
        self._ring_m = config.dic.step * self._pixel_m  # width of a ring
        self._undoes = config.camera.fixed_pattern == "undo"  # what stays in the picture
        self.contact: ContactResult | None = None
        self.reference_frame: int | None = None
        self.notes: list[str] = []
        self.conclusion: Conclusion | None = None  # with the summary
        self._background: NDArray[np.generic] | None = None
        # opened once the block is pressed, which leaves the reference less to do
        self._background_tracker: Tracker | None = None
        self._tracker: Tracker | None = None
        self._fields: Ahead[Field] = Ahead()
        self._reference: tuple[int, int, NDArray[np.generic], Conditions, Effort] | None = None
        self._has_forces = False  # of any image so far; an import may have none
        self._tractions: Tractions | None = None
        self._roundness = Roundness(config)
        self._found = ApparentContact()
        self._pull: Pull | None = None
        self._shutter: RollingShutter | None = None  # of a camera that exposes row after row
        self._nominal = Direction.at(config.camera.angle)
        if config.run.direction < 0:
            self._nominal = self._nominal.reversed
        self._direction = self._nominal  # of the last frame
        self._outside = np.ones(self.grid.shape, np.bool_)
        # within which displacements are measured if no more is asked; everywhere if None
        self._region: Bool | None = None
        self._region_m = math.inf
        self._x_px, self._y_px = np.meshgrid(self.grid.x_px, self.grid.y_px)
        self._x_m, self._y_m = places_m(config, self._x_px, self._y_px)

    @property
    def pictures(self) -> tuple[NDArray[np.generic] | None, NDArray[np.generic] | None]:
        """The images of the reference and of the free block, as far as there are any."""
        return self._reference[2] if self._reference else None, self._background

    @property
    def _centre_m(self) -> tuple[float, float]:
        """Centre of the contact on the interface."""
        assert self.contact is not None
        x, y = places_m(self.config, *self.contact.centre_px)
        return float(x), float(y)

    def close(self) -> None:
        """Let the tracker's threads go, and note what became of reference and tractions."""
        if self._reference is not None and not self._undoes:
            self._find_pattern(self._reference[2])  # it is only told, which has time until now
        if self._tractions is not None:
            self.notes.extend(self._tractions.notes())
        self.notes.extend(self._roundness.notes())
        self._fields.close()
        if abs(self._direction.angle) > TURNED and abs(self._nominal.angle) < TURNED:
            self.notes.append(
                f"camera: the drive goes at {math.degrees(self._direction.angle):.1f} degrees from"
                " the rows of the picture; displacements but those of the field are along the drive"
            )
        for tracker in filter(None, (self._tracker, self._background_tracker)):
            tracker.close()
        self.notes += self._tracker.remarks if self._tracker else ()
        if isinstance(self._tracker, UpdatingTracker) and self._tracker.updates:
            self.notes.append(
                f"dic: the reference was replaced {self._tracker.updates} times, which adds"
                f" {self._tracker.drift_px:.4f} px to the uncertainty of u_x"
            )

    def restart(self) -> None:
        """Go on as a new pipeline would that is given the background and the reference again. With
        a rolling shutter, the next field rests on the reference instead of the frame before it.
        """
        self._fields.drop()
        if self._tracker is not None:
            self._tracker.close()
        self._tracker = self._tractions = self.contact = self.reference_frame = None
        self._found, self._pull = ApparentContact(), None
        self._direction, self._roundness = self._nominal, Roundness(self.config)
        self.notes.clear()
        if self._reference is not None:
            self._step(*self._reference)

    def start_from(self, field: DisplacementField) -> None:
        """Begin the search of the next frame with the displacements of another one, once the
        reference is taken.
        """
        assert self._tracker is not None
        self._tracker.start_from(field.ux_px, field.uy_px)

    def summary(self, snapshots: list[Snapshot], forces: DriveForces | None = None) -> Summary:
        """What the experiment comes down to, from all its snapshots and the forces of its drive;
        once it is closed.
        """
        self.conclusion = conclude(
            self.config, snapshots, self.contact, self.notes, self._pull, forces
        )
        return self.conclusion.summary

    def step(
        self,
        index: int,
        sample: int,
        image: NDArray[np.generic],
        now: Conditions,
        effort: Effort = EFFORT,
        following: Following | None = None,
    ) -> Snapshot:
        """The snapshot of one frame, with what the effort says is to be computed, given what the
        bench measured during its exposure. The field of the frame that surely is next is begun.
        """
        if effort.products & Product.CONTACT or now.phase in (Phase.BACKGROUND, Phase.REFERENCE):
            image = self._even(image)
        return self._step(index, sample, image, now, effort, following)

    def _step(
        self,
        index: int,
        sample: int,
        image: NDArray[np.generic],
        now: Conditions,
        effort: Effort,
        following: Following | None = None,
    ) -> Snapshot:
        self._has_forces |= now.has_forces
        # all loads count from its own: a later image serves where those lie in a gap
        can_be_reference = now.has_forces or not self._has_forces
        if now.phase is Phase.BACKGROUND:
            self._background, self._background_tracker = image, None
        elif now.phase is Phase.REFERENCE and self.reference_frame is None and can_be_reference:
            self._take_reference(index, image, now, effort)
            self._shutter = shutter_from(self.config, self.grid, sample)
            self._reference = index, sample, image, now, effort
        elif self._reference is not None:
            if self.reference_frame is None:  # a restart has failed
                self._step(*self._reference)
        elif self._background is not None and self._background_tracker is None:
            opened = partial(background_tracker, self._background)
            self._background_tracker = attempt(self.notes, "contact", opened, None)
        measured = Snapshot(index, sample, now, effort=effort)
        if self._reference is None or not effort.products & Product.CONTACT:
            return measured
        if self._tracker is None:
            self._open_tracker(self._reference[2])
        field = self._fields.result(index, partial(self._track, sample, image, effort))
        if following is not None and following[3].products & Product.CONTACT:
            frame, sample, image, effort = following
            even = self._even
            self._fields.begin(frame, lambda: self._track(sample, even(image), effort))
        return self._measure(measured, field, self._reference[3])

    def _open_tracker(self, reference: NDArray[np.generic]) -> None:
        self._tracker = open_tracker(self.config.correlation, self._correlated(reference))
        at_rest = np.zeros(self.grid.shape)
        self._tracker.start_from(at_rest, at_rest)  # spares the search of a cold start

    def _take_reference(
        self, index: int, image: NDArray[np.generic], now: Conditions, effort: Effort
    ) -> None:
        if self.pattern is not None:
            self.notes.append(
                "picture: dark level and gain of the pixels are undone in every image"
            )
        works = [partial(self._find_contact, image)]
        if effort.products & Product.CONTACT:
            works.append(partial(self._open_tracker, image))
        # marks that are undone must be known before the reference is correlated
        together(works, 1 if self._undoes else min(2, self.config.dic.threads))
        assert self.contact is not None
        if self._undoes:
            self._find_pattern(image)
        x, y = self._centre_m
        held = (self.contact.apparent_radius_m, hertz_radius_m(self.config, now.normal_force_n))
        radius = next((a for a in held if math.isfinite(a)), 0.0)
        distance = np.hypot(self._x_m - x, self._y_m - y)
        self._outside = distance > OUTSIDE * radius
        if math.isfinite(hertz_m := held[1]):
            mask_m, ring_m = mask_radius_m(self.config, hertz_m), self._ring_m
            self._region_m = max(REGION * mask_m, mask_m + (OUTER_RINGS + SPARE_RINGS) * ring_m)
            self._region = distance < self._region_m
        if self.config.stress.method != "none":
            self._prepare_tractions(now)
        self.reference_frame = index

    def _find_contact(self, image: NDArray[np.generic]) -> None:
        tracker, self._background_tracker = self._background_tracker, None
        found = find_contact(self.config, self._background, image, tracker, self.notes)
        self.notes.extend(self._roundness.of_contact(found, self._pixel_m))
        self._found = found
        self.contact = ContactResult(
            found.centre_px,
            found.radius_px * self._pixel_m,
            found.radius_sd_px * self._pixel_m,
            found.shift_px,
            found.profile_radius_px,
            found.profile_grey,
        )

    def _correlated(self, image: NDArray[np.generic]) -> NDArray[np.generic]:
        """The image as it is correlated: without marks where what stays is undone."""
        return without(self._found.marks, image) if self._undoes else image

    def _find_pattern(self, reference: NDArray[np.generic]) -> None:
        search = partial(
            find_pull, self.config, self._background, reference, self._found, self.notes
        )
        self._pull = attempt(self.notes, "fixed pattern", search, None)

    def _prepare_tractions(self, now: Conditions) -> None:
        assert self.contact is not None
        centre_x, centre_y = self._centre_m
        try:
            hertz_m = hertz_radius_m(self.config, now.normal_force_n)
            self._tractions = Tractions(
                self.config, self._x_m - centre_x, self._y_m - centre_y, hertz_m
            )
        except Exception as error:  # the displacements can be measured all the same
            LOG.debug("no shear traction", exc_info=error)
            self.notes.append(f"no shear traction was computed: {error}")

    def _points(self, effort: Effort) -> Bool | None:
        """Where displacements are measured with that effort; None: everywhere."""
        is_whole = effort.products & Product.PICTURE or self.config.dic.update != "never"
        return None if is_whole else self._region

    def _track(self, sample: int, image: Array, effort: Effort) -> Field:
        """The displacement field of a frame, at one time."""
        assert self._tracker is not None
        passes = 0 if effort.products & Product.SETTLED else 1
        field = self._tracker.track(self._correlated(image), self._points(effort), passes)
        if self._shutter is None:
            return field
        time_s = sample / self.config.forces.sample_rate
        ux, uy = self._shutter.at_one_time(field.ux_px, field.uy_px, time_s)
        return replace(field, ux_px=ux.astype(np.float32), uy_px=uy.astype(np.float32))

    def _measure(self, snapshot: Snapshot, field: Field, start: Conditions) -> Snapshot:
        assert self.contact is not None
        now, pixel_m = snapshot.conditions, np.float64(self._pixel_m)
        products, points = snapshot.effort.products, self._points(snapshot.effort)
        here: Any = slice(None) if points is None else points
        drive = self._direction = self._drive_in(field, here, now, start)
        compliance = self.config.sample.lens_compliance
        # a stiff holder needs no force
        lens_m = compliance * (now.shear_force_n - start.shear_force_n) if compliance else 0.0
        ux_m, uy_m = (u[here] * pixel_m for u in self._ideal(field))
        centre_x, centre_y = self._centre_m
        # distances from the lens where the material is now, not where it was at t = 0
        x = self._x_m[here] + ux_m - centre_x - drive.x * lens_m
        y = self._y_m[here] + uy_m - centre_y - drive.y * lens_m
        r = np.hypot(x, y)
        sliding_ux = drive.along(ux_m, uy_m) - lens_m
        hertz_m = hertz_radius_m(self.config, now.normal_force_n)
        furthest_m = self._furthest_m(hertz_m)
        if points is not None:  # which have moved since they were chosen
            furthest_m = min(furthest_m, self._region_m - float(np.nanmax(np.hypot(ux_m, uy_m))))
        apparent_m = self.contact.apparent_radius_m
        inner_m = CENTRE_SHARE * (apparent_m if math.isfinite(apparent_m) else hertz_m)
        near = r < max(furthest_m, inner_m)
        azimuth = np.arctan2(drive.across(x[near], y[near]), drive.along(x[near], y[near]))
        r, near_ux = r[near], sliding_ux[near]
        rings = ring_means(r, near_ux, self._ring_m, furthest_m, theta=azimuth)
        stick, traction, stress, stress_field = None, None, None, None
        if now.phase is Phase.DRIVE and math.isfinite(hertz_m):
            notes = self.notes
            attempt(notes, "roundness", lambda: self._roundness.add(rings, hertz_m), None)
            stick = attempt(notes, "stick radius", lambda: self._stick(rings, hertz_m), None)
            if (of := self._tractions) is not None:
                none: tuple[Traction, StressProfile] | tuple[None, None] = (None, None)
                traction, stress = attempt(notes, "shear traction", lambda: of.of(rings), none)
                if products & Product.EVERY_POINT:
                    stress_field = attempt(
                        notes,
                        "field of the shear traction",
                        lambda: of.field(
                            self._on_grid(sliding_ux, here), field.ux_std_px * pixel_m, drive
                        ),
                        None,
                    )
        dic = self.config.dic
        centre_ux_m, centre_sd_m = central_value(
            *(r, azimuth, near_ux, inner_m),
            box=dic.averaging_box_px * self._pixel_m,
            shared=max(1.0, (dic.noise_box_px / dic.step) ** 2),
            centre_sd=self._roundness.centre_sd_m,
        )
        return replace(
            snapshot,
            motion=FrameMotion(lens_m, centre_ux_m, centre_sd_m, drive.angle),
            field=DisplacementField(
                field.ux_px,
                field.uy_px,
                field.ux_std_px,
                field.uy_std_px,
                field.zncc,
                field.status,
            ),
            rings=RingProfile(rings.radius, rings.mean, rings.standard_error),
            stick=stick,
            traction=traction,
            stress=stress,
            stress_field_pa=stress_field,
        )

    def _on_grid(self, values: Array, here: Any) -> Array:
        """Values of some points of the grid, NaN at the others."""
        out = np.full(self.grid.shape, np.nan)
        out[here] = values
        return out

    def _ideal(self, field: Field) -> tuple[Array, Array]:
        """Displacements in pixels, the pull of a fixed pattern and the lens's distortion undone."""
        camera = self.config.camera
        u: tuple[Array, Array] = (field.ux_px, field.uy_px)
        if self._pull is not None:
            u = self._pull.corrected(*u)
        if not camera.distortion:
            return u
        return ideal_displacement(self._x_px, self._y_px, *u, camera.distortion, camera.shape)

    def _drive_in(self, field: Field, here: Any, now: Conditions, start: Conditions) -> Direction:
        """Where the drive goes in the picture, by what the block has moved there since the start;
        the block has moved against it where the stage says so.
        """
        if now.phase is not Phase.DRIVE or self.config.camera.angle_from == "angle":
            return self._nominal
        u, v, outside = field.ux_px[here], field.uy_px[here], self._outside[here]
        found = drive_direction(u, v, outside, least=MOVED_PX)
        if found is not None and is_behind(self.config, now, start):
            return found.reversed
        return found or self._nominal

    def _stick(self, rings: Rings, hertz_m: float) -> Stick | None:
        """The profile that fits the rings of a frame; None where none stands out of the noise."""
        box = self.config.dic.averaging_box_px * self._pixel_m
        width = self._ring_m
        fit = fit_stick_radius(
            rings.radius, rings.mean, rings.standard_error, hertz_m, box=box, width=width
        )
        if math.isnan(fit.stick_radius):
            return None
        full_slip_pa = full_slip_stress(self.config, fit.amplitude)
        return Stick(fit.stick_radius, fit.stick_radius_sd, full_slip_pa, fit.reduced_chi2)

    def _furthest_m(self, hertz_m: float) -> float:
        """Radius of the largest ring about the contact's centre that lies inside the grid, or of
        the few that a traction needs outside the contact if that is more: their harmonics are
        fitted, so that a small gap does no harm.
        """
        assert self.contact is not None
        cx, cy = self.contact.centre_px
        x, y = self.grid.x_px, self.grid.y_px
        whole = max(0.0, float(min(cx - x[0], x[-1] - cx, cy - y[0], y[-1] - cy))) * self._pixel_m
        if not (math.isfinite(hertz_m) and whole > hertz_m):
            return whole
        return max(whole, mask_radius_m(self.config, hertz_m) + OUTER_RINGS * self._ring_m)
