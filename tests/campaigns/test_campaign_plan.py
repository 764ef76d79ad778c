"""What the file of a campaign plans: runs, settings, names; and what is refused by one sentence."""

from __future__ import annotations

import json
import random
import re
import zipfile
from contextlib import suppress
from pathlib import Path

import pytest
from friction.rough_world import rough
from small_campaign import FEW_IMAGES, Write, text_of
from spoiled_settings import VALUES

from app.campaigns.page import Progress, table
from app.campaigns.plan import orders, read_campaign, select_runs
from app.campaigns.state import find_sessions
from app.runs.live import expected_bytes, expected_seconds
from app.settings.config import ConfigError, campaign_names, load
from app.system.errors import UserError

TWO_LOADS = "vary.run.normal_force = [0.03, 0.04]"


def test_the_six_loads_are_those_of_the_paper() -> None:
    """Section 3: 0.1 to 1.4 N at 5 um/s, 8 frames/s, 4 at the highest load."""
    plan = read_campaign(Path("six-loads"))
    configs = [run.config for run in plan.runs]
    assert [c.run.normal_force for c in configs] == [0.1, 0.3, 0.5, 0.7, 1.0, 1.4]
    assert [c.frame_rate_hz for c in configs] == [8, 8, 8, 8, 8, 4]
    assert {c.run.velocity for c in configs} == {5 * 1e-6}
    assert {(c.sim.law, c.sim.pressure) for c in configs} == {("elasto-plastic", "greenwood-tripp")}
    assert len({c.sim.seed for c in configs}) == 6
    # Fig. 8: mu falls slowly with P; JKR: 3.43 ± 0.05 MPa
    assert {c.sim.friction_decay for c in configs} == {0.1}
    (known,) = {c.uncertainty.young_modulus * c.sample.young_modulus for c in configs}
    assert known == pytest.approx(0.05e6, rel=0.05)
    assert [run.name for run in plan.runs][::5] == ["six-loads-0.1N", "six-loads-1.4N"]
    assert not plan.pauses
    frames = [expected_seconds(c) * c.frame_rate_hz for c in configs]
    assert 200 < sum(frames) / 6 < 300
    assert 3e9 < sum(map(expected_bytes, configs)) < 5e9


@pytest.mark.parametrize("number", range(6))
def test_each_of_the_six_loads_ends_in_sliding(number: int) -> None:
    """By the tests' own rough contact: the stage has to go the distance of full sliding and bend
    the cantilevers; 5 s more of sliding, with a stage that is 5 % slow.
    """
    config = read_campaign(Path("six-loads")).runs[number].config
    load = config.run.normal_force
    compliance = 1 / config.forces.stiffness_shear + config.sample.lens_compliance
    mu = config.sim.friction * load**-config.sim.friction_decay
    slides = rough(load, mu=mu).full + compliance * mu * load
    assert 0.95 * config.run.travel > slides + 5 * config.run.velocity


def test_all_combinations_are_planned_the_last_setting_fastest_then_the_repeats(
    write: Write,
) -> None:
    file = write(
        'sessions = "{name}-{load}-{velocity:.0f}-{sample}-{repeat}-{number:02d}-{dic.box}"',
        "repeats = 2",
        TWO_LOADS,
        "vary.run.velocity = [4, 5]",
        "[[runs]]",
        'about.sample = "A"',
        "[[runs]]",
        'about.sample = "B"',
        "dic.box = 24",
    )
    plan = read_campaign(file)
    assert len(plan.runs) == 2 * 2 * 2 * 2
    assert [run.name for run in plan.runs[:5]] == [
        "tiny-0.03-4-A-1-01-20",
        "tiny-0.03-4-A-2-02-20",
        "tiny-0.03-5-A-1-03-20",
        "tiny-0.03-5-A-2-04-20",
        "tiny-0.04-4-A-1-05-20",
    ]
    assert plan.runs[-1].name == "tiny-0.04-5-B-2-16-24"
    assert plan.runs[-1].session == Path("tiny/tiny-0.04-5-B-2-16-24.h5")
    assert plan.runs[-1].config.about.sample == "B"
    # the same seed would give the same bits
    assert [run.config.sim.seed for run in plan.runs[:3]] == [1, 2, 1]
    assert set(plan.runs[0].varied) == {
        *("run.normal_force", "run.velocity", "about.sample", "dic.box", "sim.seed")
    }


def test_the_bench_lies_beside_the_campaign_and_the_command_line_has_the_last_word(
    tmp_path: Path, write: Write
) -> None:
    (tmp_path / "bench.toml").write_text("[forces]\nrange = [5, 5]\n[dic]\nbox = 22\n")
    plan = read_campaign(
        write('bench = "bench.toml"', "settings.dic.step = 12"), None, ["dic.step=14"]
    )
    config = plan.runs[0].config
    assert (config.forces.range, config.dic.box, config.dic.step) == ((5, 5), 22, 14)
    pictures = ["camera.width=96", "camera.height=96", FEW_IMAGES]
    assert plan.runs[0].config.camera == load(None, pictures).camera


