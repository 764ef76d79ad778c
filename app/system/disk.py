"""Files that hold a recording: they only grow, belong to one program, and say by name when the disk
does not take what it is given.
"""

from __future__ import annotations

import errno
import math
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from io import FileIO
from pathlib import Path
from typing import Any

import psutil

COPY_BYTES = 1 << 22  # copied at a time
FAT = ("vfat", "msdos", "fat", "fat32")  # as Linux, macOS and Windows call it
FAT_BYTES = (1 << 32) - 1  # largest file on it
READ_S = 0.5  # for longer nobody reads a small file of the program
_SHORT = 1 << 16

if sys.platform == "win32":
    import msvcrt

    _placing = threading.Lock()

    def _lock(file: FileIO, *, is_shared: bool = False) -> None:
        file.seek(1 << 60)  # beyond what others may read
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)

    def _read_some(file: FileIO, place: int, into: memoryview) -> int:
        with _placing:
            file.seek(place)
            return file.readinto(into) or 0
else:
    import fcntl
    import resource

    def _lock(file: FileIO, *, is_shared: bool = False) -> None:
        fcntl.flock(file, (fcntl.LOCK_SH if is_shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)

    def _read_some(file: FileIO, place: int, into: memoryview) -> int:
        return os.preadv(file.fileno(), [into], place)


def read_at(file: FileIO, place: int, into: memoryview) -> bool:
    """Whether the bytes at a place of a file fill `into`. Threads and forked processes, which share
    the position of a file, may read it at once.
    """
    while into and (count := _read_some(file, place, into)):
        place, into = place + count, into[count:]
    return not into


def is_locked(path: Path) -> bool:
    """Whether a program, also of another user, holds the lock of a file; False where that cannot be
    read.
    """
    try:
        file = FileIO(path)
    except OSError:
        return False
    with file:
        return not _is_taken(file, is_shared=True)


def _is_taken(file: FileIO, *, is_shared: bool = False) -> bool:
    """Whether the file is now locked for this program, or on a file system without locks. A shared
    lock, which needs no right to write, keeps off exclusive ones only.
    """
    try:
        _lock(file, is_shared=is_shared)
    except OSError as error:
        return error.errno in (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
    return True


def _write_all(write: Callable[[memoryview], int | None], content: memoryview) -> None:
    while content:
        count = write(content)
        if not count:
            raise OSError(errno.ENOSPC, "the disk takes no more")
        content = content[count:]


def sync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk, where the system can be asked to."""
    if sys.platform != "win32":
        opened = os.open(folder, os.O_RDONLY)
        try:
            _sync(opened)
        finally:
            os.close(opened)


def sync_file(path: Path) -> None:
    """Bring the content of a file to the disk, where the system can be asked to."""
    with path.open("rb+") as file:  # Windows syncs only what may be written
        _sync(file.fileno())


def _sync(opened: int) -> None:
    try:
        os.fsync(opened)
    except OSError as error:  # some shares know no sync, or none of folders
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EBADF):
            raise


def forget_cached(file: FileIO) -> None:
    """Let what is read from a file, all of which was synced, come from the disk and not from
    memory, where the system can be asked to.
    """
    if sys.platform == "linux":
        with suppress(OSError):
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


class DiskError(OSError):
    """The disk did not take what it was given; as a sentence that begins with the name of the file
    where there is one.
    """

    def __str__(self) -> str:
        return f"{self.filename}: {self.strerror}" if self.filename else str(self.strerror)


class AppendedFile:
    """A file that only grows, open for one thread that appends and one that syncs.

    After a write that failed, nothing more is written, and each further one fails with the same
    words. A sync that failed does not hinder the next, which may well pass though the data are lost
    (a system reports such a loss once); so it is remembered.

    Parameters
    ----------
    locked : bool
        Whether the file is to be locked against other programs, before a byte of it is changed.

    Attributes
    ----------
    lock : threading.Lock
        For who adds several things that belong together.
    failure : str
        Why not all that was given is sure to be on the disk; empty where it is.

    Raises
    ------
    FileExistsError
        There is one, and it may not be overwritten.
    BlockingIOError
        Another program has it locked.
    """

    def __init__(self, path: Path, *, overwrite: bool, locked: bool = False) -> None:
        self.path, self.failure = path, ""
        self.end = 0  # bytes in it
        self._is_locked = locked
        self._is_unwanted = False  # it is to be removed as soon as that can be
        self.lock = threading.Lock()
        self._placing = threading.Lock()  # a read moves the place in the file, a write may, too
        self._refused: DiskError | None = None
        # "a": opening it changes nothing
        self._file = FileIO(path, "a+" if overwrite else "x+")
        try:
            if locked and not _is_taken(self._file):
                raise BlockingIOError(errno.EWOULDBLOCK, "it is locked", str(path))
            self._file.truncate(0)
            self._file.seek(0)
        except BaseException:
            self._file.close()
            raise

    @property
    def is_all_there(self) -> bool:
        """Whether the file is as long as what was added to it."""
        return os.fstat(self._file.fileno()).st_size == self.end

    @property
    def is_in_place(self) -> bool:
        """Whether the file is still the one at its path."""
        try:
            return os.path.samestat(self.path.stat(), os.fstat(self._file.fileno()))
        except OSError:
            return False

    def append(self, *parts: Any) -> int:
        """Where in the file the parts were added; all of them or, with OSError, nothing."""
        if self._refused is not None:
            raise self._refused
        views = [memoryview(part).cast("B") for part in parts]
        if sum(map(len, views)) < _SHORT:
            views = [memoryview(b"".join(views))]  # one call of the system
        place = end = self.end
        try:
            with self._placing:
                self._file.seek(self.end)
                for view in views:
                    _write_all(self._file.write, view)
                    end += len(view)
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self.end)
            self.failure = f"{self.path} cannot be written: {error.strerror or error}"
            self._refused = DiskError(error.errno, self.failure)
            raise self._refused from error
        self.end = end
        return place

    def sync(self) -> None:
        """Bring everything so far to the disk.

        Raises
        ------
        OSError
            It may not be there, also if a later sync says nothing.
        """
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self.failure = f"{self.path} cannot be brought to the disk: {error.strerror or error}"
            raise DiskError(error.errno, self.failure) from error

    def copy_to(self, path: Path) -> AppendedFile:
        """A new file at another path with all that is in this one, whatever became of its name;
        nothing is left of it if it cannot be written.
        """
        new = AppendedFile(path, overwrite=False, locked=self._is_locked)
        try:
            new.catch_up(self)
        except BaseException:
            new.remove()
            raise
        return new

    def catch_up(self, former: AppendedFile) -> None:
        """Add what a former file has beyond the end of this one."""
        while self.end < former.end:
            count = min(COPY_BYTES, former.end - self.end)
            with former._placing:
                former._file.seek(self.end)
                block = former._file.read(count)
            if not block:
                raise DiskError(errno.EIO, f"{former.path} was cut short while it was written")
            self.append(block)

    def close(self) -> None:
        """Let go of the file. May be called twice."""
        unwanted = os.fstat(self._file.fileno()) if self._is_unwanted else None
        self._file.close()
        if unwanted is not None:
            self._is_unwanted = False
            with suppress(OSError):
                if os.path.samestat(self.path.stat(), unwanted):
                    self.path.unlink()

    def unlink(self) -> None:
        """Remove the file if it is still the one at its path; when it is closed, where the system
        removes no file that is open, as Windows does not.

        Raises
        ------
        OSError
            It cannot be removed; where the system refuses that (PermissionError), nothing is
            raised, and it is tried once more when the file is closed.
        """
        if self.is_in_place:
            try:
                self.path.unlink(missing_ok=True)
            except PermissionError:
                self._is_unwanted = True

    def remove(self) -> None:
        """Let go of the file and remove it, as `unlink`, where it can be removed."""
        if not self._file.closed:
            with suppress(OSError):
                self.unlink()
            self.close()


class SparedFile(FileIO):
    """A file in which HDF5 makes a new one; what lies beyond what it writes stays as it is. HDF5
    breaks the program if it goes on after a write that failed: it is not told of one. The first
    failure is kept, nothing is written after it, and `check` raises it. What was not written is
    read as zeros, for HDF5 follows whatever the memory holds in which it reads.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "r+")
        self._is_blank = True
        self._failure: OSError | None = None

    def seek(self, place: int, whence: int = os.SEEK_SET) -> int:
        """As of any file, but the end of a blank one is its beginning."""
        if self._is_blank and whence == os.SEEK_END:
            return super().seek(0)
        return super().seek(place, whence)

    def write(self, content: Any) -> int:
        """The number of bytes given, also of those that were not written."""
        view = memoryview(content).cast("B")
        self._is_blank = False
        if self._failure is None:
            try:
                _write_all(super().write, view)
            except OSError as error:
                self._failure = error
        return len(view)

    def readinto(self, into: Any) -> int:
        """The number of bytes asked, also of those that are not in the file."""
        view = memoryview(into).cast("B")
        count = super().readinto(view) or 0
        view[count:] = bytes(len(view) - count)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """The size that was asked."""
        if self._failure is None:
            try:
                return super().truncate(size)
            except OSError as error:
                self._failure = error
        return size or 0

    def spare(self) -> None:
        """Write no more, whatever comes."""
        self._failure = self._failure or OSError(errno.ECANCELED, "it was given up")

    def check(self) -> None:
        """Raise the first failure."""
        if self._failure is not None:
            raise DiskError(
                self._failure.errno,
                f"it cannot be written: {self._failure.strerror or self._failure}",
                self.name,
            ) from self._failure

    def sync(self) -> None:
        """Bring everything to the disk, and let it be read from there."""
        self.check()
        os.fsync(self.fileno())
        forget_cached(self)


def replace_file(new: Path, place: Path) -> None:
    """Give a file the name of another that it replaces. Windows refuses that as long as somebody
    reads the other, so it is tried again for a moment.
    """
    until = time.monotonic() + READ_S
    while True:
        try:
            new.replace(place)
            return
        except PermissionError:
            if time.monotonic() > until:
                raise
            time.sleep(READ_S / 20)


def take_place(new: Path, place: Path, overwrite: bool) -> None:
    """Give a file its final name, and bring that to the disk.

    Raises
    ------
    FileExistsError
        Another file has that name, and may not be overwritten.
    """
    if overwrite:
        replace_file(new, place)
    else:
        try:
            os.link(new, place)
        except FileExistsError:
            raise
        except (OSError, NotImplementedError):  # no hard links there
            if place.exists():
                raise FileExistsError(errno.EEXIST, "it exists", str(place)) from None
            new.rename(place)
        else:
            new.unlink()
    sync_folder(place.absolute().parent)


def largest_file(path: Path) -> tuple[float, str]:
    """Bytes that a file at this place can have at most, and what sets that limit; infinite where no
    limit is known.
    """
    limits = [(math.inf, "")]
    if sys.platform != "win32":
        allowed = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
        if allowed != resource.RLIM_INFINITY:
            limits.append((allowed, "ulimit -f"))
    place = path.absolute().parent.resolve()
    disks = psutil.disk_partitions(all=False)  # on Windows, network disks may not answer
    mounted = {Path(disk.mountpoint): disk.fstype for disk in disks}
    kind = next((mounted[one] for one in (place, *place.parents) if one in mounted), "")
    if kind.lower() in FAT:
        limits.append((FAT_BYTES, f"the file system {kind}"))
    return min(limits)


def free_bytes(path: Path) -> int:
    """Room on the disk of a file."""
    return shutil.disk_usage(path.absolute().parent).free


UNITS = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"))


def bytes_text(count: float) -> str:
    """So many bytes in a unit in which people can read them."""
    scale, unit = next((one for one in UNITS if count >= one[0]), UNITS[-1])
    text = f"{count / scale:.0f}" if scale < 1e9 else f"{float(f'{count / scale:.3g}'):g}"
    return f"{text} {unit}"
