"""What each command does when all is well."""

from __future__ import annotations

import inspect
import json
import signal
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from command_line import given
from PIL import Image
from scipy.ndimage import gaussian_filter
from short_run import SHORT, without_budget, without_pictures
from typer.testing import Result

from analysis.dic import Correlation
from analysis.options import as_written
from app.cli import file_commands as cli_files, run_and_replay as experiment
from app.processes import bench_client, urgent
from app.processes.folder import RunningBench
from app.records.bench_view import Health
from app.records.record_types import Counts, End, Outcome
from app.records.run_view import RunView
from app.settings.config import to_toml
from app.settings.sections import Config
from app.system.stopping import StopAnswer, at_rest, failed, not_connected, sent_to, unread

Command = Callable[..., Result]


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs and replays without their pictures."""
    without_pictures(monkeypatch)


@pytest.fixture
def cheap(undrawn: None) -> Iterator[None]:
    """And summaries without the shares of the inputs."""
    with without_budget():
        yield


def test_a_run_ends_with_a_session_a_picture_and_its_numbers(recorded: tuple[Path, Result]) -> None:
    session, result = recorded
    data = json.loads(result.stdout)
    assert (data["state"], data["session"], data["picture"]) == (
        "done",
        str(session),
        str(session.with_suffix(".png")),
    )
    assert session.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    counts = data["counts"]
    assert (
        counts["frames_received"]
        == counts["frames_recorded"]
        == counts["triggers"] - counts["frames_lost"]
        > 30
    )
    assert counts["samples_lost"] == counts["frames_lost"] == 0
    # the simulated interface has mu = 0.93 and P = 0.03 N
    assert data["summary"]["mu_d"] == pytest.approx(0.93, rel=0.02)
    assert data["summary"]["static_force_n"] == pytest.approx(0.0279, rel=0.02)
    assert data["resources"]["peak_memory_mib"] > 10
    assert result.stderr == ""


def test_a_run_without_a_display_says_why_and_goes_on(
    slipscope: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "app.system.display.display_problem", lambda: "no window: there is no screen"
    )
    settings = ["--set", "camera.source=nothing"]  # ends it before it begins
    assert slipscope("run", *settings).exit_code == 2
    assert experiment.window_problem(headless=False) == "no window: there is no screen"
    assert experiment.window_problem(headless=True) == ""
    opened = slipscope()
    assert (opened.exit_code, list(tmp_path.iterdir())) == (2, [])
    assert opened.stderr.startswith("slipscope: no window: there is no screen")


@pytest.mark.usefixtures("cheap")
def test_a_replay_that_differs_fails_and_says_by_how_much(
    slipscope: Command, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.evaluation.pipeline.CENTRE_SHARE", 0.9)
    result = slipscope("replay", session, "--headless")
    assert result.exit_code == 1, result.output
    assert "the replay differs: " in result.stdout
    assert " m in results/centre_ux of frame " in result.stdout
    assert "recorded on: " in result.stdout


@pytest.mark.usefixtures("undrawn")
def test_replay_gives_the_recorded_results_to_the_bit_and_leaves_the_session_alone(
    slipscope: Command, session: Path
) -> None:
    before = session.read_bytes()
    result = slipscope("replay", session, "--headless", "--json")
    data = json.loads(result.stdout)
    assert result.exit_code == 0, result.output
    compared = data["comparison"]
    assert compared["frames"] == compared["identical"] > 30
    assert compared["verdict"] == "agrees to the bit"
    assert compared["recorded_on"] == compared["replayed_on"]
    assert session.read_bytes() == before
    assert Path(data["picture"]).name == "session.png"


@pytest.mark.usefixtures("cheap")
def test_replay_keeps_a_picture_that_exists(slipscope: Command, session: Path) -> None:
    picture = session.with_suffix(".png")
    picture.write_bytes(b"mine")
    result = slipscope("replay", session, "--headless")
    assert (result.exit_code, picture.read_bytes()) == (0, b"mine")
    assert "frames gave the recorded results to the bit" in result.stdout


@pytest.mark.usefixtures("cheap")
def test_replay_with_another_setting_makes_a_second_file_and_replays_it(
    slipscope: Command, session: Path
) -> None:
    before = session.read_bytes()
    result = slipscope("replay", session, "--headless", "--set", "dic.box=26")
    made = session.with_name("session-analysis.h5")
    assert result.exit_code == 0, result.output
    assert f"session: {made}" in result.stdout
    assert "->" in result.stdout  # the session's results, and the new ones
    assert (session.read_bytes(), made.with_suffix(".png").exists()) == (before, True)
    again = json.loads(slipscope("replay", made, "--headless", "--json").stdout)
    assert again["comparison"]["frames"] == again["comparison"]["identical"] > 30
    data = json.loads(
        slipscope("replay", session, "--headless", "--set", "dic.box=26", "--json").stdout
    )
    assert (Path(data["session"]).name, Path(data["source"]).name) == (
        "session-analysis-2.h5",
        "session.h5",
    )
    assert data["summary"] == again["summary"]
    info = slipscope("info", session, "--verify", "--json")
    assert (info.exit_code, json.loads(info.stdout)["analyses"]) == (
        0,
        ["session-analysis-2.h5", "session-analysis.h5"],
    )
    assert ", in session.h5" in slipscope("info", made).stdout
    assert data["recorded"]["normal_force_n"] == data["summary"]["normal_force_n"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--set", "run.travel=9"), "run.travel is 22.0 in the session, as it was measured"),
        (("--set", "dic.bocks=9"), "unknown key 'dic.bocks'"),
        (("-o", "session.h5"), "this is the session itself, which is never changed"),
        (("-o", "session.png"), "the name of a session ends in .h5, '.png' was asked"),
        (("-o", "session.h5", "--overwrite"), "this is the session itself, which is never changed"),
        (("-o", "no/such/folder.h5"), "does not exist"),
    ],
)
def test_what_a_replay_can_not_do_is_said_before_it_begins(
    slipscope: Command, session: Path, options: tuple[str, ...], sentence: str
) -> None:
    before = session.read_bytes()
    result = slipscope("replay", session, "--headless", *options)
    assert (result.exit_code, result.stdout) == (2, "")
    assert sentence in result.stderr
    assert session.read_bytes() == before


def test_info_tells_what_the_session_holds(
    slipscope: Command, session: Path, recorded: tuple[Path, Result]
) -> None:
    data = json.loads(slipscope("info", session, "--json").stdout)
    ran = json.loads(recorded[1].stdout)
    assert data["counts"] == ran["counts"]
    assert data["summary"] == ran["summary"]
    assert [phase["phase"] for phase in data["phases"]] == [
        "background",
        "contact",
        "reference",
        "drive",
        "end",
    ]
    assert data["changed_settings"]["run.normal_force"] == 0.03
    assert "run.velocity" not in data["changed_settings"]
    text = slipscope("info", session).stdout
    for words in ("mu_s", "run.normal_force", "drive at", "0 lost"):
        assert words in text


@pytest.mark.slow
@pytest.mark.usefixtures("cheap")
def test_what_the_operator_says_is_in_the_report_of_a_run_and_in_info(slipscope: Command) -> None:
    said = {"sample": "PDMS-7", "operator": "Élise", "note": "dusty\tglass"}
    about = (f"about.{name}={text}" for name, text in said.items())
    settings = given(*SHORT, "run.travel=8", "camera.divisor=250", *about)
    ran = slipscope("run", "--headless", "--pace", "max", "-o", "a.h5", *settings)
    assert ran.exit_code == 0
    text = slipscope("info", "a.h5").stdout
    for words in ("PDMS-7", "Élise", "dusty"):
        assert words in ran.stdout
        assert words in text
    assert json.loads(slipscope("info", "a.h5", "--json").stdout)["about"] == said
    with h5py.File("a.h5") as file:
        held = [file[f"entry/{p}"] for p in ("sample/name", "user/name", "notes/description")]
        assert [dataset.asstr()[()] for dataset in held] == list(said.values())
        kinds = [dataset.parent.attrs["NX_class"] for dataset in held]
    assert kinds == ["NXsample", "NXuser", "NXnote"]


def test_config_prints_the_settings_file(slipscope: Command) -> None:
    result = slipscope("config")
    assert result.stdout == to_toml(Config())
    assert tomllib.loads(result.stdout)["run"]["normal_force"] == 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        [],
        ["run"],
        ["replay"],
        ["info"],
        ["dic"],
        ["tradeoff"],
        ["attach"],
        ["stop"],
        ["config"],
        ["check"],
        ["cameras"],
        ["doctor"],
    ],
)
def test_every_command_explains_itself(slipscope: Command, command: list[str]) -> None:
    result = slipscope(*command, "--help")
    assert result.exit_code == 0
    assert "Usage:" in result.stdout


class Interrupted:
    """A source that is interrupted `patience` times while the terminal waits for it, and ends an
    instant later.
    """

    stays = False

    def __init__(self, patience: int, number: int = signal.SIGINT) -> None:
        self.calls: list[str] = []
        self._patience, self._number = patience, number
        self._waits = 0

    def start(self) -> None:
        self.calls.append("start")

    def wait(self, timeout: float | None = None) -> Outcome | None:
        del timeout
        if self._patience:
            self._patience -= 1
            before = len(self.calls)
            signal.raise_signal(self._number)
            give_up = time.monotonic() + 30
            while len(self.calls) == before and time.monotonic() < give_up:
                time.sleep(0.001)
            return None
        self._waits += 1
        return self.outcome() if self._waits > 3 else None

    def request_stop(self, reason: str) -> None:
        self.calls.append(reason)

    def stop_motion(self) -> StopAnswer:
        self.calls.append("stop motion")
        return failed("stage X: no answer")

    def stop_answer(self) -> StopAnswer | None:
        return sent_to("stage X") if len(self.calls) > 1 else None

    def health(self) -> Health:
        return Health("running", "", "drive", Counts(), 0, 4, 0, 0, 0.5)

    def outcome(self) -> Outcome | None:
        return Outcome(End.COMPLETE, "", Counts(), None)

    def look(self) -> RunView:
        return RunView(self.health(), self.outcome(), self.stop_answer())


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("SIGINT", "Ctrl-C was pressed"),
        ("SIGTERM", "the program received the signal to end"),
        ("SIGHUP", "the terminal was closed"),
    ],
)
def test_one_interrupt_stops_in_good_order(name: str, reason: str) -> None:
    if not hasattr(signal, name):
        pytest.skip("no such signal here")
    number, signals = getattr(signal, name), []
    source, former = Interrupted(1, number), signal.signal(number, lambda *_: None)
    try:
        assert experiment._follow(source, True, signals).state == "done"
    finally:
        signal.signal(number, former)
    assert source.calls == ["start", reason]
    assert signals == [reason]


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signal here")
def test_a_closed_terminal_stops_no_run_that_nohup_has_begun() -> None:
    former, signals = signal.signal(signal.SIGHUP, signal.SIG_IGN), list[str]()
    source = Interrupted(0)
    source.start = lambda: signal.raise_signal(signal.SIGHUP)  # type: ignore[method-assign]
    try:
        assert experiment._follow(source, True, signals).state == "done"
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, former)
    assert (source.calls, signals) == ([], [])


def test_a_second_interrupt_stops_the_motion_again_and_leaves() -> None:
    source = Interrupted(2)
    with pytest.raises(KeyboardInterrupt):
        experiment._follow(source, True, [])
    assert source.calls == ["start", *["Ctrl-C was pressed"] * 2, "stop motion"]


def test_the_terminal_tells_what_became_of_each_stop(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(KeyboardInterrupt):
        experiment._follow(Interrupted(2), True, [])
    said = capsys.readouterr().err
    sent = "STOP MOTION was sent to the stage X"
    assert sent in said
    assert "STOP MOTION FAILED, cut the actuator's power: stage X: no answer" in said
    assert said.index(sent) < said.index("FAILED")


class Attached:
    """The connection to a run in another process whose stage comes to rest, or does not, after a
    while.
    """

    def __init__(self, *answers: StopAnswer) -> None:
        self.answers = list(answers)

    def __call__(self, method: str) -> StopAnswer:
        assert method in {"stop_motion", "stop_answer"}
        return self.answers.pop(0)


@pytest.mark.parametrize(
    ("answers", "code"),
    [
        ([sent_to("stage X"), at_rest("stage X", 12.5e-3)], 0),
        ([sent_to("stage X"), unread("stage X", "no answer")], 0),
        ([sent_to("stage X"), failed("stage X: it moves")], 1),
        ([not_connected("the run has ended and its bench is closed")], 0),
    ],
)
def test_slipscope_stop_says_what_became_of_it(
    slipscope: Command, monkeypatch: pytest.MonkeyPatch, answers: list[StopAnswer], code: int
) -> None:
    bench = RunningBench("one", "bench X", "/data/a.h5", "", "", 1, 0.0)
    monkeypatch.setattr(bench_client, "Caller", lambda address, key: Attached(*answers))
    monkeypatch.setattr(urgent, "reachable", lambda: [bench])
    monkeypatch.setattr(urgent, "running_as", lambda name, who: bench)
    result = slipscope("stop")
    assert result.exit_code == code
    assert answers[-1].sentence in " ".join(result.stderr.split())


def save_texture(folder: Path, suffix: str, kind: type[np.integer], grey: int) -> None:
    """Two pictures: ``a`` and, two pixels further, ``b``."""
    texture = gaussian_filter(np.random.default_rng(3).normal(size=(80, 100)), 1.2, mode="wrap")
    reference = np.clip(grey * (1 + 0.7 * texture / texture.std()), 0, 2 * grey).astype(kind)
    for name, image in (("a", reference), ("b", np.roll(reference, 2, axis=1))):
        Image.fromarray(image).save(folder / f"{name}{suffix}")


def test_dic_writes_the_fields_of_plain_image_files(slipscope: Command, tmp_path: Path) -> None:
    save_texture(tmp_path, ".png", np.uint8, 100)
    result = slipscope("dic", "a.png", "b.png", "-o", "f.csv", "--search", "4")
    assert result.exit_code == 0, result.output
    assert ": frame 1, " in result.stdout
    header, *lines = (tmp_path / "f.csv").read_text(encoding="utf-8").splitlines()
    assert header.startswith("frame,x_px,y_px,ux_px,uy_px,status")
    ux = [float(line.split(",")[3]) for line in lines if line.split(",")[5] == "ok"]
    assert np.median(ux) == pytest.approx(2.0, abs=0.05)


def test_dic_takes_every_setting_of_the_correlation(slipscope: Command, tmp_path: Path) -> None:
    """The defaults of the options are those of the settings file, and what is given arrives in the
    record.
    """
    callback = next(c.callback for c in cli_files.app.registered_commands if c.name == "dic")
    parameters = inspect.signature(callback).parameters
    assert {name: parameters[name].default for name in as_written(Correlation())} == as_written(
        Correlation()
    )
    save_texture(tmp_path, ".tif", np.uint16, 2000)
    Image.fromarray(np.pad(np.full((60, 80), 255, np.uint8), 10)).save(tmp_path / "m.png")
    given = {
        "method": "icgn",
        "box": 16,
        "step": 8,
        "order": 1,
        "tolerance": 0.01,
        "search": 4,
        "min_correlation": 0.6,
        "min_contrast": 3.0,
        "max_saturated": 0.1,
        "full_scale": 4095,
        "update_every": 7,
        "update_below": 0.7,
        "threads": 1,
    }
    options = [
        part for name, value in given.items() for part in ("--" + name.replace("_", "-"), value)
    ]
    result = slipscope(
        "dic", "a.tif", "b.tif", "-o", "f.npz", *options, "--mask", "m.png", "--roi", 20, 20, 80, 60
    )
    assert result.exit_code == 0, result.output
    with np.load(tmp_path / "f.npz", allow_pickle=False) as file:
        record = dict(file["settings"].tolist())
        assert record.items() >= {name: str(value) for name, value in given.items()}.items()
        assert (record["mask"], record["roi"]) == ("m.png", "20 20 80 60")
        masked = int((file["status"] == 6).sum())
    assert f"{masked} masked" in result.stdout
    for words in (
        " points/s; median standard uncertainty 0.",
        " px of u_x, ",
        " px of u_y; median correlation 1.0",
    ):
        assert words in result.stdout
    result = slipscope(
        "dic", "a.tif", "b.tif", "b.tif", "-o", "g.csv", "--update", "every", "--update-every", 1
    )
    assert "reference replaced 2 times, which adds 0.0" in result.stdout


def test_a_pause_is_ordered_and_withdrawn(slipscope, monkeypatch):
    done = []
    health = SimpleNamespace(state="running")
    source = SimpleNamespace(
        title="a run",
        look=lambda: SimpleNamespace(health=health),
        pause=lambda: done.append("pause"),
        cancel_pause=lambda: done.append("cancel"),
    )
    monkeypatch.setattr("app.processes.launch.attached", lambda *_: source)
    assert "waits before its next step, if there is one" in slipscope("pause").output
    assert "does not wait before its next step" in slipscope("pause", "--cancel").output
    assert done == ["pause", "cancel"]
    health.state = "done"
    refused = slipscope("pause", "--cancel")
    assert refused.exit_code == 2
    assert "is not under way; nothing was ordered" in refused.output
    assert done == ["pause", "cancel"]
