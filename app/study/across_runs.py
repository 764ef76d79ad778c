"""What the runs of several loads have in common, and what does not go together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from analysis.arrays import F64
from analysis.friction.joint import Common, common_value, joint_law, stiffness_length
from analysis.friction.local_law import LocalLaw
from analysis.mechanics.interface import elastic_length
from analysis.robust import robust_sd
from app.records.study_results import Joint, Origin
from app.records.summary import Summary
from app.settings.config import from_record

DISAGREE = 3.0  # standard uncertainties from which two values do not go together


class Reduced(NamedTuple):
    """A run as far as the others are concerned."""

    origin: Origin
    summary: Summary


def joint_of(runs: Sequence[Reduced]) -> Joint:
    """E, L and mu(P) of the runs, L also by the stiffness of the interface and, after Bureau, by
    the roughness of the settings.

    Inputs of the operator are taken to be the same in all runs: what one of them does to all alike
    no number of runs reduces.
    """
    if not runs:
        return Joint(notes=("joint fit: there is no run",))
    summaries = [run.summary for run in runs]
    law = joint_law(
        [_law(s) for s in summaries],
        [s.normal_force_n for s in summaries],
        inputs={
            "mu": _inputs(summaries, "law_mu"),
            "L": _inputs(summaries, "law_length"),
            "E": _inputs(summaries, "young_modulus"),
        },
    )
    lengths, sds = np.array([_stiffness_length(s) for s in summaries]).T
    by_stiffness = common_value(lengths, sds, _inputs(summaries, "law_length"))
    by_roughness = _roughness_length(runs[0].origin)
    found = Joint(
        young_modulus_pa=law.E.value,
        young_modulus_sd_pa=law.E.sd,
        length_m=law.L.value,
        length_sd_m=law.L.sd,
        mu=law.mu.value,
        mu_sd=law.mu.sd,
        decay=law.decay,
        decay_sd=law.decay_sd,
        stiffness_length_m=by_stiffness.value,
        stiffness_length_sd_m=by_stiffness.sd,
        roughness_length_m=by_roughness.value,
        roughness_length_sd_m=by_roughness.sd,
        notes=law.notes,
    )
    return replace(found, notes=(*law.notes, *_disagreements(runs, found)))


def _law(s: Summary) -> LocalLaw:
    return LocalLaw(
        mu=s.law_mu,
        mu_sd=s.law_mu_sd,
        L=s.law_length_m,
        L_sd=s.law_length_sd_m,
        E=s.young_modulus_pa,
        E_sd=s.young_modulus_sd_pa,
    )


def _inputs(summaries: Sequence[Summary], quantity: str) -> F64:
    """Relative change of a result of each run by each input, shape (runs, inputs)."""
    shares = [s.shares(quantity) for s in summaries]
    names = sorted({name for one in shares for name in one})
    table = np.array([[one.get(name, 0.0) for name in names] for one in shares])
    return table.reshape(len(shares), len(names))


def _stiffness_length(s: Summary) -> tuple[float, float]:
    return stiffness_length(
        s.pressure_pa, s.pressure_sd_pa, s.interface_stiffness_pa_m, s.interface_stiffness_sd_pa_m
    )


def _roughness_length(origin: Origin) -> Common:
    """L = (2 - nu)/(2 (1 - nu)) h of the settings of a run; NaN where h is 0."""
    config = from_record(origin.config_toml, f"{origin.session}: settings")
    sample, uncertainty = config.sample, config.uncertainty
    if not sample.roughness:
        return Common()
    value = elastic_length(sample.roughness, sample.poisson)
    softer = elastic_length(sample.roughness, max(0.0, sample.poisson - uncertainty.poisson))
    return Common(value, math.hypot(value * uncertainty.roughness, value - softer))


def _disagreements(runs: Sequence[Reduced], joint: Joint) -> Iterator[str]:
    for name, what in (("law_mu", "mu"), ("law_length_m", "L"), ("young_modulus_pa", "E")):
        without = [run.origin.session for run in runs if math.isnan(getattr(run.summary, name))]
        if without and name == "law_mu":
            yield f"no law was found in {', '.join(without)}: see its notes"
        if what != "mu":
            yield from _outliers(runs, name, what)
    L, L_sd = joint.length_m, joint.length_sd_m
    if math.isnan(joint.roughness_length_m):
        yield "there is no L by the roughness, as sample.roughness is 0"
    for other, sd, how in (
        (joint.stiffness_length_m, joint.stiffness_length_sd_m, "p/k, the stiffness of the rings,"),
        (joint.roughness_length_m, joint.roughness_length_sd_m, "the roughness of the settings"),
    ):
        if abs(L - other) > DISAGREE * math.hypot(L_sd, sd):
            yield (
                f"L of the law, {1e6 * L:.3f} ± {1e6 * L_sd:.3f} um, and L by {how}"
                f" {1e6 * other:.3f} ± {1e6 * sd:.3f} um, do not go together"
            )


def _outliers(runs: Sequence[Reduced], name: str, what: str) -> Iterator[str]:
    """The runs whose value lies off the median of all by more than their noise."""
    stem, _, unit = name.rpartition("_")
    value, sd = (
        np.array([getattr(run.summary, held) for run in runs])
        for held in (name, f"{stem}_sd_{unit}")
    )
    known = np.isfinite(value) & np.isfinite(sd)
    if known.sum() < 4:
        return
    middle = float(np.median(value[known]))
    spread = robust_sd(value[known] - middle)
    for run, x, own in zip(runs, value, sd, strict=True):
        if abs(x - middle) > DISAGREE * math.hypot(own, spread):
            yield (
                f"{run.origin.session}: {what} is {x / middle:.3f} times that of the other runs,"
                f" by noise {own / x:.1%} are expected; look at this run by itself"
            )
