"""Certificates of calibrations: from the data of a run to the settings of the next, and what is
refused.
"""

import json
import os
import zipfile
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import msgspec
import numpy as np
import pytest
from calibration.stage_speed import Speed
from cli.conftest import call
from whole_runs import done, ran

from analysis.options import Section, as_written
from app.calibrations.calibration import calibration_run
from app.calibrations.certifying import evaluated
from app.calibrations.kinds import KINDS
from app.experiment.decisions import Experiment, ExperimentFailed, MeasuredBlock
from app.runs.live import make_run, scenario
from app.settings import certificates
from app.settings.certificates import (
    CalibrationCertificate,
    CertifiedValue,
    due_calibrations,
    read_certificate,
)
from app.settings.config import altered, load, revised, values_of
from app.settings.protocol_steps import Approach, Drive, Hold, Reference
from app.system.errors import CalibrationRefused, ConfigError, UserError
from slipscope import Session

UTC_DATE = "2026-01-01T00:00:00+00:00"
SMALL = ("camera.width=64", "camera.height=64", "dic.box=20")


def certificate(**changes):
    about = {
        "what": "stiffness", "title": "stiffness of the cantilevers", "valid_days": 100,
        "made": datetime.now(UTC).isoformat(), "values": (CertifiedValue(name="k", symbol="k_N",
        value=700.0, sd=3.0, unit="N/m"),), "settings": {"forces.stiffness_normal": 700.0},
    }  # fmt: skip
    return CalibrationCertificate(**(about | changes))


def block(normal_n, *, is_moving=False):
    """What is measured at the end of a block under this normal force."""
    return MeasuredBlock(50, np.full((50, 2), (normal_n, 0.0)), 0.0, is_moving, True)


def written(path, held=None):
    statement = held if isinstance(held, bytes) else msgspec.json.encode(held or certificate())
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(certificates.STATEMENT, statement)
    return path


def naming(*paths):
    return f"calibration.certificates={json.dumps([str(path) for path in paths])}"


@pytest.fixture(scope="module")
def speed(tmp_path_factory):
    """A calibration measured on the simulated bench, evaluated and written."""
    folder = tmp_path_factory.mktemp("speed")
    calibration = Speed()
    (config,) = calibration.plan(load(None, [*SMALL, "about.operator=Ana"]), Section())
    assert done(make_run(config, folder / "speed-1.h5", pace=None)).summary is None
    found = evaluated(calibration, [folder / "speed-1.h5"], Section())
    found.write(folder / "speed.zip", overwrite=False)
    return folder


def test_a_run_without_contact_becomes_a_certificate_with_data_and_picture(speed):
    held = read_certificate(speed / "speed.zip")
    with Session(speed / "speed-1.h5") as session:
        assert held.made == session._reader.header.started
        assert abs(session.forces.normal_force_n).max() < 0.01  # nobody pressed
    assert held.bench == {"forces": "sim", "camera": "sim", "actuator": "sim"}
    assert (held.operator, held.remarks, held.what) == ("Ana", ("a remark",), "speed")
    assert list(held.sources) == ["speed-1.h5"]
    assert len(held.sources["speed-1.h5"]) == 64
    # 4.9 um/s at 0.1 N, 4.76 at 1.4 N: of the free block of a run at 0.5 N, between them
    assert 4.7 < held.settings["camera.pixel"] < 5.0
    (value,) = held.values
    assert value.value == pytest.approx(held.settings["camera.pixel"] * 1e-6)
    assert value.sd == pytest.approx(0.01 * value.value)
    with zipfile.ZipFile(speed / "speed.zip") as archive:
        assert archive.read("picture.png")[:4] == b"\x89PNG"


def test_the_data_of_a_certificate_give_the_same_again(speed):
    first = read_certificate(speed / "speed.zip")
    again = evaluated(Speed(), [speed / "speed.zip"], Section()).certificate
    assert replace_sources(again) == replace_sources(first)
    assert set(again.sources) == {"speed-1.h5", "speed.zip"}


def replace_sources(held):
    return msgspec.structs.replace(held, sources={})


def test_a_certificate_of_another_calibration_is_not_evaluated(speed):
    class Other(Speed):
        name = "other"

    with pytest.raises(UserError, match="is a certificate of the calibration 'speed'; give one of"):
        evaluated(Other(), [speed / "speed.zip"], Section())


