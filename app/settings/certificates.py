"""Certificates of calibrations: what one says, and the settings that follow from it.

A certificate is one file, a ZIP archive: `certificate.json` says everything, `data.npz` holds the
data that were measured, `picture.png` shows them. Settings name certificates in
``calibration.certificates``.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Collection, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec

from app.settings.sections import Config
from app.settings.trusted_settings import check_local
from app.system.errors import ConfigError
from app.system.inputs import check_ends

ENDING = ".zip"
FORMAT = 1
STATEMENT, DATA, PICTURE = "certificate.json", "data.npz", "picture.png"
LONGEST_STATEMENT = 1 << 20  # bytes
LARGEST = 1 << 24  # bytes of a picture
MOST_DATA = 1 << 28  # bytes of the data, unpacked
KEY = "certificates"  # in the table [calibration]
LONGEST_DAYS = 36500
AHEAD_DAYS = 1.0  # by which the clock of the computer that made one may be ahead of this one's
CALIBRATED = (  # what a certificate may set, by its table or by ``table.key``
    "sample",
    "uncertainty",
    "camera.pixel",
    "camera.angle",
    "camera.distortion",
    *(
        f"forces.{of}_{sensor}"
        for of in ("sensitivity", "stiffness")
        for sensor in ("normal", "shear")
    ),
    *(f"forces.{name}" for name in ("stiffness_uncertainty", "sign", "zero", "coupling")),
)
UNREADABLE = (
    *(OSError, ValueError, KeyError, EOFError, OverflowError, RuntimeError, MemoryError),
    *(zipfile.BadZipFile, zlib.error),
)
RECORD = "calibration: "  # before the name of each among the versions in a session


class CertifiedValue(msgspec.Struct, frozen=True, kw_only=True):
    """A quantity that was calibrated: value and standard uncertainty in SI units, and the unit in
    which people read it.
    """

    name: str
    symbol: str
    value: float
    sd: float | None = None
    unit: str = ""
    key: str = ""


class CalibrationCertificate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a calibration found.

    Attributes
    ----------
    what, title : str
        Name of the calibration, and what it finds.
    made : str
        When the data were measured, ISO 8601 with the offset from UTC.
    valid_days : int
        For how long it holds.
    values : tuple of CertifiedValue
    settings : dict
        ``table.key`` -> value in the units of the settings file, of each setting that follows.
    remarks : tuple of str
        What a reader should know.
    bench, sources : dict of str
        Drivers of the devices, and the files that were evaluated with their SHA-256.
    options : dict
        Those of the calibration itself, in the units in which people write them.
    operator, sample, program : str
    """

    what: str
    title: str
    made: str
    valid_days: int
    values: tuple[CertifiedValue, ...]
    settings: dict[str, Any]
    remarks: tuple[str, ...] = ()
    bench: dict[str, str] = {}
    sources: dict[str, str] = {}
    options: dict[str, Any] = {}
    operator: str = ""
    sample: str = ""
    program: str = ""
    format: int = FORMAT

    def __post_init__(self) -> None:
        if self.format > FORMAT:
            raise ValueError("a later version of the program wrote it; use that version")
        has_zone = datetime.fromisoformat(self.made).tzinfo is not None
        if not (has_zone and 0 < self.valid_days <= LONGEST_DAYS and self.due):
            raise ValueError("it does not say when it was made or how long it is valid")
        for key, value in self.settings.items():
            # a limit, a device, a file or code has no place in a certificate
            is_calibrated = key in CALIBRATED or key.partition(".")[0] in CALIBRATED
            if not is_calibrated or not _is_numeric(value):
                raise ValueError(f"it sets {key[:100]} to {value!r:.100}, which none may set")

    @property
    def age_days(self) -> float:
        """Days since it was made."""
        made = datetime.fromisoformat(self.made)
        return (datetime.now(UTC) - made) / timedelta(days=1)

    @property
    def due(self) -> str:
        """Date of the next calibration, ISO 8601."""
        made = datetime.fromisoformat(self.made)
        return (made + timedelta(days=self.valid_days)).date().isoformat()

    @property
    def is_due(self) -> bool:
        """Whether it is older than it is valid, or nobody knows how old it is."""
        return self.is_from_future or self.age_days > self.valid_days

    @property
    def is_from_future(self) -> bool:
        """Whether it was made at a time that has not come yet, by one of both clocks."""
        return self.age_days <= -AHEAD_DAYS

    def age(self, days: str) -> str:
        """How old it is, in words: `days` is what stands behind the number."""
        return "from the future" if self.is_from_future else f"{self.age_days:.0f} {days}"


# as last read, with the time of its change and its size then
_READ: dict[Path, tuple[tuple[int, int], CalibrationCertificate]] = {}


def read_certificate(path: Path) -> CalibrationCertificate:
    """The certificate in a file, which is read again where it has changed.

    Raises
    ------
    ConfigError
        The file cannot be read or is no certificate.
    """
    try:
        held = path.stat()
        mark = held.st_mtime_ns, held.st_size
        if path not in _READ or _READ[path][0] != mark:
            _READ[path] = mark, _read(path)
        return _READ[path][1]
    except UNREADABLE as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise ConfigError(
            f"{path}: it cannot be read as a certificate of a calibration: {why}; give a file that"
            " `slipscope calibrate` wrote"
        ) from None