def test_certificates_lie_beside_the_file_that_names_them(tmp_path: Path, write: Write) -> None:
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "bench.toml").write_text('calibration.certificates = ["scale.zip"]\n')
    for folder, pixel_um in (tmp_path / "bench", 3.5), (tmp_path, 9.9):
        with zipfile.ZipFile(folder / "scale.zip", "w") as archive:
            says = {"what": "scale", "title": "", "made": "2026-11-30T12:00:00+00:00"}
            says |= {"valid_days": 10, "values": [], "settings": {"camera.pixel": pixel_um}}
            archive.writestr("certificate.json", json.dumps(says))
    plan = read_campaign(write('bench = "bench/bench.toml"', TWO_LOADS))
    assert [run.config.camera.pixel for run in plan.runs] == pytest.approx([3.5e-6] * 2)
    own = read_campaign(write('settings.calibration.certificates = ["scale.zip"]'))
    assert own.runs[0].config.camera.pixel == pytest.approx(9.9e-6)


STEPS = """settings.run.steps = [
 {do = "approach", normal_force = 0.3}, {do = "reference"},
 {do = "drive", travel = 6, velocity = 2}, {do = "reverse"}]"""


def test_load_and_velocity_are_those_of_the_steps(write: Write) -> None:
    plan = read_campaign(write(STEPS, "vary.run.reference_time = [1, 2]", "repeats = 1"))
    assert orders(plan, plan.runs[0]) == "run 1 of 2, tiny-1: P = 0.3 N, 2 um/s"
    progress = Progress(plan, find_sessions(plan))
    assert table(progress)[1][0][2:4] == ["0.3", "2"]
    named = read_campaign(write(STEPS, 'sessions = "{load}N-{run.travel:g}-{number}"'))
    assert named.runs[0].name == "0.3N-6-1"


def test_a_setting_that_the_steps_say_otherwise_is_not_varied(write: Write) -> None:
    with pytest.raises(ConfigError, match=r"run\.normal_force differs between the runs and has no"):
        read_campaign(write(STEPS, TWO_LOADS))
    followed = STEPS.replace(", normal_force = 0.3", "")
    loads = [
        run.config.run.as_planned.normal_force
        for run in read_campaign(write(followed, TWO_LOADS)).runs
    ]
    assert loads == [0.03, 0.04]


def test_a_real_bench_waits_for_the_operator_unless_the_file_says_otherwise(write: Write) -> None:
    assert read_campaign(write('bench = "pci-6251"')).pauses
    assert not read_campaign(write('bench = "pci-6251"', "pauses = false")).pauses
    assert read_campaign(write("pauses = true")).pauses


REFUSED = [
    (["vary.run.normal_force = []"], "[vary] run.normal_force must be a list of its values, at"),
    (["vary.run.normal_force = 0.3"], "[vary] run.normal_force must be a list of its values, at"),
    (["vary.run.normal_force = [0.3, 2.5]"], "run 2: run.normal_force = 2.5 N is not below limits"),
    (
        ["vary.run.travel = [10, 600, 700]"],
        "run 2: run.travel = 600 um is beyond limits.travel = 500 um; ",
    ),
    (["vary.run.travel = [10, 600, 700]"], "run 3: run.travel = 700 um is beyond limits.travel"),
    (["vary.camera.divisor = [125, 41]"], "run 2: camera.divisor = 41 asks 24.4 frames/s, 24 is"),
    (["settings.run.lod = 0.3"], "run 1: unknown key 'run.lod'; the nearest known one is 'run."),
    (["[[runs]]", "run.velocity = 'fast'"], "run 1: run.velocity must be a number more than 0"),
    (["run.velocity = 3"], "unknown key 'run'; the nearest known one is 'runs', and settings are"),
    (["settings.velocity = 3"], "[settings]: 'velocity' is no setting; write table.key = value"),
    (['bench = "no-such-bench"'], "no-such-bench: the settings file cannot be read: No such file"),
    (
        ['bench = "six-loads"'],
        "campaign.toml: bench: six-loads: 'runs' is of the plan of a campaign",
    ),
    (['bench = "//host/share/b.toml"'], "bench must be a file or folder of this computer; found"),
    ([TWO_LOADS, 'sessions = "{name}"'], "runs 1 and 2 would both be tiny.h5; distinguish them by"),
    (
        ['vary.about.sample = ["a", "A"]', 'sessions = "{sample}"'],
        "runs 1 and 2 would both be a.h5;",
    ),
    ([TWO_LOADS, 'sessions = "{name}-{lod}"'], "'lod' is not known; use name, number, repeat,"),
    ([TWO_LOADS, 'sessions = "{load:>999999999}"'], "a format such as .1f or 03d is needed"),
    ([TWO_LOADS, 'sessions = "{load.__class__}"'], "'load.__class__' is not known"),
    ([TWO_LOADS, 'sessions = "{load"'], "expected '}' before end of string"),
    (['sessions = "../{name}"'], "run 1: '../tiny' cannot be the name of a file"),
    (['settings.about.sample = "a/b"', 'sessions = "{sample}"'], "'a/b' cannot be the name of a"),
    (["repeats = 0"], "repeats = 0: a whole number from 1 to 1000 is needed"),
    (["repeats = true"], "repeats must be a whole number from 1 to 1000; found 'True'"),
    (["repeats = 1000", TWO_LOADS], "more than 1000 runs; make several campaigns of it"),
    ([TWO_LOADS, "[[runs]]", "run.normal_force = 0.5"], "run.normal_force is in [vary] and in"),
    (["runs = [3]"], "runs must be tables of settings, each under [[runs]]; entry 1 is 3"),
    (["pauses = 1"], "pauses must be true or false: whether the operator is waited for"),
    (["repeat = 2"], "unknown key 'repeat'; the nearest known one is 'repeats'"),
    (["sessions = "], "not a TOML file"),
]


