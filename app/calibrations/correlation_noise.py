"""`slipscope calibrate dic-noise`: the error of the correlation on a bench's own pictures against
the box (paper, Fig. 4), and the box that follows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, driven_run
from app.settings.sections import Config

if TYPE_CHECKING:
    from matplotlib.figure import Figure


BOXES = 10, 14, 20, 28, 40, 56, 80, 100
TRAVEL_PX = 15.0
FRAMES = 30
FEWEST = 24  # boxes in a picture
NOISE = "box", "sigma", "sigma_sd", "bias", "floor", "shift", "bend"
LEAST_PX = 0.1  # of motion: a picture before it is the reference
SHOWN_PX, SHOWN_BOX, SEARCH_PX = 80, 20, 16  # of Figs 4a to 4c


@dataclass(frozen=True, kw_only=True)
class CorrelationNoiseOptions(Section):
    """What the box is wanted for."""

    wanted: float = option(0.033, "Target error of the displacement", "px", gt=0, le=1)
    contact: float = option(
        0.0, "Diameter of the smallest contact; 0: Hertz's of run.normal_force", "mm", ge=0, le=100
    )


class CorrelationNoise(Calibration[CorrelationNoiseOptions]):
    """Sigma and bias of the displacement against the box."""

    name = "dic-noise"
    title = (
        "Error of the displacements against the box, and the recommended box, from a block that"
        " touches nothing and moves steadily."
    )
    files = "SESSION.h5"
    Options = CorrelationNoiseOptions

    def plan(self, config: Config, options: CorrelationNoiseOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`."""
        return (driven_run(config, TRAVEL_PX * config.camera.pixel),)

    def gather(self, sources: Sequence[Path], options: CorrelationNoiseOptions) -> Data:
        """See `Calibration.gather`: the errors, and of the pictures what Figs 4a to 4c show."""
        import numpy as np

        from analysis.calibration.dic_noise import correlation_map, noise_by_box
        from app.calibrations.free_block import flat_fielded_pictures
        from app.calibrations.session_readings import opened, times_of_frames, travel_of
        from app.evaluation.setup import hertz_radius_m

        with opened(sources[0]) as (reader, config):
            stage_s, position = travel_of(reader, config.camera.pixel)
            moving = np.abs(position - position[0]) > LEAST_PX * config.camera.pixel
            starts_s = float(stage_s[np.argmax(moving)])
            ends_s = float(stage_s[np.argmax(np.abs(position - position[0]))])
            times = times_of_frames(reader, 10**6, starts_s)
            chosen = [frame for frame, time in times.items() if time < ends_s]
            if not chosen:
                raise ValueError(
                    f"pictures: {reader.path} has none while its stage moves; give a session whose"
                    " camera took pictures then"
                )
            chosen = chosen[:: max(1, len(chosen) // FRAMES)]
            images = [*flat_fielded_pictures(reader, chosen)]
            time_s = np.array([times[frame] for frame in chosen])
        rows, columns = images[0].shape
        boxes = [box for box in BOXES if (rows // box - 1) * (columns // box - 1) >= FEWEST]
        found = noise_by_box(images, time_s, boxes, config.dic)
        corner = (columns - SHOWN_PX) // 2, (rows - SHOWN_PX) // 2
        place = [one + (SHOWN_PX - SHOWN_BOX) // 2 for one in corner]
        middle = images[len(images) // 2]
        shown = correlation_map(images[0], middle, place[0], place[1], SHOWN_BOX, SEARCH_PX)
        cut = tuple(slice(one, one + SHOWN_PX) for one in reversed(corner))
        radius = hertz_radius_m(config, config.run.normal_force)
        return {
            **{name: np.asarray(getattr(found, name)) for name in NOISE},
            "image": images[0][cut],
            "later": middle[cut],
            "correlation": shown.c,
            "tau": shown.tau_x,
            "peak": shown.peak,
            "hertz_diameter_px": 2 * radius / config.camera.pixel,
            "pixel_m": config.camera.pixel,
        }

    def fit(self, data: Data, options: CorrelationNoiseOptions) -> CalibrationResult:
        """See `Calibration.fit`."""
        from analysis.calibration.dic_noise import ErrorByBox, recommended_box

        noise, pixel = ErrorByBox(*(data[name] for name in NOISE)), data["pixel_m"]
        result = CalibrationResult(fit=noise)
        for box, *error in zip(noise.box, noise.sigma * pixel, noise.sigma_sd * pixel, strict=True):
            result.add(
                f"sigma_{box:.0f}_px_m", f"error in a box of {box:.0f} px", "sigma", "um", *error
            )
        result.remark(
            f"sigma falls from {noise.sigma[0]:.3g} px in boxes of {noise.box[0]:.0f} px to"
            f" {noise.sigma[-1]:.3g} px in {noise.box[-1]:.0f} px; the floor by noise and gradients"
            f" is {noise.floor[0]:.3g} and {noise.floor[-1]:.3g} px; the mean of a picture is"
            f" within {abs(noise.bias).max():.2g} px of a steady motion"
        )
        across = options.contact / pixel or data["hertz_diameter_px"]
        try:
            box = recommended_box(noise, options.wanted, across)
        except ValueError as error:
            result.remark(str(error))
        else:
            result.add("recommended_box_px", "recommended box, px", "", "", box)
            result.remark(
                f"the smallest box with an error below {options.wanted:g} px is {box} px, of which"
                f" {across / box:.0f} lie across a contact of {across:.0f} px"
            )
        return result

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """See `Calibration.draw`: Figs 4a to 4d."""
        from app.records.study_results import BoxSearch
        from app.report.paper.contact_figures import draw_search

        noise, axes = findings.fit, figure.subplots(2, 2)
        pictures, tau = (data["image"], data["later"]), data["tau"]
        found = (tau, tau, data["correlation"])
        edge = (SHOWN_PX - SHOWN_BOX) // 2
        shown = BoxSearch(0, SHOWN_BOX, edge, edge, 0, 0, *pictures, *found, *data["peak"])
        draw_search(axes.ravel()[:3], shown)
        errors = axes[1, 1]
        errors.errorbar(noise.box, noise.sigma, noise.sigma_sd, fmt="o", label="sigma")
        errors.plot(noise.box, noise.floor, "-", label="floor")
        errors.plot(noise.box, abs(noise.bias).max(axis=1), "x", label="largest bias")
        errors.set(xscale="log", yscale="log", xlabel="box (px)", ylabel="error (px)")
        errors.legend()
