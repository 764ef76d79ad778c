"""The fit of known loads and displacements to the readings of the force sensors, as a calibration
states it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from analysis.arrays import F64
from analysis.calibration.cross_talk import LoadCalibration, calibrate_loads
from analysis.calibration.sensor_response import SensorResponse, sensor_response
from app.calibrations.calibration import CalibrationResult, Data
from app.records.quantities import Measurement
from app.settings.hung_weights import AXES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SYMBOLS = ("k_N", "K_T"), ("P", "Q")


class LoadUncertainties(Protocol):
    """What is known beside the readings."""

    @property
    def load_uncertainty(self) -> float: ...
    @property
    def displacement_uncertainty(self) -> float: ...
    @property
    def sensitivity_normal(self) -> float: ...
    @property
    def sensitivity_shear(self) -> float: ...


def by_loads(data: Data, load_sd: float = 0.0) -> LoadCalibration:
    """The fit of the weights; ValueError as `calibrate_loads`."""
    on = np.isfinite(data["load"])
    volts = np.column_stack([data["normal_v"], data["shear_v"]])[on]
    end, sign = data.get("range", (math.inf, math.inf)), data.get("sign", (0, 0))
    return calibrate_loads(
        data["load"][on], data["axis"][on].astype(int), volts, data["time"][on],
        load_sd=load_sd, end_of_range=(float(end[0]), float(end[1])),
        sign=(int(sign[0]), int(sign[1])),
    )  # fmt: skip


def by_displacements(data: Data, i: int) -> SensorResponse | None:
    """The response of sensor i to displacements on its axis; None without any."""
    on = np.isfinite(data["displacement"]) & (data["axis"] == i)
    if not on.any():
        return None
    end = float(data["range"][i]) if "range" in data else math.inf
    volts = data[f"{AXES[i]}_v"][on]
    return sensor_response(data["displacement"][on], volts, data["time"][on], end_of_range=end)


def force_result(data: Data, known: LoadUncertainties) -> CalibrationResult:
    """Stiffness, sensitivity and cross-talk, with the settings that follow.

    Raises
    ------
    ValueError
        The readings cannot be trusted, or do not tell the stiffness.
    """
    found = by_loads(data, known.load_uncertainty)
    values: list[Measurement] = []
    settings: dict[str, Any] = {}
    remarks: list[str] = []
    stiffness_sds = [math.nan, math.nan]
    for i, axis in enumerate(AXES):
        response = found.responses[i][i]
        if response is None:
            remarks.append(f"{axis} sensor: not loaded; its settings are as they were")
            continue
        per_volt, per_volt_sd = found.newtons_per_volt[i], found.newtons_per_volt_sd[i]
        values.append(
            Measurement(
                f"force per volt, {axis} sensor", SYMBOLS[1][i] + "/U", float(abs(per_volt)),
                float(per_volt_sd), "N/V", key=f"{axis}_newtons_per_volt",
            )
        )  # fmt: skip
        sensitivity, sd = _sensitivity(data, known, i)
        k = abs(per_volt) / sensitivity
        of_force = per_volt_sd / abs(per_volt)
        stiffness_sds[i] = k * math.hypot(of_force, sd)
        values.append(
            Measurement(
                f"stiffness, {axis} cantilever", SYMBOLS[0][i], float(k), stiffness_sds[i], "N/m",
                key=f"stiffness_{axis}_n_per_m",
            )
        )  # fmt: skip
        settings[f"forces.stiffness_{axis}"] = float(k)
        settings[f"forces.sensitivity_{axis}"] = sensitivity * 1e6
        if sd:
            values.append(
                Measurement(
                    f"displacement per volt, {axis} sensor", "", sensitivity, sensitivity * sd,
                    "um/V", key=f"sensitivity_{axis}_m_per_v",
                )
            )  # fmt: skip
        else:
            remarks.append(
                f"{axis} sensor: weights give newtons per volt only; the stiffness goes with the"
                f" sensitivity of {sensitivity * 1e6:g} um/V, and its uncertainty is that of the"
                " product"
            )
        greatest = float(np.abs(data[f"{axis}_v"][data["axis"] == i]).max())
        of_range = f" of {data['range'][i]:g}" if "range" in data else ""
        remarks.append(
            f"{axis} sensor: read up to {greatest:.3g}{of_range} V;"
            f" {_fit_quality(response, abs(float(per_volt)))}"
        )
    of_both, remark = _of_both_sensors(data, found.newtons_per_volt, stiffness_sds)
    settings |= of_both
    remarks += [remark] if remark else []
    for i, j in ((0, 1), (1, 0)):
        if math.isfinite(found.coupling[i, j]):
            values.append(
                Measurement(
                    f"{SYMBOLS[1][j]} in the reading of {SYMBOLS[1][i]}", "",
                    float(found.coupling[i, j]), float(found.coupling_sd[i, j]), "%",
                    is_signed=True, key=f"{AXES[i]}_from_{AXES[j]}",
                )
            )  # fmt: skip
    if np.isfinite(found.coupling).all():
        settings["forces.coupling"] = found.coupling.tolist()
        settings["uncertainty.coupling"] = 100 * float(found.coupling_sd.max())
    return CalibrationResult(tuple(values), settings, tuple(remarks))


def _of_both_sensors(
    data: Data, newtons_per_volt: F64, stiffness_sds: list[float]
) -> tuple[dict[str, Any], str]:
    """The settings that hold a number of each sensor, and of a sensor that was not loaded what the
    session says; where no session does, what is not set.
    """
    signs, sds = np.sign(newtons_per_volt), np.array(stiffness_sds)
    lacks = ~np.isfinite(sds)
    if lacks.any() and "stiffness" in data:
        signs = np.where(lacks, data["sign"], signs)
        known = np.hypot(
            data["stiffness_sd"], np.multiply(data["stiffness"], data["sensitivity_sd"])
        )
        sds = np.where(lacks, known, sds)
    elif lacks.any():
        (loaded,) = np.flatnonzero(~lacks)
        axis, other = AXES[loaded], AXES[1 - loaded]
        if signs[loaded] < 0:
            raise ValueError(
                f"{axis} sensor: its voltage falls as the force grows, and forces.sign is not"
                f" written without that of the {other} sensor; load that one too, or give a session"
                " whose settings have forces.sign"
            )
        return {}, (
            "forces.sign, forces.stiffness_uncertainty and uncertainty.sensitivity are as they"
            f" were, as nothing is known of the {other} sensor; the uncertainty of the {axis}"
            f" cantilever's stiffness is {sds[loaded]:.3g} N/m, that of its sensor's sensitivity"
            " included"
        )
    # that of the sensitivity is in that of the stiffness, by which the volts were made newtons
    return {
        "forces.stiffness_uncertainty": sds.tolist(),
        "forces.sign": signs.astype(int).tolist(),
        "uncertainty.sensitivity": 0.0,
    }, ""


def _sensitivity(data: Data, known: LoadUncertainties, i: int) -> tuple[float, float]:
    """Metres per volt of a sensor, and its relative uncertainty; 0 where it is given."""
    measured = by_displacements(data, i)
    if measured is not None:
        sd = math.hypot(measured.relative_sd, known.displacement_uncertainty)
        return 1 / abs(measured.slope), sd
    given = (known.sensitivity_normal, known.sensitivity_shear)[i]
    given = given or (float(data["sensitivity"][i]) if "sensitivity" in data else 0.0)
    if not given:
        raise ValueError(
            f"{AXES[i]} sensor: weights give newtons per volt, not the stiffness; give"
            f" --sensitivity-{AXES[i]}, or displacements in the table"
        )
    return given, 0.0


def _fit_quality(response: SensorResponse, newtons_per_volt: float) -> str:
    """How well the readings of a sensor follow its weights."""

    def share(value: float, sd: float) -> str:
        return f"{100 * value / response.span:.3f} +- {abs(100 * sd / response.span):.2g} %"

    lost = int(np.count_nonzero(~response.is_used))
    parts = [
        f"bend {share(response.bend, response.bend_sd)} of the span",
        f"hysteresis {share(response.hysteresis, response.hysteresis_sd)}"
        if math.isfinite(response.hysteresis)
        else "hysteresis not measured, the weights only grew",
        f"zero drifted by {1e3 * newtons_per_volt * response.drift:.3f} +-"
        f" {1e3 * newtons_per_volt * response.drift_sd:.2g} mN, which is removed",
        f"readings scatter by {1e3 * newtons_per_volt * response.noise:.2g} mN",
    ]
    return "; ".join(parts) + (f"; {lost} of {len(response.is_used)} left out" if lost else "")


def draw_responses(figure: Figure, data: Data) -> None:
    """Readings over weights, and what is left of the fit in mN, of either sensor."""
    found = by_loads(data)
    axes = figure.subplots(2, 2, height_ratios=(2, 1), squeeze=False)
    for i, axis in enumerate(AXES):
        above, below = axes[0, i], axes[1, i]
        above.set_title(f"{axis} sensor")
        above.set_ylabel("reading (V)")
        below.set_xlabel("weight (N)")
        below.set_ylabel("residual (mN)")
        response = found.responses[i][i]
        if response is None:
            continue
        on = np.isfinite(data["load"]) & (data["axis"] == i)
        load, volts = data["load"][on], data[f"{axis}_v"][on]
        grows = np.diff(load, prepend=load[0]) >= 0
        ends = np.array([load.min(), load.max()])
        above.plot(ends, response.zero + response.slope * ends, lw=1, color="0.5")
        millinewtons = 1e3 * response.residual * found.newtons_per_volt[i]
        for which, marker, label in ((grows, "^", "loading"), (~grows, "v", "unloading")):
            above.plot(load[which], volts[which], marker, ms=4, label=label)
            below.plot(load[which], millinewtons[which], marker, ms=4)
        lost = ~response.is_used
        below.plot(load[lost], millinewtons[lost], "x", color="r")
        below.axhline(0, lw=0.5, color="0.5")
    axes[0, 0].legend()
