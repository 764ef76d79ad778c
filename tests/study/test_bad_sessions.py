"""Sessions that cannot be analysed together are refused in one sentence, before anything is
computed.
"""

import json
import shutil
from collections import namedtuple
from types import SimpleNamespace

import pytest
from command_line import call
from loads import record
from results_files import write_results
from whole_runs import done

from app.evaluation.setup import header_of
from app.replay.reanalysis import Reanalysis
from app.session.journal import journal_of
from app.session.recorder import SessionRecorder
from app.session.versions import versions
from app.settings.config import ConfigError
from app.settings.sections import Config
from app.study.analysis_plan import RECORDED, plan_analysis
from app.study.parts import Parts
from app.system.errors import UserError

SHORT = "run.travel=5", "stress.method=none"


@pytest.fixture(scope="module")
def other_bench(tmp_path_factory):
    """A short run with another lens and stiffness."""
    path = tmp_path_factory.mktemp("other") / "other.h5"
    return record(path, *SHORT, "run.normal_force=0.06", "sample.lens_radius=60")


@pytest.fixture
def refused(tmp_path):
    """The one sentence with which sessions are refused."""

    def refuse(*sessions, error=UserError, **how):
        output = how.pop("output", tmp_path / "results.h5")
        with pytest.raises(error) as caught:
            plan_analysis(list(sessions), output, **{"preset": RECORDED, **how})
        sentence = str(caught.value)
        assert "\n" not in sentence
        assert not Parts(output).folder.exists()
        return sentence

    return refuse


def test_of_different_benches(sessions, other_bench, refused):
    said = refused(sessions[0], other_bench)
    assert said.startswith("other.h5: sample.lens_radius is 60.0, in load-0.06.h5 it is 128.8;")
    assert "--set sample.lens_radius=" in said


def test_imports_whose_clocks_are_known_otherwise_go_together(sessions, tmp_path):
    """An import finds the uncertainties of the clocks of its own tables."""
    other = record(
        tmp_path / "imported.h5",
        *(*SHORT, "run.normal_force=0.07"),
        *("uncertainty.start=3.1", "uncertainty.delay=38"),
    )
    asked = ("stress.method=axisymmetric",)
    plan = plan_analysis([sessions[0], other], tmp_path / "r.h5", preset=RECORDED, overrides=asked)
    assert len(plan.tasks) == 2


def test_no_session_at_all(refused):
    """As where a pattern of file names fits none."""
    assert "no session was given" in refused()


def test_a_setting_for_all_says_what_holds(sessions, other_bench, tmp_path):
    asked = "sample.lens_radius=128.8", "stress.method=axisymmetric"
    plan = plan_analysis(
        [sessions[0], other_bench], tmp_path / "r.h5", preset=RECORDED, overrides=asked
    )
    assert len(plan.tasks) == 2


def test_the_same_session_twice(sessions, refused, tmp_path):
    copy = shutil.copy(sessions[0], tmp_path / "copy.h5")
    said = refused(sessions[0], sessions[1], tmp_path / "copy.h5")
    assert said == f"{copy}: it is the same session as {sessions[0]}; give it once"


def test_a_further_analysis(other_bench, refused, tmp_path):
    shutil.copy(other_bench, tmp_path / "a.h5")
    done(Reanalysis(tmp_path / "a.h5", tmp_path / "b.h5", pace=None))
    said = refused(tmp_path / "b.h5")
    assert said == f"{tmp_path / 'b.h5'}: it is a further analysis of a.h5; give that session"


def test_a_killed_run_says_how_to_repair_it(sessions, refused, tmp_path):
    recorder = SessionRecorder.create(tmp_path / "run.h5", header_of(Config(), versions()))
    recorder.flush()
    shutil.copy(journal_of(tmp_path / "run.h5"), journal_of(tmp_path / "killed.h5"))
    recorder.discard()
    said = refused(sessions[0], tmp_path / "killed.h5")
    assert "cut short" in said
    assert "slipscope repair" in said


def test_files_that_are_no_sessions(sessions, results, refused, tmp_path):
    (tmp_path / "notes.txt").write_text("no session")
    write_results(tmp_path / "older.h5", results)
    assert "not an HDF5 file" in refused(tmp_path / "notes.txt")
    assert "check the name" in refused(tmp_path / "missing.h5")
    assert "but not a SlipScope session" in refused(tmp_path / "older.h5")


def test_outputs_that_can_not_be_written(sessions, refused, tmp_path):
    (tmp_path / "there.h5").write_text("x")
    assert "--overwrite" in refused(sessions[0], output=tmp_path / "there.h5")
    assert "this is the session itself" in refused(sessions[0], output=sessions[0], overwrite=True)
    assert "does not exist" in refused(sessions[0], output=tmp_path / "no" / "r.h5")
    assert "the ending '.csv' is not known" in refused(sessions[0], output=tmp_path / "r.csv")


def test_a_disk_without_room(sessions, refused, monkeypatch, tmp_path):
    """It may be another one than that of the folder in which its own is."""
    room = {tmp_path: 1 << 20}
    usage = lambda folder: SimpleNamespace(free=room.get(folder, 1 << 40))  # noqa: E731
    monkeypatch.setattr(shutil, "disk_usage", usage)
    assert "1 MB are left there, about 50 MB are needed" in refused(*sessions)


def test_settings_that_can_not_be_changed(sessions, refused):
    said = refused(sessions[0], overrides=["run.travel=3"], error=ConfigError)
    assert "as it was measured" in said


def test_a_session_without_images(sessions, refused, monkeypatch):
    from app.session.reader import SessionReader

    triggers = SessionReader.triggers

    def none_received(self):
        table = triggers(self)
        table["received"] = False
        return table

    monkeypatch.setattr(SessionReader, "triggers", none_received)
    assert "there are no images in this session" in refused(sessions[0])


Said = namedtuple("Said", "code out")


def run(*arguments):
    found = call("analyze", *arguments)
    return Said(found.exit_code, found.output)


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (("--preset", "best"), 2, "--preset best: it is not known"),
        (("--dask", "tcp://127.0.0.1:9"), 2, "no scheduler answers there within"),
        (("--dask", "nowhere"), 2, "no scheduler answers there within"),
        (("--jobs", "-1"), 2, "--jobs"),
    ],
)
def test_options_that_can_not_be_used(sessions, tmp_path, options, code, said):
    found = run(sessions[0], "-o", tmp_path / "r.h5", *options)
    assert found.code == code
    assert said in found.out
    assert "Traceback" not in found.out
    assert not list(tmp_path.iterdir())


def test_errors_are_json_when_asked(tmp_path):
    found = run(tmp_path / "missing.h5", "-o", tmp_path / "r.h5", "--json")
    assert found.code == 2
    assert "check the name" in json.loads(found.out)["error"]
