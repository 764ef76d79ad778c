"""The fit of known loads and displacements to the readings of the force sensors, as a calibration
states it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from analysis.arrays import F64
from analysis.calibration.cross_talk import calibrate_loads
from analysis.calibration.sensor_response import SensorResponse, sensor_response
from app.calibrations.calibration import CalibrationResult, Data
from app.calibrations.weights import WeightOptions
from app.settings.hung_weights import AXES

FORCES, STIFFNESSES = "PQ", ("k_N", "K_T")


def force_result(data: Data, known: WeightOptions) -> CalibrationResult:
    """Stiffness, sensitivity and cross-talk, with the settings that follow.

    Raises
    ------
    ValueError
        The readings cannot be trusted, or do not tell the stiffness.
    """
    on = np.isfinite(data["load"])
    volts = np.column_stack([data["normal_v"], data["shear_v"]])
    found = calibrate_loads(
        data["load"][on],
        data["axis"][on].astype(int),
        volts[on],
        data["time"][on],
        load_sd=known.load_uncertainty,
        end_of_range=data.get("range", (math.inf, math.inf)),
        sign=data.get("sign", (0, 0)),
    )
    result, stiffness_sds = CalibrationResult(columns=2), [math.nan, math.nan]
    curves: list[tuple[str, list[Any], list[Any]]] = [(f"{axis} sensor", [], []) for axis in AXES]
    for i, axis in enumerate(AXES):
        response = found.responses[i][i]
        if response is None:
            result.remark(f"{axis} sensor: not loaded; its settings are as they were")
            continue
        per_volt, per_volt_sd = abs(found.newtons_per_volt[i]), found.newtons_per_volt_sd[i]
        result.add(
            f"{axis}_newtons_per_volt",
            f"force per volt, {axis} sensor",
            f"{FORCES[i]}/U",
            "N/V",
            per_volt,
            per_volt_sd,
        )
        sensitivity, sd = _sensitivity(data, known, i)
        k = float(per_volt / sensitivity)
        stiffness_sds[i] = k * math.hypot(per_volt_sd / per_volt, sd)
        result.add(
            f"stiffness_{axis}_n_per_m",
            f"stiffness, {axis} cantilever",
            STIFFNESSES[i],
            "N/m",
            k,
            stiffness_sds[i],
        )
        result.settings[f"forces.stiffness_{axis}"] = k
        result.settings[f"forces.sensitivity_{axis}"] = sensitivity * 1e6
        if sd:
            result.add(
                f"sensitivity_{axis}_m_per_v",
                f"displacement per volt, {axis} sensor",
                "",
                "um/V",
                sensitivity,
                sensitivity * sd,
            )
        else:
            result.remark(
                f"{axis} sensor: weights give newtons per volt only; the stiffness goes with the"
                f" sensitivity of {sensitivity * 1e6:g} um/V, and its uncertainty is that of the"
                " product"
            )
        of = on & (data["axis"] == i)
        unit = 1e3 * found.newtons_per_volt[i]
        curves[i] = f"{axis} sensor", *_curves(response, data["load"][of], volts[of, i], unit)
        greatest = float(np.abs(data[f"{axis}_v"][data["axis"] == i]).max())
        of_range = f" of {data['range'][i]:g}" if "range" in data else ""
        result.remark(
            f"{axis} sensor: read up to {greatest:.3g}{of_range} V;"
            f" {_fit_quality(response, float(per_volt))}"
        )
    _of_both_sensors(result, data, found.newtons_per_volt, stiffness_sds)
    for i, j in ((0, 1), (1, 0)):
        if math.isfinite(share := found.coupling[i, j]):
            name = f"{FORCES[j]} in the reading of {FORCES[i]}", "", "%"
            sd = found.coupling_sd[i, j]
            result.add(f"{AXES[i]}_from_{AXES[j]}", *name, share, sd, is_signed=True)
    if np.isfinite(found.coupling).all():
        result.settings["forces.coupling"] = found.coupling.tolist()
        result.settings["uncertainty.coupling"] = 100 * float(found.coupling_sd.max())
    for title, read, _ in curves:
        result.chart("weight (N)", "reading (V)", *read, title=title)
    for *_, left in curves:
        result.chart("weight (N)", "residual (mN)", *left)
    return result


def _of_both_sensors(
    result: CalibrationResult, data: Data, newtons_per_volt: F64, stiffness_sds: list[float]
) -> None:
    """Add the settings that hold a number of each sensor, and of a sensor that was not loaded what
    the session says; where no session does, what is not set.
    """
    signs, sds = np.sign(newtons_per_volt), np.array(stiffness_sds)
    lacks = ~np.isfinite(sds)
    if lacks.any() and "stiffness" in data:
        signs = np.where(lacks, data["sign"], signs)
        by_sensitivity = np.multiply(data["stiffness"], data["sensitivity_sd"])
        sds = np.where(lacks, np.hypot(data["stiffness_sd"], by_sensitivity), sds)
    elif lacks.any():
        (loaded,) = np.flatnonzero(~lacks)
        axis, other = AXES[loaded], AXES[1 - loaded]
        if signs[loaded] < 0:
            raise ValueError(
                f"{axis} sensor: its voltage falls as the force grows, and forces.sign is not"
                f" written without that of the {other} sensor; load that one too, or give a session"
                " whose settings have forces.sign"
            )
        result.remark(
            "forces.sign, forces.stiffness_uncertainty and uncertainty.sensitivity are as they"
            f" were, as nothing is known of the {other} sensor; the uncertainty of the {axis}"
            f" cantilever's stiffness is {sds[loaded]:.3g} N/m, that of its sensor's sensitivity"
            " included"
        )
        return
    result.settings |= {
        "forces.stiffness_uncertainty": sds.tolist(),
        "forces.sign": signs.astype(int).tolist(),
        # it is in that of the stiffness, by which the volts were made newtons
        "uncertainty.sensitivity": 0.0,
    }


def _sensitivity(data: Data, known: WeightOptions, i: int) -> tuple[float, float]:
    """Metres per volt of a sensor, and its relative uncertainty; 0 where it is given."""
    axis = AXES[i]
    on = np.isfinite(data["displacement"]) & (data["axis"] == i)
    if on.any():
        found = sensor_response(
            data["displacement"][on],
            data[f"{axis}_v"][on],
            data["time"][on],
            end_of_range=data.get("range", (math.inf, math.inf))[i],
        )
        return 1 / abs(found.slope), math.hypot(found.relative_sd, known.displacement_uncertainty)
    given = (known.sensitivity_normal, known.sensitivity_shear)[i]
    if not (given := given or float(data.get("sensitivity", (0.0, 0.0))[i])):
        raise ValueError(
            f"{axis} sensor: weights give newtons per volt, not the stiffness; give"
            f" --sensitivity-{axis}, or displacements in the table"
        )
    return given, 0.0


def _fit_quality(response: SensorResponse, newtons_per_volt: float) -> str:
    """How well the readings of a sensor follow its weights."""
    percent, millinewtons = 100 / response.span, 1e3 * newtons_per_volt
    bend, bend_sd = response.bend * percent, abs(response.bend_sd * percent)
    lag, lag_sd = response.hysteresis * percent, abs(response.hysteresis_sd * percent)
    drift, drift_sd = response.drift * millinewtons, response.drift_sd * millinewtons
    lost = int(np.count_nonzero(~response.is_used))
    return "; ".join(
        [
            f"bend {bend:.3f} +- {bend_sd:.2g} % of the span",
            f"hysteresis {lag:.3f} +- {lag_sd:.2g} %"
            if math.isfinite(lag)
            else "hysteresis not measured, the weights only grew",
            f"zero drifted by {drift:.3f} +- {drift_sd:.2g} mN, which is removed",
            f"readings scatter by {response.noise * millinewtons:.2g} mN",
            *([f"{lost} of {len(response.is_used)} left out"] if lost else []),
        ]
    )


def _curves(
    response: SensorResponse, load: F64, volts: F64, unit: float
) -> tuple[list[Any], list[Any]]:
    """Readings over weights, and what is left of the fit times a unit."""
    off, ends = unit * response.residual, np.sort(load)[[0, -1]]
    grows, used = np.diff(load, prepend=load[0]) >= 0, response.is_used
    read: list[Any] = [(ends, response.zero + response.slope * ends, "0.5")]
    for which, how, name in ((grows, "^", "loading"), (~grows, "v", "unloading")):
        read.append((load[which], volts[which], how, name))
    left = [(load[used], off[used], "o"), (load[~used], off[~used], "rx")]
    return read, left