@pytest.mark.parametrize(
    ("what", "changed"),
    [
        ("roughness", {"pitch": 2e-6}),
        ("roughness", {"scale": 2e-6}),
        ("camera", {"top": 4095.0}),
        ("pattern", {"top": 4095.0}),
        ("pattern", {"pictures": 30}),
        ("compliance", {"region": ("inside 1 1 9 1 9 9",)}),
        ("compliance", {"channel": "temperature"}),
        ("timing", {"camera_clock": True}),
        ("timing", {"common_signal": True}),
    ],
)
def test_data_of_a_certificate_do_not_follow_options_of_their_files(tmp_path, what, changed):
    kind, (name,) = KINDS[what], changed
    path = written(tmp_path / "a.zip", certificate(what=what, options=as_written(kind.Options())))
    with pytest.raises(UserError, match=rf"another {name.replace('_', ' ')}; give the files"):
        evaluated(kind, [path], kind.Options(**changed))
    same = written(
        tmp_path / "b.zip", certificate(what=what, options=as_written(kind.Options(**changed)))
    )
    for options, given in ((kind.Options(**changed), [name]), (kind.Options(), [])):
        with pytest.raises(UserError, match="data of the certificate cannot be read"):
            evaluated(kind, [same], options, given)


def test_data_that_cannot_be_trusted_give_no_certificate(tmp_path):
    class Still(Speed):
        def gather(self, sources, options):
            return {"time_s": np.arange(9.0), "position_m": np.zeros(9)}

    with pytest.raises(CalibrationRefused, match="speed: the stage was to move, it stood still"):
        evaluated(Still(), [], Section())


def test_a_certificate_without_the_data_of_its_calibration_is_named(speed, tmp_path):
    class Further(Speed):
        def fit(self, data, options):
            return super().fit({"time_s": data["seconds"]}, options)

    with pytest.raises(UserError, match=r"speed.zip: its data are not those .*'seconds'"):
        evaluated(Further(), [speed / "speed.zip"], Section())
    broken = tmp_path / "broken.zip"
    with zipfile.ZipFile(speed / "speed.zip") as held, zipfile.ZipFile(broken, "w") as new:
        new.writestr("certificate.json", held.read("certificate.json"))
        new.writestr("data.npz", held.read("data.npz")[:200])
    with pytest.raises(UserError, match="the data of the certificate cannot be read"):
        evaluated(Speed(), [broken], Section())


@pytest.mark.parametrize("speed", [-4.0, 0.0, 1e7, np.nan, np.inf])
def test_a_setting_that_cannot_be_one_makes_no_certificate(speed):
    class Odd(Speed):
        def gather(self, sources, options):
            return {"time_s": np.arange(9.0), "position_m": np.arange(9.0) * 5e-6}

        def fit(self, data, options):
            return replace(super().fit(data, options), settings={"camera.pixel": speed})

    refused = r"speed: what comes out cannot be a setting: camera\.pixel"
    with pytest.raises(CalibrationRefused, match=refused):
        evaluated(Odd(), [], Section())


def test_settings_take_what_their_certificates_say(tmp_path):
    path = written(tmp_path / "k.zip")
    assert load(None, [naming(path)]).forces.stiffness_normal == 700.0
    bench = tmp_path / "bench.toml"
    bench.write_text('[calibration]\ncertificates = ["k.zip"]\n', encoding="utf-8")
    config = load(bench)  # a name beside the settings file
    assert config.forces.stiffness_normal == 700.0
    assert config.calibration.certificates == (str(path),)


def test_a_setting_is_in_the_unit_of_the_settings_file(tmp_path):
    follows = {"sample.young_modulus": 3.5, "uncertainty.young_modulus": 1.5}
    path = written(tmp_path / "e.zip", certificate(settings=follows))
    config = load(None, [naming(path)])
    assert config.sample.young_modulus == 3.5e6
    assert config.uncertainty.young_modulus == pytest.approx(0.015)


def test_two_values_of_one_setting_are_refused(tmp_path):
    one = written(tmp_path / "one.zip")
    other = written(tmp_path / "other.zip",
                    certificate(settings={"forces.stiffness_normal": 690.0}))  # fmt: skip
    with pytest.raises(ConfigError, match=r"is 689 by the settings and 700.0 by the certificate"):
        load(None, [naming(one), "forces.stiffness_normal=689"])
    with pytest.raises(ConfigError, match=r"is 700.0 by one.zip and 690.0 by the certificate"):
        load(None, [naming(one, other)])
    same = load(None, [naming(one), "forces.stiffness_normal=700"])
    assert same.forces.stiffness_normal == 700.0


@pytest.mark.parametrize(
    "key", ["forces.stifness", "limits.shear_force", "actuator.max_velocity", "run.velocity"]
)
def test_a_certificate_sets_what_a_calibration_finds_and_nothing_else(tmp_path, key):
    statement = msgspec.json.encode(certificate()).replace(b"forces.stiffness_normal", key.encode())
    with pytest.raises(ConfigError, match=rf"it sets {key} to 700.0, which none may set"):
        load(None, [naming(written(tmp_path / "a.zip", statement))])


