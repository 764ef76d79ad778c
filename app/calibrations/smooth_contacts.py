"""Radius and force of smooth contacts: from the pictures of a run, or from a table."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from analysis import smooth_contact
from analysis.arrays import F64
from analysis.contact.smooth import SmoothContact
from analysis.undistorted import ideal_places
from app.calibrations.calibration import Data
from app.calibrations.given_files import is_session, table_of
from app.calibrations.session_readings import opened, relative_sd_of_forces
from app.files.text_tables import FORCE, LENGTH, TEXT
from app.session.reader import SessionReader
from app.settings.config import load
from app.settings.sections import Config
from app.system.errors import UserError

TABLE = {
    "a": ("a", LENGTH, "a_um"), "P": ("p", FORCE, "P_N"), "a_sd": ("a_sd", LENGTH, "a_sd_um"),
    "P_sd": ("p_sd", FORCE, "P_sd_N"), "branch": ("branch", TEXT, ""),
}  # fmt: skip
MOST_PICTURES = 300
AROUND_S = 0.05  # of the forces about a picture whose mean is its force
LEAST_FORCE_SD = 1e-4  # newtons
REST = 0.01  # share of the range of the forces within which they are one
LEAST_RADIUS_SD = 5e-4  # relative: where the edge comes to rest is no better defined
ALIKE = 0.02  # relative change of the force about a picture: it moves, and is not used
# times the distortion at the edge of the largest contact, in the middle of the picture: the share
# of all radii that changes E by as much, beside w, which is fitted too and has nothing of it
BEND = 1.5
BRANCHES = ("loading", "unloading")


def contacts_of(path: Path) -> Data:
    """Radii `a`, forces `P`, their uncertainties, whether the load fell before, and the constants
    of the bench: R, nu, pixel, zero_sd, and the relative uncertainties (`shares`) of R, of the
    picture and of the force.

    Raises
    ------
    UserError
        The file cannot be used.
    """
    if not is_session(path):
        return {**_of_table(path), **_constants(load(None, ()))}
    with opened(path) as (reader, config):
        found, camera = _of_session(reader, config), config.camera
        corner = math.hypot(*camera.shape) / 2 * camera.pixel
        bend = BEND * config.uncertainty.distortion * (found["a"].max() / corner) ** 2
        return {**found, **_constants(config, bend)}


def _constants(config: Config, bend: float = 0.0) -> Data:
    """See `contacts_of`; the distortion of the lens adds `bend` to the share of the picture."""
    sample, u = config.sample, config.uncertainty
    newtons, _ = relative_sd_of_forces(config)
    shares = u.lens_radius, math.hypot(u.pixel, bend), newtons
    return {
        "R": sample.lens_radius, "nu": sample.poisson, "pixel": config.camera.pixel,
        "nu_sd": u.poisson, "zero_sd": u.zero, "shares": shares,
    }  # fmt: skip


def _of_table(path: Path) -> Data:
    found = table_of(path, TABLE, "radii and forces of a JKR test, and branch if you like")
    falls = np.arange(len(found["P"])) > np.nanargmax(np.append(found["P"], -np.inf))
    if "branch" in found:
        words = [word.strip().lower() for word in found.pop("branch")]
        if odd := sorted({*words} - {*BRANCHES}):
            raise UserError(f"{path}: '{odd[0][:40]}' is no branch; write loading or unloading")
        falls = np.array([word == "unloading" for word in words])
    return found | {"unloading": falls}


def _rests(rows: F64) -> F64:
    """One row for the pictures that follow one another at one force: the edge of a contact that
    rests is in one place in all of them.
    """
    apart = REST * max(float(np.ptp(rows[:, 1])), 1e-12)
    rests: list[list[F64]] = []
    for row in rows:
        if rests and abs(row[1] - rests[-1][0][1]) < apart + 4 * row[3]:
            rests[-1].append(row)
        else:
            rests.append([row])
    means = []
    for rest in rests:
        mean, count = np.mean(rest, axis=0), math.sqrt(len(rest))
        means.append([*mean[:2], max(mean[2] / count, LEAST_RADIUS_SD * mean[0]), mean[3]])
    return np.array(means)


def _ideal_radius(seen: SmoothContact, config: Config) -> float:
    """The mean radius in metres of the circle as a lens without distortion would show it."""
    (x, y), camera = seen.centre_px, config.camera
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    edge = x + seen.radius_px * np.cos(turn), y + seen.radius_px * np.sin(turn)
    x_px, y_px = ideal_places(*edge, camera.distortion, camera.shape)
    return float(np.hypot(x_px - x_px.mean(), y_px - y_px.mean()).mean()) * camera.pixel


def _of_session(reader: SessionReader, config: Config) -> Data:
    """The first picture is that of the free block; pictures without a disc are left out. The ratio
    of two pictures needs no map of the pixels: their gains cancel.
    """
    triggers = reader.triggers()
    triggers = triggers[triggers["received"]]
    forces, rate = reader.forces().forces[:, 0], config.forces.sample_rate
    width, exposure = max(1, round(AROUND_S * rate)), config.camera.exposure_samples(rate)
    every = max(1, len(triggers) // MOST_PICTURES)
    background = reader.frame(int(triggers["index"][0]))[2] if len(triggers) else None
    rows, reason = [], "there are no pictures"
    for trigger in triggers[1::every]:
        middle = int(trigger["sample"]) + exposure // 2
        about = forces[max(0, middle - width) : middle + width]
        about = about[np.isfinite(about)]
        if len(about) < 4:
            continue
        first, second = about[: len(about) // 2].mean(), about[len(about) // 2 :].mean()
        # by neighbours: a force that changes is no noise
        noise = float(np.diff(about).std()) / math.sqrt(2 * len(about))
        if abs(second - first) > ALIKE * abs(first) + 6 * noise:
            continue
        try:
            seen = smooth_contact(reader.frame(int(trigger["index"]))[2], background)
        except ValueError as error:
            reason = str(error)
            continue
        scale = config.camera.pixel
        sd = max(noise, LEAST_FORCE_SD)
        rows.append((_ideal_radius(seen, config), about.mean(), seen.radius_sd_px * scale, sd))
    if not rows:
        raise ValueError(f"no picture shows a contact of smooth faces; of the last: {reason}")
    a, P, a_sd, P_sd = _rests(np.array(rows)).T
    return {
        "a": a, "P": P, "a_sd": a_sd, "P_sd": P_sd, "unloading": np.arange(len(P)) > P.argmax(),
    }  # fmt: skip
