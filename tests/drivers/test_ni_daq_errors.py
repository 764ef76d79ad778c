"""What ends a run of the NI driver or keeps it from beginning, through NI's own package: each a
sentence that says what to do.
"""

import contextlib
import signal
import subprocess
import sys
import threading
import time

import grpc
import numpy as np
import pytest
import trustme
from contracts import TRAIN
from driver_runs import PATIENT_S, end_of_a_waiting_read, started
from ni_bench import NiBench, check_samples, pieces, reference
from nidaqmx import GrpcSessionOptions, Task
from nidaqmx.errors import DaqError
from python_program import python

from drivers.daq import ni_channel, ni_daq
from drivers.emulators.board import NiError
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits


@pytest.fixture
def ni():
    with NiBench() as bench:
        yield bench


# ------------------------------------------------------------------ time-outs and ends


def test_a_time_out_loses_nothing(ni):
    forces = started(ni.emulated(pace=1e-3, block=250, exposure_counter="ctr1"))
    for _ in range(2):
        with pytest.raises(
            DeviceTimeout,
            match=r"250 samples from 0 on have not all come within 0\.02 s.* none is lost",
        ):
            forces.read(0.02)
    forces.world.pace = 10.0
    check_samples(pieces(forces, 750))


def test_one_thread_at_a_time_talks_to_the_library(ni, monkeypatch):
    forces = started(ni.emulated())
    board, is_held = forces.server.board, []
    for name in ("read", "total"):
        ask = getattr(board, name)
        monkeypatch.setattr(
            board, name, lambda *of, ask=ask: (is_held.append(forces._lock.locked()), ask(*of))[1]
        )
    forces.read(5.0)
    forces.backlog()
    assert is_held == [True, True]


def test_a_read_that_waits_ends_when_another_thread_stops(ni):
    forces = started(ni.emulated(pace=1e-3))
    error = end_of_a_waiting_read(forces, forces.stop, forces, "_next_block")
    assert isinstance(error, DeviceFault)
    assert "stopped" in str(error)


def test_an_unplugged_board_ends_a_read_that_waits_and_closes_quietly(ni):
    server = ni.serve(pace=1e-3)
    forces = started(ni.connect(server.address))
    error = end_of_a_waiting_read(forces, server.board.unplug, forces, "_next_block")
    assert isinstance(error, DeviceFault)
    assert "the board is gone; check its cable" in str(error)
    for again in (lambda: forces.read(1.0), lambda: forces.start(TRAIN)):
        with pytest.raises(DeviceFault, match="gone"):
            again()
    assert forces.backlog() == 0
    forces.stop()
    forces.close()
    with pytest.raises(DeviceFault, match="the board is gone"):
        forces.open()


@pytest.mark.parametrize("pace", [None, 10.0])
def test_a_server_that_dies_at_a_sample_is_told_there(ni, pace):
    forces = started(ni.emulated("daq-gone 420", pace=pace))
    read = []
    with pytest.raises(
        DeviceFault,
        match=r"sample \d+ was requested, the server 127.0.0.1:\d+ does not answer .*firewall",
    ):
        read.extend(iter(lambda: forces.read(20.0), None))
    # what the dead server had and nobody had fetched is gone with it
    whole = list(range(0, 400, 50))
    assert [block.first for block in read] == (whole if pace is None else whole[: len(read)])
    assert forces.world.now == 420
    forces.stop()
    forces.close()


@pytest.mark.slow
@pytest.mark.parametrize("end", ["kill", "freeze"])
def test_a_server_that_dies_in_the_middle_of_a_read_is_told(ni, end):
    code = (
        "import time\nfrom drivers.emulators.ni_server import NiServer\n"
        "from drivers.sim.scenario import Scenario\nfrom drivers.sim.world import World\n"
        "server = NiServer(World(Scenario(), 1e-3))\n"
        "print(server.address, flush=True)\ntime.sleep(600)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True
    ) as server:
        try:
            forces = started(ni.connect(server.stdout.readline().strip(), answer_time=2.0))
            kills = end == "kill" or sys.platform == "win32"
            die = server.kill if kills else lambda: server.send_signal(signal.SIGSTOP)
            error = end_of_a_waiting_read(forces, die, forces, "_next_block")
            forces.close()
        finally:
            server.kill()
    assert isinstance(error, DeviceFault)
    assert "does not answer" in str(error)


