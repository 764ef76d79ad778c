"""The tables that a file holds, written one by one or all of them into a folder."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.files.text_tables import write_table
from app.session.tables import AbsentError, Columns
from app.system.errors import UserError
from app.system.outputs import new_file, new_folder
from app.system.progress import HowFar


@dataclass(frozen=True)
class Tables:
    """Tables by their names.

    Attributes
    ----------
    names : sequence of str
    make : callable
        Gives the columns of a table; AbsentError where there is nothing for it.
    tell : callable
        Told what is being written, and the share of it that is done.
    of_frames : bool
        Whether only some frames were chosen, so that a table without frames is refused.
    """

    names: Sequence[str]
    make: Callable[[str], Columns]
    tell: HowFar
    of_frames: bool = False

    def write(self, what: str, output: Path, overwrite: bool) -> str:
        """Write one table; a sentence about it.

        Raises
        ------
        UserError
            There is nothing for it, it has no frames to choose, or it cannot be written.
        """
        columns = self.make(what)
        if self.of_frames and "frame" not in columns:
            raise UserError(f"{output}: {what} are not of single frames; leave --frames out")
        with new_file(output, overwrite) as path:
            return f"{output}: {what}, {self.write_to(path, what, columns)} rows"

    def write_to(self, path: Path, what: str, columns: Columns) -> int:
        """Write the columns of a table to a new file; the number of its rows."""
        with path.open("x", encoding="utf-8", newline="\n") as file:
            return write_table(file, columns, lambda share: self.tell(what, share))

    def write_all(self, output: Path, overwrite: bool) -> str:
        """Write every table that has something in it into a folder; a sentence about them."""
        written, absent = [], []
        ours = re.compile(rf"({'|'.join(self.names)})\.csv")
        with new_folder(output, overwrite, ours) as folder:
            for what in self.names:
                try:
                    columns = self.make(what)
                except AbsentError:
                    absent.append(what)
                    continue
                self.write_to(folder / f"{what}.csv", what, columns)
                written.append(what)
        nothing = f"; nothing for {', '.join(absent)}" if absent else ""
        return f"{output}: tables of {', '.join(written)}{nothing}"
