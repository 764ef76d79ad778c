"""The NI driver on NI's C interface, as most computers have it: NI's own package loads a C library
that stands in for the driver.
"""

import ctypes
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import nidaqmx._lib
import numpy as np
import pytest
from contracts import TRAIN
from driver_runs import started

from drivers.clock import SampleClock
from drivers.daq.ni_daq import NiForces, find
from drivers.errors import DeviceFault, DeviceNotFound, DeviceTimeout
from drivers.protocols import Found, LostSamples
from drivers.settings import ForceSettings

COMPILER = shutil.which("cc") or shutil.which("gcc")


@pytest.fixture(scope="module")
def stub(tmp_path_factory):
    if COMPILER is None:
        pytest.skip("there is no C compiler")
    library = tmp_path_factory.mktemp("stub") / "libnidaqmx.so"
    subprocess.run(
        [
            COMPILER,
            "-shared",
            "-fPIC",
            "-o",
            library,
            Path(__file__).with_name("libnidaqmx_stub.c"),
        ],
        check=True,
        timeout=400,
    )
    return library


@pytest.fixture
def install(monkeypatch):
    """Makes NI's package find that library, or none, as on a computer where it has not been loaded
    yet.
    """

    def make(library, platform="linux"):
        monkeypatch.setattr(
            nidaqmx._lib, "find_library", lambda name: None if library is None else str(library)
        )
        monkeypatch.setattr(nidaqmx._lib, "sys", SimpleNamespace(platform=platform))
        for name in ("_windll", "_cdll", "_encoding"):
            monkeypatch.setattr(nidaqmx._lib.lib_importer, name, None)

    return make


@pytest.fixture
def forces():
    made = NiForces(ForceSettings(buffer=1.0), SampleClock(1000.0))
    yield made
    made.close()


def test_create_read_and_close(stub, install, forces):
    install(stub)
    in_use = ctypes.CDLL(str(stub)).stub_tasks
    forces.open()
    assert forces.describe().startswith("NI PCI-6251, serial number ABC123: ai0 and ai1")
    assert in_use() == 10
    forces.start(TRAIN)
    assert in_use() == 22
    blocks = [forces.read(1.0) for _ in range(2)]
    volts = np.concatenate([block.volts for block in blocks])
    np.testing.assert_allclose(volts, np.arange(100)[:, None] * 1e-3 + [0, 1], rtol=1e-15)
    forces.stop()
    assert in_use() == 10
    forces.close()
    assert in_use() == 0


def test_overwritten_samples_and_a_time_out(stub, install, forces):
    install(stub)
    started(forces)
    forces.read(1.0)
    forces.read(1.0)
    gap = forces.read(1.0)
    assert isinstance(gap, LostSamples)
    assert (gap.first, gap.count) == (100, 150)
    block = forces.read(1.0)
    assert (block.first, block.volts[0, 0]) == (250, 0.25)
    assert [forces.read(1.0).first for _ in range(2)] == [300, 350]
    with pytest.raises(DeviceTimeout, match="50 samples from 400 on"):
        forces.read(0.0)


def test_errors_are_sentences(stub, install):
    install(stub)
    with pytest.raises(
        DeviceNotFound,
        match=r"'Dev7' \(there are: Dev1, Dev1b\) was requested, no board has that name",
    ):
        NiForces(ForceSettings(device="Dev7"), SampleClock(1000.0)).open()
    forces = NiForces(ForceSettings(buffer=1.0, exposure_counter="ctr1"), SampleClock(1000.0))
    with pytest.raises(
        DeviceFault,
        match=(
            r"ctr1 to count at PFI3 was requested, NI's driver cannot do it .*;"
            r" install a newer NI-DAQmx"
        ),
    ):
        forces.open()  # the library has no such function
    assert ctypes.CDLL(str(stub)).stub_tasks() == 0


def test_find_lists_the_boards(stub, install):
    install(stub)
    assert find() == [
        Found("Dev1", "NI PCI-6251, serial number ABC123"),
        Found("Dev1b", "NI PCI-6251, serial number ABC123"),
    ]


@pytest.mark.parametrize(
    ("platform", "reason"),
    [("linux", "Could not find an installation"), ("darwin", "not supported on this platform")],
)
def test_no_driver_is_told(install, forces, platform, reason):
    install(None, platform)
    for ask in (forces.open, find):
        with pytest.raises(
            DeviceNotFound,
            match=f"NI's driver is not installed on this computer .*{reason}.*;"
            " install NI-DAQmx from ni.com",
        ):
            ask()
    with pytest.raises(DeviceFault, match="not open"):
        forces.start(TRAIN)
