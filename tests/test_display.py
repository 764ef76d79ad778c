"""Where no window can be opened, one sentence says why and what to do."""

import sys

import pytest

from app.system import display


@pytest.fixture
def linux(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(display, "_loads", lambda library: True)
    monkeypatch.setattr(display, "_x_server_answers", lambda: True)
    return monkeypatch


def test_no_display_is_named(linux: pytest.MonkeyPatch) -> None:
    assert "neither DISPLAY nor WAYLAND_DISPLAY is set" in str(display.display_problem())
    linux.setenv("QT_QPA_PLATFORM", "xcb")
    assert display.display_problem() is not None


@pytest.mark.parametrize(
    ("name", "value"),
    [("QT_QPA_PLATFORM", "offscreen"), ("DISPLAY", ":0"), ("WAYLAND_DISPLAY", "wayland-0")],
)
def test_a_named_display_is_enough(linux: pytest.MonkeyPatch, name: str, value: str) -> None:
    linux.setenv(name, value)
    assert display.display_problem() is None


@pytest.mark.parametrize("platform", ["linux", "win32"])
@pytest.mark.parametrize("package", ["PySide6-Essentials", "pyqtgraph"])
def test_a_worker_without_the_packages_of_the_window_says_how_to_get_them(
    linux: pytest.MonkeyPatch, package: str, platform: str
) -> None:
    linux.setattr(sys, "platform", platform)
    linux.setenv("QT_QPA_PLATFORM", "offscreen")
    linux.setitem(sys.modules, display.WINDOW_PACKAGES[package], None)
    sentence = str(display.display_problem())
    assert f"no window: the package {package} is not installed" in sentence
    assert f'pip install "{package}' in sentence


def test_a_missing_library_names_its_package(linux: pytest.MonkeyPatch) -> None:
    linux.setattr(display, "_loads", lambda library: "xcb-cursor" not in library)
    linux.setenv("QT_QPA_PLATFORM", "offscreen")
    assert display.display_problem() is None  # only the X11 platform needs it
    linux.setenv("QT_QPA_PLATFORM", "")
    linux.setenv("DISPLAY", ":0")
    assert (
        "libxcb-cursor.so.0 not found on this system; install with: apt install libxcb-cursor0"
        in str(display.display_problem())
    )


def test_a_library_that_is_not_there_does_not_load() -> None:
    assert not display._loads("libthat_does_not_exist.so.0")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="X11 is used on Linux only")
def test_an_x_server_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    if not display._loads("libxcb.so.1"):
        pytest.skip("no X11 library on this system")
    monkeypatch.setenv("DISPLAY", ":9999")
    assert not display._x_server_answers()


@pytest.mark.parametrize("system", ["win32", "darwin"])
def test_windows_and_macos_always_have_a_display(linux: pytest.MonkeyPatch, system: str) -> None:
    linux.setattr(sys, "platform", system)
    assert display.display_problem() is None
