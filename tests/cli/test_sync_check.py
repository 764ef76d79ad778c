"""`slipscope check --sync` on the emulated bench: polarity and lag of the exposure edge, and the
certificate in the sessions that follow.
"""

from itertools import count
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import short_run
from processes.launched import wait_until

from app.bench_checks.sync_check import measure, sync_check
from app.runs import live
from app.settings import config
from app.settings.sync_certificate import NAME, certificate_record, place, write
from drivers.errors import DeviceError
from drivers.protocols import SampleBlock

pytest.importorskip("pypylon")
pytest.importorskip("grpc")

FAST = (*short_run.SMALL, "camera.divisor=50", "run.travel=20", "forces.buffer=60")


def bench_of(*overrides):
    settings = config.load(Path("hil-emulated"), [*FAST, *overrides])
    return settings, live.make_bench(settings, 2.0)


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("SLIPSCOPE_HOME", str(tmp_path / "home"))


def test_a_bench_is_measured_and_its_sessions_say_so(tmp_path):
    settings, bench = bench_of()
    (finding,) = sync_check(settings, bench)
    assert finding.is_fine, finding.value
    assert "the rising edge comes 0 ms after the trigger, within 0 ms" in finding.value
    run = live.make_run(settings, tmp_path / "run.h5", pace=2.0)
    run.start()
    wait_until(lambda: run.health().state != "armed", "the session")  # none if stopped before
    run.request_stop("enough")
    run.wait(60)
    with h5py.File(tmp_path / "run.h5") as file:
        names = list(file["/entry/versions/name"].asstr()[:])
        text = file["/entry/versions/version"].asstr()[names.index(NAME)]
    assert text == certificate_record(settings)[NAME]
    assert "from a limit to ST" in text


def test_an_inverted_exposure_line_is_refused_and_explained_and_the_other_edge_is_right():
    inverted = 'sim.faults=["exposure-inverted 0"]'
    settings, bench = bench_of(inverted)
    with (
        bench,
        pytest.raises(
            DeviceError, match=r"10 ms after the trigger.*set forces\.exposure_edge = 'falling'"
        ),
    ):
        measure(settings, bench)
    assert not place(settings).exists()
    settings, bench = bench_of(inverted, "forces.exposure_edge=falling")
    with bench:
        certificate = measure(settings, bench)
    assert (certificate.edge, certificate.lag_ms) == ("falling", 0.0)
    assert write(settings, certificate).parent.name == "certificates"


def measured(late):
    """The certificate of a bench whose exposures begin so many samples after their trigger, at 2500
    Hz.
    """
    settings = config.load(None, ["camera.divisor=50"])
    firsts = count(0, 100)

    def read(timeout_s):
        first = next(firsts)
        counts = [max(0, n - late) // 50 + (n >= late) for n in range(first, first + 100)]
        return SampleBlock(first, np.zeros((100, 2)), np.array(counts))

    forces = SimpleNamespace(
        name="board", counts_exposures=True, sample_rate_hz=2500.0, block_samples=100, read=read
    )
    forces.start, forces.stop, forces.backlog = lambda train: None, lambda: None, lambda: 0
    camera = SimpleNamespace(exposure_samples=25, start=lambda train: None, stop=lambda: None)
    bench = SimpleNamespace(forces=forces, camera=camera, actuator=camera)
    return measure(settings, bench)


def test_the_lag_is_told_in_milliseconds():
    certificate = measured(1)
    assert (certificate.lag_ms, certificate.jitter_ms) == pytest.approx((0.4, 0.0))


def test_exposures_that_a_run_would_take_for_late_ones_are_refused():
    with pytest.raises(DeviceError, match=r"0.8 ms after.*or lower forces\.sample_rate"):
        measured(2)


def test_a_broken_wire_is_told_by_name():
    settings, bench = bench_of('sim.faults=["exposure-wire 0"]')
    (finding,) = sync_check(settings, bench)
    assert finding.needed
    assert "counted no exposure; check the exposure wire" in finding.value


def test_a_certificate_that_can_not_be_read_is_told():
    settings, _ = bench_of()
    place(settings).parent.mkdir(parents=True)
    place(settings).write_text("{}")
    assert "cannot be read" in certificate_record(settings)[NAME]