@pytest.mark.parametrize("where", ["opening", "running"])
def test_a_server_that_accepts_calls_and_does_not_answer_is_a_fault_in_time(ni, where):
    server, silent = ni.serve(pace=1.0), threading.Event()
    forces = ni.connect(server.address, answer_time=0.5)
    check, server.board.check = server.board.check, lambda: silent.wait(PATIENT_S)
    if where == "running":
        server.board.check = check
        started(forces)
        forces.read(5.0)
        server.board.check = lambda: silent.wait(PATIENT_S)
    began = time.monotonic()
    try:
        with pytest.raises(
            DeviceError, match=f"the server {server.address} does not answer .Deadline Exceeded"
        ):
            forces.open() if where == "opening" else [forces.read(0.1) for _ in range(2)]
        forces.close()
        assert time.monotonic() - began < PATIENT_S / 2
    finally:
        silent.set()


def test_a_server_that_falls_silent_or_is_slow_by_a_fault_of_the_world(ni):
    slow = started(ni.emulated("slow-server 0 50", pace=1.0))
    assert slow.read(5.0).first == 0
    slow.close()
    silent = started(ni.emulated("silent-server 300", pace=1.0, answer_time=3.0))

    def read_on():
        for _ in range(200):
            with contextlib.suppress(DeviceTimeout):
                silent.read(0.2)

    with pytest.raises(DeviceFault, match="does not answer"):
        read_on()
    assert silent.world.now >= 300


def test_the_first_call_of_a_connection_alone_has_more_time(monkeypatch):
    monkeypatch.setattr(grpc, "intercept_channel", lambda channel, deadline: deadline)
    channel, deadline = ni_channel.connect("localhost:1", None, 0.5)
    channel.close()
    call = grpc.aio.ClientCallDetails("x", None, None, None, None)
    times = [deadline.intercept_unary_unary(lambda c, _: c.timeout, call, None) for _ in range(3)]
    assert times == [0.5 * ni_channel.FIRST_TIMES, 0.5, 0.5]


def test_the_first_call_of_a_connection_may_take_longer_as_it_loads_the_driver(ni, monkeypatch):
    server, loaded, began = ni.serve(pace=1.0), threading.Event(), threading.Event()
    check = server.board.check

    def load():
        """Every call waits until the first has let the server load its driver."""
        if not began.is_set():
            began.set()
            threading.Timer(1.5, loaded.set).start()
        loaded.wait(PATIENT_S)
        check()

    monkeypatch.setattr(server.board, "check", load)
    forces = ni.connect(server.address, answer_time=0.5)
    forces.open()
    assert loaded.is_set()
    forces.close()


# ------------------------------------------------------------------ what cannot be opened


@pytest.mark.parametrize(
    ("settings", "kind", "sentence"),
    [
        (
            {"device": "Dev7"},
            DeviceNotFound,
            r"'Dev7' \(there are: Dev1\) was requested, no board has that name; correct `device`",
        ),
        (
            {"channels": ("ai0", "ai99")},
            DeviceNotFound,
            "ai0 and ai99 at 1000 Hz was requested, the board has no channel of that name",
        ),
        (
            {"trigger_counter": "ctr5"},
            DeviceNotFound,
            "the trigger output was requested, the board has no channel of that name",
        ),
        (
            {"trigger": "digital", "trigger_line": "port7/line0"},
            DeviceNotFound,
            "the board has no channel",
        ),
        (
            {"exposure_counter": "ctr2"},
            DeviceNotFound,
            "ctr2 to count at PFI3 was requested, the board has no channel",
        ),
        (
            {"range": (20.0, 10.0)},
            OutOfLimits,
            "the board cannot do that: .*-20 V to 20 V; correct",
        ),
        (
            {"rate": 1e6},
            OutOfLimits,
            "ai0 and ai1 at 1e.06 Hz was requested, the board cannot do that",
        ),
        (
            {"rate": 3000.0},
            OutOfLimits,
            r"3000 Hz was requested, the nearest that the board has is 2999\.85",
        ),
    ],
)
def test_what_the_board_has_not_is_told(ni, settings, kind, sentence):
    forces = ni.connect(ni.serve().address, **settings)
    with pytest.raises(kind, match=sentence):
        forces.open()
    with pytest.raises(DeviceError):
        forces.start(TRAIN)


