"""The three verdicts of a replay: to the bit, within the uncertainty on another processor, and
different; and what it says of both processors.
"""

import json
import platform
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from python_program import python
from session_material import make_snapshot
from short_run import SHORT
from whole_runs import recorded

from app.replay.comparison import Comparison, processor_of
from app.session.layout import FORMAT_VERSION
from app.session.versions import processor, versions


def compared(*pairs):
    comparison = Comparison()
    recorded, replayed = zip(*pairs, strict=True)
    session = SimpleNamespace(
        snapshots=lambda: iter(recorded),
        format=FORMAT_VERSION,
        header=SimpleNamespace(versions={"processor": "an abacus"}),
    )
    comparison.begin(session)
    for snapshot in replayed:
        comparison.append(snapshot)
    return comparison


def shifted(snapshot, **planes):
    """The snapshot with other planes of its field."""
    return replace(snapshot, field=replace(snapshot.field, **planes))


@pytest.fixture
def snapshot():
    made = make_snapshot(3)
    errors = np.full_like(made.field.ux_px, 0.01)
    return shifted(made, ux_std_px=errors, uy_std_px=errors)


def test_the_same_agrees_to_the_bit(snapshot):
    comparison = compared((snapshot, snapshot))
    assert (comparison.verdict, comparison.agrees) == ("agrees to the bit", True)
    assert comparison.largest_difference == comparison.first_difference == ""


def test_what_another_processor_rounds_agrees_within_the_uncertainty(snapshot):
    ux, uy = snapshot.field.ux_px.copy(), snapshot.field.uy_px.copy()
    ux[0, 0] = np.nextafter(ux[0, 0], np.float32(9))
    uy[1, 1] += 2e-4
    comparison = compared((snapshot, snapshot), (snapshot, shifted(snapshot, ux_px=ux, uy_px=uy)))
    assert comparison.verdict == "agrees within 0.02 of the uncertainty"
    assert comparison.agrees
    assert not comparison.all_identical
    assert comparison.first_difference == "frame 3: fields/ux"
    assert comparison.largest_difference == "0.0002 px in fields/uy of frame 3"
    assert comparison.recorded_on == "an abacus"
    assert comparison.replayed_on == processor_of(versions())


@pytest.mark.parametrize("change", ["far", "missing", "status", "radius"])
def test_more_than_rounding_differs(snapshot, change):
    ux, status = snapshot.field.ux_px.copy(), snapshot.field.status.copy()
    if change == "far":
        ux[0, 0] += 2e-3
    elif change == "missing":
        ux[0, 0] = np.nan
    elif change == "status":
        status[0, 0] += 1
    other = shifted(snapshot, ux_px=ux, status=status)
    if change == "radius":  # which has no uncertainty of its own
        other = replace(
            other, stick=replace(other.stick, full_slip_pa=2 * other.stick.full_slip_pa)
        )
    comparison = compared((snapshot, snapshot), (snapshot, other))
    assert (comparison.verdict, comparison.agrees) == ("differs", False)


def test_a_session_says_on_what_it_was_computed():
    held = versions()
    assert all(held[name] for name in processor())
    assert held["instructions"] in processor_of(held)
    assert processor_of({}) == "an unknown processor"


BLAS = {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "X86_V3 AVX2"}
NUMBA = {"NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": ""}  # all is compiled again


@pytest.mark.slow
@pytest.mark.parametrize(
    ("other", "named"),
    [(BLAS, ""), pytest.param(NUMBA, "x86-64-v2", marks=pytest.mark.long)],
    ids=["numpy", "numba"],
)
def test_a_replay_on_another_processor_says_how_far_it_agrees(tmp_path, other, named):
    """Of another generation, as these libraries would see it: no fused multiplication, narrower
    vectors. A thread that outlived the replay would bring the interpreter down at its end.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return
    recorded(tmp_path / "a.h5", *SHORT, "run.travel=4", "dic.threads=1")
    (tmp_path / "a.png").write_bytes(b"mine")  # which it would take its time to draw
    words = ("replay", "a.h5", "--headless", "--json")
    done = python("-m", "app", *words, cwd=tmp_path, environment=other, timeout=500)
    assert (done.returncode, done.stderr) == (0, "")
    said = json.loads(done.stdout)["comparison"]
    assert said["verdict"].startswith("agrees within ")
    assert 0 < said["uncertainty_share"] < 0.1
    assert said["identical"] < said["frames"]
    assert said["recorded_on"] != said["replayed_on"]
    assert named in said["replayed_on"]


@pytest.mark.parametrize("has_them", [True, False])
def test_the_same_instructions_can_be_asked_of_all_processors(has_them):
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return
    code = (
        "from llvmlite import binding\n"
        "names = 'avx2', 'fma', 'avx512f'\n"
        f"binding.get_host_cpu_features = lambda: dict.fromkeys(names, {has_them})\n"
        "from app.cli.target import same_everywhere\n"
        "same_everywhere()\n"
        "from app.session.versions import versions\n"
        "print(versions()['instructions'])"
    )
    done = python("-c", code)
    if has_them:
        assert done.stdout.startswith("x86-64-v3; numpy "), done.stderr
        assert "AVX512" not in done.stdout
        assert "X86_V4" not in done.stdout
    else:
        assert "--reproducible: it computes with the instructions of x86-64-v3" in done.stderr
