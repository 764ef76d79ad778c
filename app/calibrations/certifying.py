"""From the files of a calibration to its certificate."""

from __future__ import annotations

import hashlib
import io
import math
import zipfile
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from analysis.options import Section, as_written
from app.calibrations.calibration import Calibration, CalibrationResult, Data
from app.calibrations.given_files import is_session
from app.settings.certificates import (
    DATA,
    ENDING,
    PICTURE,
    STATEMENT,
    CalibrationCertificate,
    CertifiedValue,
    data_in,
    read_certificate,
)
from app.settings.config import tables
from app.settings.plain_values import section_from
from app.settings.trusted_settings import fingerprint
from app.system.errors import CalibrationRefused, ConfigError, UserError
from app.system.outputs import new_file
from app.system.time_of_day import now

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DIGITS = 8  # of a number in the settings
LARGEST_PICTURE = 7.0, 4.5  # inches


@dataclass(frozen=True)
class Evaluated:
    """A calibration whose data are evaluated, not yet written."""

    certificate: CalibrationCertificate
    result: CalibrationResult
    data: Data
    figure: Figure

    def write(self, path: Path, overwrite: bool) -> None:
        """Write the certificate, which appears only when it is complete; UserError."""
        import numpy as np

        arrays, picture = io.BytesIO(), io.BytesIO()
        np.savez_compressed(arrays, **self.data)
        self.figure.savefig(picture, dpi=150)
        statement = msgspec.json.format(msgspec.json.encode(self.certificate))
        with (
            new_file(path, overwrite) as unfinished,
            zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED) as archive,
        ):
            archive.writestr(STATEMENT, statement)
            archive.writestr(DATA, arrays.getvalue())
            archive.writestr(PICTURE, picture.getvalue())


def evaluated(
    calibration: Calibration[Any],
    sources: Sequence[Path],
    options: Section,
    given: Collection[str] = (),
) -> Evaluated:
    """What sessions or files say, or the data of an earlier certificate; there, options that are as
    by default, and not among those named in `given`, are those of the certificate.

    Raises
    ------
    UserError
        A file cannot be used.
    CalibrationRefused
        The data cannot be trusted.
    """
    from app.report.paper.style import new_figure, styled

    is_again = any(path.suffix == ENDING for path in sources)
    if len(sources) > 1 and (is_again or not calibration.takes_several):
        one = "certificate" if is_again else "file"
        raise UserError(f"calibrate {calibration.name}: {len(sources)} files found; give one {one}")
    about = _about(calibration, sources)
    if is_again:
        before = read_certificate(sources[0])
        own = _as_before(type(options)(), (), before)
        options = _as_before(options, given, before)
        for name in calibration.of_files:
            if getattr(options, name) != getattr(own, name):
                raise UserError(
                    f"{sources[0]}: its data were taken with another {name.replace('_', ' ')}; give"
                    " the files that they are of, or leave this option out"
                )
    try:
        data = data_in(sources[0]) if is_again else calibration.gather(sources, options)
        result = calibration.fit(data, options)
        certificate = _certificate(calibration, result, as_written(options), about)
    except UserError:
        raise
    except (KeyError, TypeError, IndexError) as error:
        if not is_again:
            raise
        why = f"{type(error).__name__}: {error}"
        raise UserError(
            f"{sources[0]}: its data are not those of such a calibration ({why})"
        ) from None
    except ValueError as error:
        raise CalibrationRefused(f"calibrate {calibration.name}: {error}") from error
    with styled():
        figure = new_figure(*LARGEST_PICTURE)
        calibration.draw(figure, data, result)
    return Evaluated(certificate, result, data, figure)


def _as_before(options: Section, given: Collection[str], before: CalibrationCertificate) -> Section:
    """The options, and where they are as by default and not `given`, those of an earlier
    certificate.
    """
    now, usual = as_written(options), as_written(type(options)())
    asked = now.keys() & before.options.keys() - {*given}
    kept = {name: before.options[name] for name in asked}
    kept = {name: value for name, value in kept.items() if now[name] == usual[name]}
    return section_from(type(options), now | kept, "the certificate's options: {}".format)


def _certificate(
    calibration: Calibration[Any],
    result: CalibrationResult,
    asked: dict[str, Any],
    about: dict[str, Any],
) -> CalibrationCertificate:
    """The certificate of a result; ValueError where a setting that follows cannot be one."""
    settings = {key: _plain(value) for key, value in result.settings.items()}
    for key, value in settings.items():
        table, _, name = key.partition(".")
        try:
            section_from(tables()[table], {name: value}, f"{table}.{{}}".format)
        except ConfigError as error:
            raise ValueError(f"what comes out cannot be a setting: {error}") from None
    for one in result.values:
        if not math.isfinite(one.value):
            raise ValueError(f"{one.name} could not be determined ({one.value}); check the data")
    return CalibrationCertificate(
        what=calibration.name,
        title=calibration.title,
        valid_days=calibration.valid_days,
        values=tuple(
            CertifiedValue(
                name=one.name,
                symbol=one.symbol,
                value=float(one.value),
                sd=float(one.total) if math.isfinite(one.total) else None,
                unit=one.unit,
                key=one.key,
            )
            for one in result.values
        ),
        settings=settings,
        remarks=tuple(result.remarks),
        options=asked,
        **about,
    )


def _plain(value: Any) -> Any:
    """A setting as JSON can hold it, its numbers with no more digits than people read."""
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    value = value.tolist() if hasattr(value, "tolist") else value
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _about(calibration: Calibration[Any], sources: Sequence[Path]) -> dict[str, Any]:
    """When the oldest of the data were made, of what bench the first session is, and the files with
    their SHA-256.
    """
    from app.session.versions import versions

    of_all: list[dict[str, Any]] = []
    read: dict[str, str] = {}
    for path in sources:
        if path.suffix == ENDING:
            before = read_certificate(path)
            if before.what != calibration.name:
                raise UserError(
                    f"{path}: it is a certificate of the calibration '{before.what}';"
                    f" give one of '{calibration.name}'"
                )
            read |= before.sources
            kept = ("made", "bench", "operator", "sample")
            of_all.append({name: getattr(before, name) for name in kept})
        elif is_session(path):
            of_all.append(_of_session(path))
        else:
            of_all.append({"made": _written(path)})
        read[str(path) if path.name in read else path.name] = _digest(path)
    made = min((one["made"] for one in of_all), key=datetime.fromisoformat, default=now())
    bench = next((one for one in of_all if "bench" in one), {})
    program = versions().get("slipscope", "")
    return {**bench, "made": made, "sources": read, "program": program}


def _written(path: Path) -> str:
    """When a file was written last: the data in it are no younger."""
    try:
        seconds = path.stat().st_mtime
    except OSError as error:
        raise UserError(f"{path}: it cannot be read: {error.strerror}; check the name") from None
    return datetime.fromtimestamp(seconds).astimezone().isoformat(timespec="seconds")


def _of_session(path: Path) -> dict[str, Any]:
    from app.calibrations.session_readings import opened

    with opened(path) as (reader, config):
        header = reader.header
    return {
        "made": header.started,
        "bench": dict(zip(("forces", "camera", "actuator"), config.sources, strict=True)),
        "operator": header.operator,
        "sample": header.sample,
    }


def _digest(path: Path) -> str:
    try:
        if path.is_dir():
            return fingerprint(path)
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise UserError(f"{path}: it cannot be read: {error.strerror}; check the name") from None