def test_a_certificate_of_an_impossible_setting_is_refused(tmp_path):
    negative = written(tmp_path / "b.zip", certificate(settings={"forces.stiffness_shear": -1.0}))
    with pytest.raises(ConfigError, match=r"forces\.stiffness_shear must be a number more than 0"):
        load(None, [naming(negative)])


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{}",
        b"[1, 2]",
        b'{"what": 3}',
        msgspec.json.encode(certificate()).replace(b'"format":1', b'"format":2'),
        msgspec.json.encode(certificate()).replace(b'"valid_days":100', b'"valid_days":0'),
        msgspec.json.encode(certificate(made=UTC_DATE)).replace(b"+00:00", b""),
        msgspec.json.encode(certificate(made=UTC_DATE)).replace(UTC_DATE.encode(), b"yesterday"),
        msgspec.json.encode(certificate(remarks=("x" * (1 << 20),))),
        b"[" * 100000,
        msgspec.json.encode(certificate()).replace(b"700.0}", b'"evil:Class"}'),
        msgspec.json.encode(certificate()).replace(b"700.0}", b"[1, [null]]}"),
        msgspec.json.encode(certificate()).replace(b"700.0}", b"1e999}"),
    ],
    ids=["empty", "nothing", "list", "number", "later", "never valid", "no offset", "no date",
         "long", "deep", "code", "null", "infinite"],
)  # fmt: skip
def test_what_is_no_certificate_is_refused(tmp_path, content):
    path = written(tmp_path / "c.zip", content) if content else tmp_path / "c.zip"
    if not content:
        path.write_bytes(b"")
    with pytest.raises(ConfigError, match="cannot be read as a certificate of a calibration"):
        load(None, [naming(path)])


def test_a_missing_certificate_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"gone.zip: it cannot be read .* No such file"):
        load(None, [naming(tmp_path / "gone.zip")])


def test_an_old_calibration_is_due(tmp_path):
    made = datetime.now(UTC) - timedelta(days=100, hours=1)
    other = {"forces": "ni", "camera": "basler", "actuator": "sim"}
    old = written(tmp_path / "old.zip", certificate(made=made.isoformat(), bench=other))
    fresh = written(
        tmp_path / "fresh.zip", certificate(made=(made + timedelta(days=1)).isoformat())
    )
    assert due_calibrations(load(None, [naming(fresh)])) == ""
    sentence = due_calibrations(load(None, [naming(old)]))
    due = (made + timedelta(days=100)).date().isoformat()
    assert sentence == f"calibrations: old.zip (`slipscope calibrate stiffness`) was due on {due}"
    listed = call("calibrate", "list", "--set", naming(old), "--json")
    assert json.loads(listed.stdout)[str(old)]["due"] == due
    checked = call("check", "--set", naming(old))
    assert "look   calibration stiffness: old.zip, 100 days old" in checked.stdout
    assert "old.zip is of forces.source = ni, this bench has sim; calibrate" in checked.stdout
    assert "camera.source = basler" not in checked.stdout  # of which it sets nothing


def test_a_calibration_from_the_future_is_due(tmp_path):
    """A clock that was set back, or began anew in 1970, made every calibration fresh."""
    made = datetime.now(UTC) + timedelta(days=2)
    ahead = written(tmp_path / "ahead.zip", certificate(made=made.isoformat()))
    assert due_calibrations(load(None, [naming(ahead)])) == (
        f"calibrations: ahead.zip (`slipscope calibrate stiffness`) was made on {made.isoformat()},"
        " which has not come yet: check the clocks of this computer and of the one that made it"
    )


def test_a_session_keeps_what_the_certificates_of_its_bench_say(tmp_path):
    path = written(tmp_path / "k.zip")
    config = load(None, [*SMALL, naming(path), "run.travel=5", "run.background_time=0"])
    run = ran(config, tmp_path / "run.h5")
    path.unlink()
    with Session(run) as session:
        kept = json.loads(session.versions["calibration: k.zip"])
        assert kept["values"][0]["value"] == 700.0
        assert session.settings["forces"]["stiffness_normal"] == 700.0
    # its analysis needs no file of the bench, and may take another value
    assert revised(config, ["forces.stiffness_normal=690"]).forces.stiffness_normal == 690.0


def test_two_certificates_of_one_name_are_both_kept(tmp_path):
    for folder, key in (("a", "forces.stiffness_normal"), ("b", "forces.stiffness_shear")):
        (tmp_path / folder).mkdir()
        written(tmp_path / folder / "c.zip", certificate(settings={key: 700.0}))
    config = load(None, [naming(tmp_path / "a" / "c.zip", tmp_path / "b" / "c.zip")])
    assert (config.forces.stiffness_normal, config.forces.stiffness_shear) == (700.0, 700.0)
    assert len(certificates.certificates_of(config)) == 2
    assert len(certificates.calibration_records(config)) == 2


