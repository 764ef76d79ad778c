"""Asking for a file, beside the window: its keys, and STOP MOTION in it, stay within reach."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QFileInfo, Qt
from PySide6.QtWidgets import QFileDialog, QLineEdit, QWidget

from app.gui.background import Take

SESSION_FILES = "Sessions (*.h5 *.hdf5 *.nxs);;All files (*)"


class FileDialog(QFileDialog):
    """A dialog for a file; a name without one of the `endings` gets the first of them."""

    endings: Sequence[str] = ()

    def accept(self) -> None:
        """Take the file; one to be saved is asked about, if it exists, by its whole name."""
        line, file = self.findChild(QLineEdit, "fileNameEdit"), QFileInfo(*self.selectedFiles()[:1])
        is_named = not self.endings or file.suffix().lower() in self.endings or file.isDir()
        if line is not None and not is_named:
            line.setText(f"{line.text()}.{self.endings[0]}")
        super().accept()


def ask_file(
    parent: QWidget,
    title: str,
    act: Take,
    *,
    start: Path | None = None,
    kinds: str = "",
    mode: QFileDialog.FileMode = QFileDialog.FileMode.ExistingFile,
    endings: Sequence[str] = (),
    may_exist: bool = False,
) -> QFileDialog:
    """Ask for a file and go on at once; no dialog of the system, for it would take all keys.

    Parameters
    ----------
    act : callable
        What is done with the file, once one was chosen.
    start : Path, optional
        The folder that is shown at first, or the file that is proposed.
    kinds : str
        Kinds of files to choose from, as in ``Sessions (*.h5);;All files (*)``.
    mode : QFileDialog.FileMode
        ``AnyFile`` asks where something is to be saved.
    endings : sequence of str
        Of files to be saved; one that is named without any of them gets the first.
    may_exist : bool
        Whether a file to be saved that exists is taken without a question.
    """
    dialog = FileDialog(parent, title)
    dialog.endings = endings
    dialog.setOption(QFileDialog.Option.DontUseNativeDialog)
    dialog.setOption(QFileDialog.Option.DontConfirmOverwrite, may_exist)
    dialog.setFileMode(mode)
    if mode is QFileDialog.FileMode.AnyFile:
        dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
    if kinds:
        dialog.setNameFilter(kinds)
    if start is not None and start.is_dir():
        dialog.setDirectory(str(start))
    elif start is not None:
        dialog.setDirectory(str(start.parent))
        dialog.selectFile(start.name)
    dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    dialog.fileSelected.connect(lambda name: act(Path(name)))
    dialog.setModal(False)
    dialog.show()
    return dialog
