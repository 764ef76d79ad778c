"""The numbers of NI's errors, as sentences that say what to do."""

from __future__ import annotations

from drivers import installation
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, OutOfLimits

NOT_YET = -200284
OVERWRITTEN = (-200279, -200222)
GONE = (-201003, -200324, -200045, -88709, -88705, -50808, -50405)
_KNOWN: tuple[tuple[tuple[int, ...], type[DeviceError], str, str], ...] = (
    (GONE, DeviceFault, "the board is gone", "check its cable and power, then start again"),
    (
        (-200220,),
        DeviceNotFound,
        "no board has that name",
        "correct `device`, or the board's name in NI MAX",
    ),
    (
        (-200170,),
        DeviceNotFound,
        "the board has no channel of that name",
        "correct it in the settings; NI MAX lists those of the board",
    ),
    (
        (-50103, -200022, -200587),
        DeviceFault,
        "another program has reserved it",
        "end that program, or a test panel of NI MAX",
    ),
    (
        (-200077, -200081, -200332),
        OutOfLimits,
        "the board cannot do that: {text}",
        "correct sample rate or range in the settings",
    ),
    (
        (-200361, -200010, -200019),
        DeviceFault,
        "the board's own memory overflowed",
        "end other programs on this computer, start again",
    ),
)
"""NI's codes, the error that they become, what happened, what to do."""


def need(who: str, package: str) -> None:
    """Check that a Python package can be imported.

    Raises
    ------
    DeviceNotFound
        It cannot; the message says what to install or to change.
    """
    try:
        __import__(package)
    except OSError as error:  # such as of nidaqmx, which reads settings near the current folder
        remedy = f"change to a folder that exists, or install {package} again"
        raise DeviceNotFound(f"{who}: {package} was not loaded ({error}); {remedy}") from None
    except ImportError as error:
        what = "nidaqmx[grpc]" if package == "grpc" else package
        raise DeviceNotFound(
            f"{who}: the package {package} cannot be imported ({error}); to install it:"
            f" {installation.add(what, needed=what == package)}"
        ) from None


def sentence(who: str, asked: str, error: Exception) -> DeviceError:
    """The error to raise for one of NI's library."""
    from nidaqmx.errors import DaqError, DaqNotFoundError, DaqNotSupportedError

    text = str(error).splitlines()[0].rstrip(".")
    if isinstance(error, DaqNotFoundError | DaqNotSupportedError):
        remedy = "install NI-DAQmx from ni.com, or name the `server` that has the board"
        return DeviceNotFound(
            f"{who}: {asked} was requested, NI's driver is not installed on this computer ({text});"
            f" {remedy}"
        )
    if not isinstance(error, DaqError):
        return DeviceFault(
            f"{who}: {asked} was requested, NI's driver cannot do it ({text}); install a newer"
            " NI-DAQmx"
        )
    default = ((), DeviceFault, "{text}", f"look up NI's error {error.error_code}")
    _, kind, found, remedy = next((row for row in _KNOWN if error.error_code in row[0]), default)
    return kind(f"{who}: {asked} was requested, {found.format(text=text)}; {remedy}")