@pytest.mark.parametrize(("lines", "words"), REFUSED)
def test_what_can_not_be_run_is_refused_by_a_sentence(
    write: Write, lines: list[str], words: str
) -> None:
    file = write(*lines)
    with pytest.raises(ConfigError) as refused:
        read_campaign(file)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


PLACES = [
    *("name", "bench", "sessions", "pauses", "repeats", "settings", "vary", "runs", "loads"),
    *("settings.run", "settings.run.travel", "settings.forces.options.x", "settings.about.note"),
    *("vary.run", "vary.run.travel", "vary.sim.faults", "vary.run.travel.x", "vary.a.b"),
]
TEMPLATES = ["{", "}", "{}", "{0}", "{name!r}", "{load:{number}}", "{run.travel:.3f}", "{name:9s}"]


@pytest.mark.parametrize("seed", range(60))
def test_a_file_spoiled_in_any_way_is_planned_or_refused_by_a_sentence(
    write: Write, seed: int
) -> None:
    rng = random.Random(seed)
    values = [*VALUES, *(f"'{template}'" for template in TEMPLATES)]
    for _ in range(10):
        lines = [
            f"{place} = {rng.choice(['%s', '[%s]', '[%s, 1]', '[[%s]]', '{a = %s}']) % value}"
            for place in rng.sample(PLACES, rng.randint(1, 2))
            for value in [rng.choice(values)]
        ]
        if rng.random() < 0.3:
            lines += ["[[runs]]", f"{rng.choice(PLACES)} = {rng.choice(values)}"]
        with suppress(ConfigError, UserError):  # whatever else it raised would be a traceback
            read_campaign(write(*lines))


def test_a_name_that_is_no_folder_and_a_campaign_that_is_not_there_are_refused(
    tmp_path: Path,
) -> None:
    (tmp_path / "c.toml").write_text('name = "../elsewhere"')
    with pytest.raises(ConfigError, match=r"name = '\.\./elsewhere' cannot be the name of a fold"):
        read_campaign(tmp_path / "c.toml")
    with pytest.raises(ConfigError, match=r"six-load: the campaign cannot be read: .*: six-loads"):
        read_campaign(Path("six-load"))
    assert campaign_names() == ["six-loads"]


def test_a_folder_of_its_name_does_not_hide_the_program_s_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("six-loads").mkdir()
    assert len(read_campaign(Path("six-loads")).runs) == 6


@pytest.mark.parametrize(
    ("only", "numbers"),
    [
        ([], [1, 2, 3, 4, 5, 6]),
        (["3"], [3]),
        (["5-6,1"], [1, 5, 6]),
        (["*-0.[57]N", "2"], [2, 3, 4]),
        (["six-loads-1.4N"], [6]),
    ],
)
def test_runs_are_chosen_by_number_or_name(only: list[str], numbers: list[int]) -> None:
    assert [run.number for run in select_runs(read_campaign(Path("six-loads")), only)] == numbers


@pytest.mark.parametrize("only", ["7", "0", "5-7", "0.4N", "", "six-loads-0.4N"])
def test_a_load_that_is_missing_is_refused(only: str) -> None:
    with pytest.raises(UserError, match=f"--only {re.escape(only)}: there is no such run; six-loa"):
        select_runs(read_campaign(Path("six-loads")), [only])


def test_a_campaign_that_somebody_wrote_runs_no_code_that_lies_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "evil_stage.py").write_text("raise SystemExit('it ran')\n")
    (tmp_path / "c.toml").write_text(text_of('settings.actuator.source = "evil_stage:Stage"'))
    with pytest.raises(ConfigError, match=r"which you have not confirmed as it is now"):
        read_campaign(tmp_path / "c.toml")
