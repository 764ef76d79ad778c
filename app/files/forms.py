"""How a table in a text file is written: encoding, separator, decimal sign, header; given, or found
in its first lines.
"""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from itertools import islice
from pathlib import Path

from analysis.options import number_in
from app.system.errors import UserError

LOOKED_AT = 200  # lines from which the form of a table is found
LONGEST_LINE = 1 << 16  # characters; a text without line breaks is no table
SEPARATORS = {";": "';'", "\t": "tabs", ",": "','", "|": "'|'", " ": "spaces"}
_NAMED = {"tab": "\t", "\\t": "\t", "space": " ", "comma": ",", "semicolon": ";"}
_GROUP = r"(?:[1-9]\d{{0,2}}(?:[ '\u2019{0}\u00a0\u202f]\d{{3}})+|\d*)"
_NUMBER = {
    decimal: re.compile(
        r"[+\-\u2212]?(?={1}?\d)".replace("{1}", re.escape(decimal))
        + _GROUP.format(other)
        + rf"(?:{re.escape(decimal)}\d*)?(?:[eEdD][+\-\u2212]?\d+)?",
        re.ASCII,
    )
    for decimal, other in ((".", ","), (",", "."))
}
_GROUPS = {sign: re.compile(f"[ '\u2019{sign}\u00a0\u202f]") for sign in ",."}
# minus signs of typography, exponents of Fortran
_AS_PYTHON = str.maketrans("\u2212dD", "-ee")
NO_CELLS = "", "comment"  # names of a last column, as LabVIEW's, of which no row has a cell
MONTHS = 12
_DAY_OF_1970 = date(1970, 1, 1).toordinal()
_UNIT = re.compile(
    r"(?P<name>.*?)(?:\s*[\[(]\s*(?P<a>[^\])]*?)\s*[\])]|\s*/\s*(?P<b>\S+)|\s+in\s+(?P<c>\S+)"
    r"|_(?P<d>[A-Za-zµμ]+))?\s*"
)
_TIME_OF_DAY = re.compile(
    r"(?:(?P<year>\d{4})(?P<sign>[-/.])(?P<month>\d\d?)(?P=sign)(?P<day>\d\d?)[ T_]+"
    r"|(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4})[ T_]+"
    r"|(?P<a>\d\d?)(?P<mark>[-/])(?P<b>\d\d?)(?P=mark)(?P<z>\d{4}),?[ T_]+)?"
    r"(?P<hours>\d\d?):(?P<minutes>\d\d):(?P<seconds>\d\d(?:[.,]\d+)?)"
    r"\s*(?:Z|(?P<ahead>[+-]\d\d):?(?P<beside>\d\d)|(?P<half>[AP])\.?M\.?)?",
    re.IGNORECASE,
)
EITHER_ORDER = re.compile(r"\d\d?([-/])\d\d?\1\d{4}")  # a date in front, of the day or the month
_UNITS_ALONE = re.compile(r"[\[(]?\s*(?:[mkuµμn]?[msNV]|sec|min|h|px|-|)\s*[\])]?")