def test_a_board_that_another_program_uses_is_told_and_free_again_once_that_has_ended(ni):
    server = ni.serve()
    first, second = ni.connect(server.address), ni.connect(server.address)
    first.open()
    with pytest.raises(DeviceFault, match="another program has reserved it; end that program"):
        second.open()
    first.start(TRAIN)
    assert first.read(5.0).first == 0
    first.close()
    second.open()


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        (-200361, "the board's own memory overflowed"),
        *((code, "the board is gone") for code in (-88705, -200324, -200045, -88709)),
        (-50150, "the hardware caught fire; look up NI's error -50150"),
    ],
)
def test_other_ends_of_a_run_are_told(ni, monkeypatch, code, sentence):
    forces = started(ni.emulated())

    def fail(*args):
        raise NiError(code, "the hardware caught fire.\nDevice: Dev1")

    monkeypatch.setattr(forces.server.board, "read", fail)
    with pytest.raises(DeviceFault, match=f"sample 0 was requested, {sentence}"):
        forces.read(1.0)


def test_a_call_that_the_emulated_board_does_not_know_is_an_ni_error(ni):
    with (
        grpc.insecure_channel(ni.serve().address) as channel,
        Task(grpc_options=GrpcSessionOptions(channel, "")) as task,
    ):
        with pytest.raises(DaqError, match="does not know the call CreateAICurrentChan"):
            task.ai_channels.add_ai_current_chan("Dev1/ai0")
        with pytest.raises(DaqError, match="does not have attribute 0x"):
            _ = task.in_stream.curr_read_pos


# ------------------------------------------------------------------ server and package


def test_no_server(ni):
    server = ni.serve()
    server.close()
    with pytest.raises(
        DeviceNotFound,
        match=(
            f"the server {server.address} does not answer .*refused.* gRPC device server runs there"
        ),
    ):
        ni.connect(server.address).open()


class Certificates:
    """A server's key and certificate, made on the spot, and in a folder those of its authority and
    of another one.
    """

    def __init__(self, folder):
        authority, self.folder = trustme.CA(), folder
        server = authority.issue_cert("localhost", "127.0.0.1")
        self.server = server.private_key_pem.bytes(), server.cert_chain_pems[0].bytes()
        authority.cert_pem.write_to_path(folder / "authority.pem")
        trustme.CA().cert_pem.write_to_path(folder / "other.pem")


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    return Certificates(tmp_path_factory.mktemp("tls"))


def test_an_encrypted_connection(ni, certificates):
    server = ni.serve(tls=certificates.server)
    forces = started(
        ni.connect(server.address, certificate=str(certificates.folder / "authority.pem"))
    )
    np.testing.assert_array_equal(forces.read(5.0).volts, reference(50))


@pytest.mark.parametrize(
    ("certificate", "sentence"),
    [
        ("other.pem", "CERTIFICATE_VERIFY_FAILED"),
        ("missing.pem", "cannot be read .*correct `certificate`"),
        ("", "does not answer"),
    ],
)
def test_a_server_that_is_not_vouched_for(ni, certificates, certificate, sentence):
    server = ni.serve(tls=certificates.server)
    with pytest.raises(DeviceNotFound, match=sentence):
        ni.connect(
            server.address, certificate=certificate and str(certificates.folder / certificate)
        ).open()


@pytest.mark.parametrize(
    ("package", "what"), [("nidaqmx", r'"nidaqmx>=1\.0"'), ("grpc", r'"nidaqmx\[grpc\]>=1\.0"')]
)
def test_a_missing_package_names_what_to_install(ni, monkeypatch, package, what):
    monkeypatch.setitem(sys.modules, package, None)
    forces = ni.connect("127.0.0.1:1")
    with pytest.raises(
        DeviceNotFound, match=rf"package {package} cannot be imported.*pip install {what}"
    ):
        forces.open()
    with pytest.raises(DeviceError):
        forces.start(TRAIN)
    with pytest.raises(DeviceError):
        forces.read(0.01)
    if package == "nidaqmx":
        with pytest.raises(DeviceNotFound, match=r'pip install "nidaqmx>=1\.0"'):
            ni_daq.find()


@pytest.mark.skipif(sys.platform == "win32", reason="a current folder is not removed there")
def test_a_package_that_is_loaded_in_a_folder_that_was_removed(tmp_path):
    code = (
        f"import os\nos.chdir({str(tmp_path)!r})\nos.rmdir({str(tmp_path)!r})\n"
        "from drivers.errors import DeviceNotFound\nfrom drivers.daq import ni_daq\n"
        "try:\n    ni_daq.find()\nexcept DeviceNotFound as error:\n    print(error)"
    )
    found = python("-c", code)
    assert found.returncode == 0
    assert "nidaqmx was not loaded" in found.stdout
    assert "change to a folder that exists" in found.stdout


def test_the_module_loads_no_vendor_library():
    code = (
        "import sys, drivers.daq.ni_daq, drivers.emulators.ni\nassert not {'nidaqmx', 'grpc'} &"
        " set(sys.modules)"
    )
    assert python("-c", code).returncode == 0
