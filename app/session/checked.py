"""A session, or another HDF5 file, from anywhere, opened to be read.

What lies where in it comes from `app.session.vetting`; each dataset is looked at before a byte of
it is taken, and whatever is wrong is a sentence.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any, Self

import numpy as np

from app.records.schema import TEXT, Column
from app.session.contents import COPY, Refused, said_by
from app.session.dataset_bytes import Dataset
from app.session.files import check_not_recorded
from app.session.journal import has_journal
from app.session.layout import FORMAT_ATTRIBUTE, FORMAT_VERSION, IMAGE
from app.session.results_layout import RECORDS_ATTRIBUTE, RESULTS_ATTRIBUTE, RESULTS_VERSION
from app.session.vetting import vetted
from app.system.errors import MissingFile, UserError, spelled_out

NUMBER = "number"  # any plain integer or float
# attribute with the format -> what a file is that has it, what was wanted if it has not, the
# command that writes it, and the newest format
_RESULTS = "results of `slipscope analyze`", "a file of results", "analyze"
KINDS = {
    FORMAT_ATTRIBUTE: ("a session", "a SlipScope session", "run", FORMAT_VERSION),
    RESULTS_ATTRIBUTE: (*_RESULTS, RESULTS_VERSION),
    RECORDS_ATTRIBUTE: (*_RESULTS, FORMAT_VERSION),
}
_DAMAGE = (OSError, KeyError, ValueError, TypeError, OverflowError, MemoryError)


class Closable:
    """What reads a file, in a ``with`` statement, or else until it is closed."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file; arrays stay. May be called twice."""
        raise NotImplementedError


class CheckedFile(Closable):
    """An HDF5 file open for reading.

    Parameters
    ----------
    what : str
        What it should be, for error sentences.

    Raises
    ------
    MissingFile
        There is no such file.
    UserError
        From here and from every method: not HDF5, cut short, damaged, or made to do harm.
    """

    def __init__(self, path: Path, what: str) -> None:
        self.path, self._what = path, what
        if not path.is_file():
            if path.is_dir():
                raise UserError(f"{path}: this is a folder, not a {what}; name a file in it")
            check_not_recorded(path)
            if has_journal(path):
                found = "it was cut short while it was recorded"
                raise UserError(f"{path}: {found}; {_remedy(path, 'check the name')}")
            raise MissingFile(f"{path}: there is no such {what} to read; check the name")
        try:
            self._contents = vetted(path)
            self._file = FileIO(path)
        except Refused as refused:
            found, otherwise = (part.replace("{}", what) for part in refused.args)
            raise UserError(f"{path}: {found}; {_remedy(path, otherwise)}") from None
        weakref.finalize(self, self._file.close)  # for a bench, which plays it to its very end
        self._bytes = path.stat().st_size
        self._datasets: dict[str, Dataset] = {}

    def close(self) -> None:
        """Let go of the file. May be called twice."""
        self._file.close()

    def format(self, attribute: str) -> int | None:
        """Which format it says it has in that attribute; None where it says nothing."""
        return self._contents.formats.get(attribute)

    def checked_format(self, attribute: str) -> int:
        """Which format it says it has in that attribute; UserError where it is no file of that
        kind, or newer than this program.
        """
        version, (_, wanted, command, newest) = self.format(attribute), KINDS[attribute]
        if version is None or version < 1:
            known = (found for one, (found, *_) in KINDS.items() if self.format(one) is not None)
            raise UserError(
                f"{self.path}: {next(known, 'an HDF5 file')}, but not {wanted}; give a file that"
                f" `slipscope {command}` wrote"
            )
        if version > newest:
            raise UserError(
                f"{self.path}: written by a newer SlipScope (format {version}, this one reads"
                f" {newest}); bring SlipScope up to date"
            )
        return version

    @property
    def groups(self) -> tuple[str, ...]:
        """Paths of the groups that are in the file."""
        return self._contents.groups

    def has(self, path: str) -> bool:
        """Whether a group or dataset is in the file."""
        held = self._contents.datasets.get(path)
        if held is not None and held.fault:
            raise self.damaged(path, held.fault)
        return held is not None or path in self._contents.groups

    def dataset(self, path: str, shape: Sequence[str | int], dtype: str) -> Dataset:
        """The dataset, once it is sure that it lies in this file, is of that kind and claims no
        more than the file holds.

        Parameters
        ----------
        shape : sequence of int or str
            Its sides; one that is named may have any length. One or none: it is read as a whole;
            more: by rows.
        dtype : str
            Of numpy, or `TEXT`, `IMAGE`, `NUMBER`.
        """
        if path in self._datasets:
            return self._datasets[path]
        with self.reading(path):
            held = self._contents.datasets.get(path)
            if held is None or held.fault:
                raise ValueError(held.fault if held else "it is missing")
            place = Dataset(self._file, self._bytes, path, held)
            if len(held.shape) != len(shape) or not _is_of(place, dtype):
                raise ValueError(f"it is {len(held.shape)}-dimensional {held.dtype}")
            if any(
                isinstance(side, int) and side != found
                for side, found in zip(shape, held.shape, strict=True)
            ):
                raise ValueError(f"its shape is {held.shape}")
            place.check_claim(place.shape if len(shape) < 2 else place.shape[1:])
        self._datasets[path] = place
        return place

    def read(self, dataset: Dataset) -> Any:
        """All that is in a dataset: an array, or a number or text where it has no shape; control
        characters of texts are spelled out.
        """
        with self.reading(dataset.name):
            if dataset.kind != TEXT:
                return dataset[()][()]
            texts = [
                spelled_out(text.decode("utf-8"))
                for text in self._contents.datasets[dataset.name].texts
            ]
            return np.array(texts, object).reshape(dataset.shape)[()]

    def values(self, column: Column, path: str, shape: Sequence[str | int]) -> Any:
        """All of a dataset of that shape, which holds what the column can."""
        values = self.read(self.dataset(path, shape, column.dtype))
        with self.reading(path):
            column.check(values)
        return values

    @contextmanager
    def reading(self, path: str) -> Iterator[None]:
        """Whatever is thrown while damaged bytes are read, as one sentence."""
        try:
            yield
        except UserError:
            raise
        except _DAMAGE as error:
            if self._file.closed:
                raise UserError(
                    f"{self.path}: the {self._what} was closed; open it again"
                ) from None
            raise self.damaged(path, said_by(error)) from error

    def damaged(self, path: str, found: str) -> UserError:
        """The error that says so."""
        return UserError(
            f"{self.path}: the {self._what} is damaged at {path}: {found};"
            f" {_remedy(self.path, COPY)}"
        )


def _is_of(dataset: Dataset, wanted: str) -> bool:
    if TEXT in (wanted, dataset.kind):
        return wanted == dataset.kind
    if wanted == IMAGE:
        return dataset.dtype in (np.dtype("u1"), np.dtype("<u2"))
    return wanted == NUMBER or bool(dataset.dtype == np.dtype(wanted))


def _remedy(path: Path, otherwise: str) -> str:
    """What to do with a file that cannot be read: its journal, where it has one, brings a session
    back.
    """
    return (
        f"`slipscope repair {path} -o REPAIRED.h5` brings back what its journal holds"
        if has_journal(path)
        else otherwise
    )
