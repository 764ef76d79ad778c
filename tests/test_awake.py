"""The computer is kept awake while a bench is under way, and the log says whether it is."""

import logging
import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
import wakepy
from short_run import SHORT
from whole_runs import done

from app.cli.campaign import CampaignWork
from app.runs import live
from app.settings import config
from app.system import awake
from app.system.awake import kept_awake

QUICK = (*SHORT, "stress.method=none", "run.travel=2", "limits.age=10")


@pytest.fixture
def desktop(monkeypatch):
    """A desktop that can be asked to stay awake, as far as the library knows."""
    monkeypatch.setenv("WAKEPY_FAKE_SUCCESS", "1")


@pytest.mark.parametrize("pace", [20.0, None])
def test_a_bench_in_real_time_keeps_the_computer_awake(desktop, tmp_path, pace):
    run, held = live.make_run(config.load(None, list(QUICK)), tmp_path / "a.h5", pace=pace), set()
    advance = run._experiment.advance

    def seen(measured):
        held.add(len(wakepy.global_modes()))
        return advance(measured)

    run._experiment.advance = seen
    done(run)
    assert held == {int(pace is not None)}
    assert not wakepy.global_modes()
    log = (tmp_path / "a.h5.log").read_text(encoding="utf-8")
    assert log.count("the computer is kept awake by") == int(pace is not None)


def test_a_campaign_keeps_it_awake_between_its_runs(desktop, monkeypatch):
    held, work = [], CampaignWork.__new__(CampaignWork)
    monkeypatch.setattr(work, "_is_passed", lambda _: held.append(len(wakepy.global_modes())) or 1)
    monkeypatch.setattr(work, "_write_page", lambda: None)
    work.go_through([None, None])
    assert held == [1, 1]
    assert not wakepy.global_modes()


def test_where_no_desktop_can_be_asked_the_log_says_so(monkeypatch, caplog):
    monkeypatch.setenv("WAKEPY_FORCE_FAILURE", "1")
    with caplog.at_level(logging.INFO, "app"), kept_awake():
        assert not any(mode.active for mode in wakepy.global_modes())
    assert "the computer is not kept awake" in caplog.text


def test_a_desktop_that_does_not_answer_holds_nothing_up(monkeypatch):
    answers = threading.Event()

    @contextmanager
    def slow(**_):
        answers.wait(20)
        yield SimpleNamespace(active=False)

    monkeypatch.setattr(awake, "ANSWERS_S", 0.1)
    monkeypatch.setattr(wakepy.keep, "running", slow)
    began = time.monotonic()
    with awake.kept_awake():
        waited_s = time.monotonic() - began
        answers.set()
    assert waited_s < 15
