"""The results of single sessions on their way into a file of results: each is a small file of its
own beside it, so that an analysis that was interrupted goes on where it was.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from app.records.study_results import Joint, RunResult
from app.session.results import ResultsReader, write_runs
from app.study.analysis_plan import Task
from app.system.disk import AppendedFile
from app.system.errors import UserError
from app.system.outputs import new_file

LOCK = "lock"
KEY = "key"  # name of the key in what a part was made with


class Parts:
    """The folder of the parts of a file of results.

    Attributes
    ----------
    are_over : bool
        Whether nobody needs these parts, nor what is left of others, any more.
    """

    def __init__(self, output: Path) -> None:
        self.folder = output.with_name(f"{output.name}.parts")
        self.are_over = False

    @contextmanager
    def held(self) -> Iterator[None]:
        """Nobody else works on these parts within the block.

        Raises
        ------
        UserError
            Another program does, or there can be no folder.
        """
        try:
            self.folder.mkdir(exist_ok=True)
            lock = AppendedFile(self.folder / LOCK, overwrite=True, locked=True)
        except BlockingIOError:
            raise UserError(
                f"{self.folder}: another program is making these results; wait for its end"
            ) from None
        except OSError as error:
            raise UserError(
                f"{self.folder}: it cannot be written: {error.strerror}; choose another place"
            ) from None
        try:
            yield
        finally:
            lock.close()
            if self.are_over or [p.name for p in self.folder.iterdir()] == [LOCK]:
                shutil.rmtree(self.folder, ignore_errors=True)

    def place(self, task: Task) -> Path:
        """Where the part of a session lies."""
        return self.folder / f"{task.key}.h5"

    def done(self, tasks: Iterable[Task]) -> set[str]:
        """Keys of the tasks whose part is there and whole."""
        return {task.key for task in tasks if self._is_whole(task)}

    def _is_whole(self, task: Task) -> bool:
        try:
            with ResultsReader(self.place(task)) as part:
                return part.made_with == {KEY: task.key} and len(part) == 1
        except UserError:
            return False

    def take(self, task: Task, content: bytes) -> None:
        """Keep a part that came from elsewhere."""
        with new_file(self.place(task), overwrite=True) as unfinished:
            unfinished.write_bytes(content)


def write_part(place: Path, task: Task, run: RunResult) -> None:
    """Write the results of a session as a part."""
    write_runs(place, [run], Joint(), {KEY: task.key}, overwrite=True)