def test_a_certificate_that_was_replaced_since_is_not_recorded(tmp_path):
    config = load(None, [naming(path := written(tmp_path / "k.zip"))])
    assert certificates.calibration_records(config)
    written(path, certificate(settings={"forces.stiffness_normal": 701.0}))
    with pytest.raises(ConfigError, match=r"has changed since .* is 700.0 in them and 701.0 in"):
        certificates.calibration_records(config)


def test_a_form_that_is_edited_does_not_wait_for_the_disk(tmp_path):
    config = load(None, [naming(path := written(tmp_path / "k.zip"))])
    path.unlink()
    changed = altered(values_of(config), [("run", "travel", 50)], "form", None)
    assert changed.run.travel == pytest.approx(50e-6)
    assert changed.forces.stiffness_normal == 700.0


def test_several_files_where_one_is_evaluated_are_refused(speed):
    class One(Speed):
        takes_several = False

    with pytest.raises(UserError, match="2 files found; give one file"):
        evaluated(One(), 2 * [speed / "speed-1.h5"], Section())
    with pytest.raises(UserError, match="2 files found; give one certificate"):
        evaluated(Speed(), [speed / "speed-1.h5", speed / "speed.zip"], Section())


def test_the_data_are_as_old_as_the_oldest_file(speed, tmp_path):
    class Tables(Speed):
        def gather(self, sources, options):
            return {"time_s": np.arange(9.0), "position_m": np.arange(9.0) * 5e-6}

    old, new = tmp_path / "old.csv", tmp_path / "new.csv"
    for path, seconds in ((new, 2e9), (old, 1e9)):
        path.write_text("1")
        os.utime(path, (seconds, seconds))
    made = evaluated(Tables(), [new, old], Section()).certificate.made
    assert datetime.fromisoformat(made).timestamp() == 1e9


def test_a_certificate_of_a_session_and_a_picture_names_the_bench_of_the_session(speed, tmp_path):
    picture = tmp_path / "before.png"
    picture.write_text("1")
    os.utime(picture, (1e9, 1e9))
    held = evaluated(Speed(), [speed / "speed-1.h5", picture], Section()).certificate
    assert datetime.fromisoformat(held.made).timestamp() == 1e9
    assert (held.bench["camera"], held.operator) == ("sim", "Ana")


def test_a_recorded_run_is_analysed_with_a_later_certificate(tmp_path):
    recorded = load(None, [naming(written(tmp_path / "early.zip"))])
    later = written(
        tmp_path / "later.zip",
        certificate(settings={"forces.stiffness_normal": 705.0, "uncertainty.coupling": 0.05}),
    )
    new = revised(recorded, [naming(later)])
    assert new.forces.stiffness_normal == 705.0
    assert new.uncertainty.coupling == pytest.approx(5e-4)
    with pytest.raises(ConfigError, match=r"is 690 by the settings and 705.0 by the certificate"):
        revised(recorded, [naming(later), "forces.stiffness_normal=690"])


def test_nobody_presses_where_no_step_approaches():
    config = load(None, SMALL)
    free = calibration_run(config, [Reference(), Drive(travel=1e-6)])
    pressed = calibration_run(config, [Approach(), Hold(time=1.0)])
    assert scenario(free).press_sample > 1e7
    assert scenario(pressed).press_sample == scenario(config).press_sample


def test_a_block_that_is_pressed_is_not_moved_as_a_free_one():
    config = calibration_run(load(None, SMALL), [Reference(), Drive(travel=1e-6)])
    assert [step.kind for step in config.run.steps] == ["background", "reference", "drive"]
    experiment = Experiment(config)
    with pytest.raises(ExperimentFailed, match=r"the normal force reads 0.030 N .* lift it$"):
        experiment.advance(block(0.03))


def test_a_block_that_comes_to_touch_is_not_moved_on():
    config = calibration_run(load(None, SMALL), [Reference(), Drive(travel=1e-6)])
    experiment = Experiment(config)
    experiment.begin_drive(block(0.0))
    experiment.advance(block(0.02, is_moving=True))
    with pytest.raises(ExperimentFailed, match=r"^drive: the normal force reads 0.030 N"):
        experiment.advance(block(0.03, is_moving=True))


def test_an_experiment_still_needs_contact_and_drive():
    config = load(None, SMALL)
    with pytest.raises(ValueError, match="comes before the contact is made"):
        replace(config, run=replace(config.run, steps=(Reference(), Drive(travel=1e-6))))
    with pytest.raises(ValueError, match="no step moves the stage"):
        replace(config, run=replace(config.run, steps=(Approach(), Hold(time=1.0))))
    with pytest.raises(ValueError, match="moves the stage before the reference"):
        calibration_run(config, [Drive(travel=1e-6)])
    with pytest.raises(ValueError, match="comes before the contact is made"):
        calibration_run(config, [Reference(), Approach(), Hold(time=1.0)])