@dataclass(frozen=True, slots=True, kw_only=True)
class TableForm:
    """How tables are written; what is None is found.

    Attributes
    ----------
    columns : mapping of str to str
        Quantity with its unit, such as ``P_N`` -> the name in the header, or the number of the
        column from 1 on; with a minus sign before it, of numbers whose sign is to be turned.
    delimiter, decimal, encoding : str or None
    is_day_first : bool or None
        Whether 12/11/2026 is the 12th of November.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    delimiter: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    is_day_first: bool | None = None

    @classmethod
    def given(
        cls,
        columns: Sequence[str] = (),
        delimiter: str | None = None,
        decimal: str | None = None,
        encoding: str | None = None,
        is_day_first: bool | None = None,
    ) -> TableForm:
        """The form that options name; each of `columns` is ``QUANTITY=NAME, QUANTITY=NAME``.

        Raises
        ------
        UserError
        """
        named: dict[str, str] = {}
        for text in columns:
            for part in re.split(r"[,;]\s*(?=\w+\s*=)", text):
                quantity, sign, name = (one.strip() for one in part.partition("="))
                if not (quantity and sign and name):
                    raise UserError(
                        f"--columns: '{text[:200]}' is not QUANTITY=NAME; write for example"
                        ' --columns "time_s=Zeit, P_N=Fn [N], Q_N=Ft [N]"'
                    )
                named[quantity] = name
        if delimiter is not None:
            delimiter = _NAMED.get(delimiter.lower(), delimiter)
            if delimiter not in SEPARATORS:
                raise UserError(
                    f"--delimiter: '{delimiter[:20]}' cannot separate cells; give one of"
                    " ',', ';', '|', tab, space"
                )
        if decimal is not None and decimal not in _NUMBER:
            raise UserError(f"--decimal: '{decimal[:20]}' was given; give '.' or ','")
        if decimal == delimiter == ",":
            raise UserError("--decimal, --delimiter: ',' cannot be both; give another delimiter")
        if encoding is not None:
            try:
                codecs.lookup(encoding)
                "".encode(encoding)
            except (LookupError, ValueError):
                raise UserError(
                    f"--encoding: '{encoding[:40]}' is not known; give utf-8, utf-16 or latin-1"
                ) from None
        return cls(
            columns=named,
            delimiter=delimiter,
            decimal=decimal,
            encoding=encoding,
            is_day_first=is_day_first,
        )


@dataclass(frozen=True, slots=True)
class TableLayout:
    """The form of one table: how it is read, and the names of its columns; `rows_from` lines,
    without comments and empty ones, come before its first row.
    """

    encoding: str
    delimiter: str
    decimal: str
    header: tuple[str, ...]
    rows_from: int

    def __str__(self) -> str:
        sign = "point" if self.decimal == "." else "comma"
        return f"{SEPARATORS[self.delimiter]}, decimal {sign}, {self.encoding}"

    def rows(self, path: Path) -> Iterator[list[str]]:
        """The cells of each row."""
        with path.open(newline="", encoding=self.encoding) as file:
            lines = islice(_lines(file, []), self.rows_from, None)
            if self.delimiter == " ":
                yield from (line.split() for line in lines)
            else:
                yield from csv.reader(lines, delimiter=self.delimiter)

    def number(self, cell: str) -> float:
        """The number in a cell; infinity where there is none."""
        try:
            if self.decimal == "." or not ("," in cell or "." in cell):
                return number_in(cell)
        except ValueError:
            pass
        if not _NUMBER[self.decimal].fullmatch(cell):
            return math.inf
        other = "," if self.decimal == "." else "."
        number = _GROUPS[other].sub("", cell).replace(",", ".")
        return float(number.translate(_AS_PYTHON))


def layout_of(path: Path, form: TableForm, is_known: Callable[[str], bool]) -> TableLayout:
    """How the table in a file is written; `is_known` says which names a header may have.

    Raises
    ------
    OSError, UnicodeError, csv.Error
        The file cannot be read.
    """
    encoding = form.encoding or _encoding(path)
    comments: list[str] = []
    with path.open(newline="", encoding=encoding) as file:
        lines = list(islice(_lines(file, comments), LOOKED_AT))
    if not lines:
        return TableLayout(encoding, form.delimiter or ",", form.decimal or ".", (), 0)
    first = form.delimiter or max(",;\t", key=lines[0].count)
    names = tuple(name.strip() for name in _cells([lines[0]], first)[0])
    plain = TableLayout(encoding, first, form.decimal or ".", names, 1)
    wanted = {one for name in form.columns.values() for one in (name, name.lstrip("- "))}
    if any(is_known(name) or name in wanted for name in names):
        return replace(plain, decimal=form.decimal or _decimal(_cells(lines[1:], first), first))
    return _found(lines, comments, encoding, form) or plain


def _found(
    lines: list[str], comments: list[str], encoding: str, form: TableForm
) -> TableLayout | None:
    """The layout by which the first lines hold the most numbers, with what stands above them; None
    where no layout gives rows of several cells with numbers.
    """
    found = []
    for separator in [form.delimiter] if form.delimiter else SEPARATORS:
        rows = _cells(lines, separator)
        width = Counter(len(row) for row in rows[1:] or rows).most_common(1)[0][0]
        if width < 2:
            continue
        decimal = form.decimal or _decimal(rows, separator)
        like = [row for row in rows if len(row) == width and _numbers(row, decimal)]
        if not like:
            continue
        share = sum(_numbers(row, decimal) for row in like) / (width * len(like))
        rank = (round(len(like) / len(rows), 1), share)
        found.append((rank, separator, decimal, width, rows))
    if not found:
        return None
    _, separator, decimal, width, rows = max(found, key=lambda one: one[0])  # the first of equals
    usual = max(_numbers(row, decimal) for row in rows if len(row) == width)
    first = next(
        (
            n
            for n, row in enumerate(rows)
            if len(row) == width and 0 < usual <= 2 * _numbers(row, decimal)
        ),
        1,
    )
    above = rows[:first]
    if separator == " " and above and len(above[-1]) != width:  # names of several words
        above[-1] = re.split(r"\s{2,}", lines[first - 1].strip())
    if above and len(above[-1]) == width + 1 and above[-1][-1].strip().lower() in NO_CELLS:
        above[-1].pop()
    if not (above and len(above[-1]) == width):
        commented = _cells(comments[-1:], separator)
        are_names = len(commented) > 0 and len(commented[0]) == width
        above = commented if are_names else [[str(n + 1) for n in range(width)]]
    names = tuple(name.strip() for name in above[-1])
    if (
        len(above) > 1
        and len(above[-2]) == width
        and all(map(_UNITS_ALONE.fullmatch, names))
        and any(names)
    ):
        named = zip(above[-2], names, strict=True)
        names = tuple(
            f"{name.strip()} [{unit.strip('[]() ')}]" if unit else name.strip()
            for name, unit in named
        )
    return TableLayout(encoding, separator, decimal, names, first)


def _lines(file: Iterator[str], comments: list[str]) -> Iterator[str]:
    """The lines that are neither empty nor comments; the comments before the first go to
    `comments`.
    """
    begun = False
    for line in file:
        if line.lstrip().startswith("#"):
            if not begun and len(comments) < LOOKED_AT:
                comments.append(line.lstrip().lstrip("#").strip())
        elif line.strip():
            begun = True
            yield line


def _cells(lines: Sequence[str], separator: str) -> list[list[str]]:
    if separator == " ":
        return [line.split() for line in lines]
    return list(csv.reader((line[:LONGEST_LINE] for line in lines), delimiter=separator))


def _numbers(row: Sequence[str], decimal: str) -> int:
    return sum(1 for cell in row if _NUMBER[decimal].fullmatch(cell.strip()))


def _decimal(rows: Sequence[Sequence[str]], separator: str) -> str:
    """The decimal sign with which more of the cells are numbers."""
    if separator == ",":
        return "."
    point, comma = (sum(_numbers(row, sign) for row in rows) for sign in ".,")
    if point != comma:
        return "." if point > comma else ","
    cells = [cell for row in rows for cell in row if _NUMBER["."].fullmatch(cell.strip())]
    signs = {sign for cell in cells for sign in ".," if sign in cell}
    return "," if signs == {","} else "."


def _encoding(path: Path) -> str:
    """UTF-8 or UTF-16 if the file is that, else the code page of Windows for the West."""
    with path.open("rb") as file:
        head = file.read(4096)
        if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return "utf-16"
        for start, name in ((1, "utf-16-le"), (0, "utf-16-be")):
            half = head[start::2]
            if len(half) > 8 and half.count(0) > 0.9 * len(half):
                return name
        decoder, text = codecs.getincrementaldecoder("utf-8-sig")(), head
        try:
            while text:
                decoder.decode(text)
                text = file.read(1 << 20)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return "cp1252"
    return "utf-8-sig"


def name_and_unit(header: str) -> tuple[str, str]:
    """The name of a column in small letters, and its unit: of ``Normal force [mN]``, ``t/s``,
    ``P_N``.
    """
    found = _UNIT.fullmatch(header.strip())
    assert found is not None  # every text is a name without a unit
    unit = next((found[key] for key in "abcd" if found[key] is not None), "")
    name = re.sub(r"[\s_\-]+", " ", found["name"]).strip().lower()
    return name, unit.strip().lower().replace("µ", "u").replace("μ", "u")


def clock_s(cell: str, *, is_day_first: bool = True) -> float:
    """Seconds of a time of day such as ``14:03:07,250`` or ``2:03:07.25 PM``, since midnight, or
    since 1970 with a date in front (``2026-11-12T14:03:07.25+01:00``, ``12.11.2026 14:03:07``,
    ``12/11/2026 14:03:07`` in the given order); infinity for other texts.
    """
    found = _TIME_OF_DAY.fullmatch(cell)
    if found is None:
        return math.inf
    hours, minutes = int(found["hours"]), int(found["minutes"])
    seconds = float(found["seconds"].replace(",", "."))
    first, second = (found["a"], found["b"]) if is_day_first else (found["b"], found["a"])
    days = 0
    try:
        if year := found["year"] or found["y"] or found["z"]:
            month, day = found["month"] or found["m"] or second, found["day"] or found["d"] or first
            days = date(int(year), int(month), int(day)).toordinal() - _DAY_OF_1970
    except ValueError:
        return math.inf
    if found["half"]:
        if not 1 <= hours <= 12:
            return math.inf
        hours = hours % 12 + 12 * (found["half"] in "Pp")
    if hours > 23 or minutes > 59 or seconds >= 60:
        return math.inf
    if found["ahead"]:
        beside = int(found["ahead"][0] + found["beside"])
        minutes -= 60 * int(found["ahead"]) + beside
    return 86400 * days + 3600 * hours + 60 * minutes + seconds


def has_day_first(cells: Iterable[str]) -> tuple[bool, str]:
    """Whether dates such as ``12/11/2026`` in front of times of day begin with the day, by the
    first that has only one meaning; and, if there is none, the first cell that may be read either
    way, else "".
    """
    ambiguous = ""
    for cell in cells:
        found = _TIME_OF_DAY.fullmatch(cell)
        if found is None or not found["a"]:
            continue
        first, second = int(found["a"]), int(found["b"])
        if max(first, second) > MONTHS:
            return first > MONTHS, ""
        if first != second:
            ambiguous = ambiguous or cell
    return True, ambiguous


def quoted(names: Collection[str]) -> str:
    """Names for a message, the first dozen of them."""
    listed = ", ".join(f"'{name[:60]}'" for name in list(names)[:12])
    return listed + (f" and {len(names) - 12} more" if len(names) > 12 else "")
