"""What the shear sensor reads of the normal force, from records in which a contact was pressed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.calibrations.given_files import same_in_all
from app.settings.protocol_steps import Approach, Background, Hold
from app.settings.sections import Config

SLOWNESS_S = 0.5  # of a simulated operator, who presses after the background
# share of P that a contact may show and count as pressed: a cross term that the settings lack
MOST_SHEAR = 0.2
NOT_TOLD = (
    "what the normal sensor reads of Q does not follow from records: a load that changes with the"
    " shear looks the same; it is as it was, and uncertainty.coupling is no lower than it was;"
    " weigh the sensors"
)
SAME_SHEAR = (
    "a true shear that is the same share of P each time, as of a block that comes down along a"
    " tilted way, cannot be distinguished from cross-talk; a calibration with weights can do so"
)


@dataclass(frozen=True, kw_only=True)
class PressingOptions(Section):
    """How the contact is pressed."""

    times: int = option(3, "Number of times the contact is made again and pressed", ge=3, le=20)
    rest: float = option(2.0, "Duration of the free block before, and of the rest after", "s", gt=0)


class CouplingCalibration(Calibration[PressingOptions]):
    """Cross-talk from records at hand."""

    name = "coupling"
    title = "Share of P in the reading of Q, from records of contacts that were pressed."
    valid_days = 365
    Options = PressingOptions

    def plan(self, config: Config, options: PressingOptions) -> tuple[Config, ...]:
        """Runs that press the contact and do nothing else."""
        steps = [Background(time=options.rest), Approach(), Hold(time=options.rest)]
        later = max(config.sim.press_time, options.rest + SLOWNESS_S)
        worlds = (
            replace(config.sim, press_time=later, seed=config.sim.seed + i)
            for i in range(options.times)
        )
        return tuple(
            calibration_run(config, steps, shear=MOST_SHEAR, sim=world) for world in worlds
        )

    def gather(self, sources: Sequence[Path], options: PressingOptions) -> Data:
        """Readings in newtons, without any cross-talk taken off, until the stage moves."""
        import numpy as np

        from app.calibrations.stretches import pressed_readings

        readings, configs = zip(*map(pressed_readings, sources), strict=True)
        named = zip(sources, readings, strict=True)
        for (one, first), (two, second) in combinations(named, 2):
            if np.array_equal(first, second):
                raise ValueError(
                    f"pressing: {two.name} has the readings of {one.name}; give each record once,"
                    " so that its noise counts once"
                )
        said = {
            path: (config.forces.sample_rate, config.forces.coupling)
            for path, config in zip(sources, configs, strict=True)
        }
        rate, coupling = same_in_all("forces.coupling or forces.sample_rate", said)
        return {
            "readings": np.concatenate(readings).astype(np.float32),
            "counts": np.array([len(read) for read in readings]),
            "rate": rate,
            "coupling": coupling,
            "coupling_sd": max(config.uncertainty.coupling for config in configs),
        }

    def fit(self, data: Data, options: PressingOptions) -> CalibrationResult:
        """The share that all pressings agree on."""
        import numpy as np

        from analysis.calibration.cross_talk import common_share
        from app.calibrations.stretches import shares_of, split

        shares, result = shares_of(data), CalibrationResult()
        value, sd = common_share(shares)
        name = "P in the reading of Q"
        result.add("shear_from_normal", name, "", "%", value, sd, is_signed=True)
        (a, b), (_, d) = data["coupling"]
        result.settings["forces.coupling"] = [[a, b], [a * value, d]]
        # one number for both cross terms, of which the other is as it was
        if abs(a) * sd > data["coupling_sd"]:
            result.settings["uncertainty.coupling"] = 100 * abs(a) * sd
        each = ", ".join(f"{100 * s.value:.3f} +- {100 * s.sd:.2g} %" for s in shares)
        result.remarks = f"each pressing by itself: {each}", SAME_SHEAR, NOT_TOLD
        read, left = [], []
        width = max(1, round(0.02 * data["rate"]))
        for number, part in enumerate(split(data), 1):
            p, q = part[: len(part) // width * width].reshape(-1, width, 2).mean(axis=1).T
            q = 1e3 * (q - q[p < p.min() + 0.1 * np.ptp(p)].mean())
            ends = np.array([p.min(), p.max()])
            read += [(p, q, ".", f"pressing {number}"), (ends, 1e3 * value * ends, "k")]
            left.append((p, q - 1e3 * value * p, "."))
        result.chart("reading of P (N)", "reading of Q (mN)", *read)
        result.chart("reading of P (N)", "residual (mN)", *left)
        return result