def picture_in(path: Path) -> bytes:
    """The picture of a certificate, a PNG; empty where it has none."""
    try:
        with zipfile.ZipFile(path) as archive:
            held = {one.filename: one.file_size for one in archive.infolist()}
            return archive.read(PICTURE) if held.get(PICTURE, LARGEST) < LARGEST else b""
    except UNREADABLE:
        return b""


def data_in(path: Path) -> dict[str, Any]:
    """Name -> each array of the data of a certificate; `ConfigError` where they cannot be read."""
    import numpy as np

    read_certificate(path)
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo(DATA).file_size > MOST_DATA:
                raise ConfigError(f"{path}: its data take more than {MOST_DATA >> 20} MiB")
            packed = io.BytesIO(archive.read(DATA))
        with zipfile.ZipFile(packed) as arrays:
            if sum(one.file_size for one in arrays.infolist()) > MOST_DATA:
                raise ConfigError(f"{path}: its data take more than {MOST_DATA >> 20} MiB")
        with np.load(packed, allow_pickle=False) as held:
            return {name: one if one.ndim else one.item() for name, one in held.items()}
    except UNREADABLE as error:
        raise ConfigError(f"{path}: the data of the certificate cannot be read: {error}") from None


def _read(path: Path) -> CalibrationCertificate:
    check_ends(path)
    with zipfile.ZipFile(path) as archive:
        if archive.getinfo(STATEMENT).file_size > LONGEST_STATEMENT:
            raise ValueError(f"{STATEMENT} has more than {LONGEST_STATEMENT} bytes")
        return msgspec.json.decode(archive.read(STATEMENT), type=CalibrationCertificate)


def located(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Nested plain dicts of settings, with the whole paths of their certificates, whose names are
    those of files in `folder`.
    """
    new = {table: dict(held) if isinstance(held, dict) else held for table, held in data.items()}
    if names := _names(new):
        new["calibration"][KEY] = [str(folder.absolute() / name) for name in names]
    return new


def _names(data: Mapping[str, Any]) -> list[str]:
    """Of the certificates; none where they are no list of texts, which is refused where tables are
    read.
    """
    table = data.get("calibration")
    named = table.get(KEY) if isinstance(table, dict) else None
    if isinstance(named, list | tuple) and all(isinstance(name, str) for name in named):
        return list(named)
    return []


def with_certificates(
    data: Mapping[str, Any],
    folder: Path,
    given: Collection[str] | None = None,
    *,
    is_remembered: bool = False,
) -> dict[str, Any]:
    """Nested plain dicts of settings with those that follow from their certificates.

    Parameters
    ----------
    folder : Path
        Where certificates lie whose names say no folder: that of the settings file.
    given : collection of str, optional
        ``table.key`` of the settings that no certificate may contradict, if not all.
    is_remembered : bool
        Whether a certificate that was read before is taken as it was, without a look at the disk.

    Raises
    ------
    ConfigError
        A certificate cannot be read, or says another value than the settings or another
        certificate.
    """
    new = located(data, folder)
    says: dict[str, str] = {}  # which certificate a setting is from
    for path in map(Path, _names(new)):
        if is_remembered and path in _READ:
            certificate = _READ[path][1]
        else:
            check_local(f"calibration.{KEY}", str(path))
            certificate = read_certificate(path)
        for key, value in certificate.settings.items():
            table, _, name = key.partition(".")
            section = new.setdefault(table, {})
            if not isinstance(section, dict):
                continue
            is_said = name in section if given is None else key in given or key in says
            if is_said and not _equal(section[name], value):
                raise ConfigError(
                    f"{key} is {section[name]} by {says.get(key, 'the settings')} and {value} by"
                    f" the certificate {path}; keep one: take {key} out of the settings, or the"
                    f" file out of calibration.{KEY}"
                )
            section[name], says[key] = value, path.name
    return new


def _is_numeric(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_numeric, value))
    return isinstance(value, int | float) and math.isfinite(value)


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(_equal, a, b))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return math.isclose(a, b)
    return bool(a == b)


def certificates_of(config: Config) -> dict[Path, CalibrationCertificate]:
    """File -> each certificate of a bench; `ConfigError` where one has gone."""
    return {Path(name): read_certificate(Path(name)) for name in config.calibration.certificates}


def calibration_records(config: Config) -> dict[str, str]:
    """What a session keeps of the certificates of its bench: name -> all that one says, as JSON.

    Raises
    ------
    ConfigError
        One says another value than the settings: the file is another one by now.
    """
    from app.settings.config import keyed  # which reads certificates itself

    now, records = keyed(config), {}
    for path, certificate in certificates_of(config).items():
        for key, value in certificate.settings.items():
            if not _equal(now[key], value):
                raise ConfigError(
                    f"{path}: the certificate has changed since the settings were read: {key} is"
                    f" {now[key]} in them and {value} in the file; read the settings again"
                )
        name = f"{RECORD}{path.name}"
        name = f"{RECORD}{path}" if name in records else name
        records[name] = msgspec.json.encode(certificate).decode()
    return records


def due_calibrations(config: Config) -> str:
    """Which calibrations are due again, one sentence; empty if none is."""
    due = [
        f"{path.name} (`slipscope calibrate {one.what}`) "
        + (
            f"was made on {one.made}, which has not come yet: check the clocks of this computer and"
            " of the one that made it"
            if one.is_from_future
            else f"was due on {one.due}"
        )
        for path, one in certificates_of(config).items()
        if one.is_due
    ]
    return f"calibrations: {'; '.join(due)}" if due else ""
