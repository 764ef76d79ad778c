"""The settings as a form: what is typed, what is refused and why, what is marked, load and save."""

from pathlib import Path

import pytest

from app.gui.cells import typeset
from app.gui.form import (
    AS_SET,
    EXAMPLE_STEPS,
    OWN_STEPS,
    STEPS_KEY,
    Base,
    Form,
    preset_of,
    protocols,
    read_base,
    steps_in_words,
    write_base,
)
from app.settings.config import ConfigError, load, to_toml
from app.settings.sections import Config


@pytest.fixture
def form() -> Form:
    return Form(Config())


def typed(form: Form, key: str, text: str) -> bool:
    return form.type(form.field(key), text)


def test_every_setting_shows_what_it_takes_back(form: Form) -> None:
    for config in (Config(), load(Path("hil-emulated")), load(Path("cyclic-shear"))):
        form.replace(config)
        values = form.values()
        keys = [field.key for group in form.groups() for field in group.fields]
        assert set(values) == {*keys, STEPS_KEY}
        for group in form.groups():
            for field in group.fields:
                assert form.type(field, field.text(values[field.key])), form.refused
        assert form.config == config


@pytest.mark.parametrize("text", ["0.3", " 0.3 N", "3e-1"])
def test_a_number_may_have_its_unit(form: Form, text: str) -> None:
    assert typed(form, "run.normal_force", text)
    assert form.config.run.normal_force == 0.3
    assert typed(form, "run.travel", "150 µm")
    assert form.config.run.travel == pytest.approx(150e-6)


@pytest.mark.parametrize(
    ("key", "text", "sentence"),
    [
        ("run.normal_force", "12", "run.normal_force must be a number more than 0 and at most 10"),
        ("run.normal_force", "", 'run.normal_force must be a number more than 0 and at most 10 N; '
         'found ""'),
        ("run.normal_force", "0,3", 'at most 10 N; found "0,3"'),
        ("camera.divisor", "1.5", "camera.divisor must be a whole number at least 1"),
        ("dic.method", "best", "dic.method must be 'shared' or 'icgn' or 'direct'"),
        ("forces.range", "5", "forces.range must be two numbers"),
        ("run.velocity", "nan", "run.velocity: a finite number is needed; found nan"),
        ("camera.divisor", "1", "camera.divisor = 1 asks 1e+03 frames/s"),
        ("about.sample", "x" * 101, "about.sample has 101 characters"),
    ],
)  # fmt: skip
def test_what_can_not_be_used_is_refused_with_the_sentence_of_its_declaration(
    form: Form, key: str, text: str, sentence: str
) -> None:
    before = form.config
    assert not typed(form, key, text)
    assert sentence in form.refused[key].sentence
    assert form.config == before
    assert typed(form, key, form.field(key).text(form.values()[key]))
    assert not form.refused


def test_two_settings_that_are_right_together_are_taken_one_after_the_other(form: Form) -> None:
    assert not typed(form, "run.normal_force", "1.95")
    assert "is not below limits.normal_force = 1.9 N" in form.refused["run.normal_force"].sentence
    assert not typed(form, "run.velocity", "fast")  # an unrelated one does not stand in the way
    assert typed(form, "limits.normal_force", "2.5")
    assert form.config.run.normal_force == 1.95
    assert set(form.refused) == {"run.velocity"}


def test_what_differs_from_the_base_is_marked_and_can_be_reset(form: Form) -> None:
    assert not form.changed()
    typed(form, "run.normal_force", "0.3")
    typed(form, "camera.exposure", "5")
    assert form.changed() == {"run.normal_force": (0.3, 0.5), "camera.exposure": (5.0, 10.0)}
    form.base = Base("a session", load(None, ("run.normal_force=0.3", "sim.seed=7")))
    assert form.changed() == {"camera.exposure": (5.0, 10.0), "sim.seed": (1, 7)}
    assert form.reset("sim.seed")
    assert form.config.sim.seed == 7


def test_a_preset_is_shown_by_its_name_and_sets_the_others(form: Form) -> None:
    assert form.values()["dic.preset"] == "custom"
    assert form.put("dic.preset", "finest")
    assert (form.config.dic.box, form.config.dic.order) == (38, 2)
    assert preset_of(form.config) == form.values()["dic.preset"] == "finest"
    assert form.put("dic.box", 40)
    assert form.values()["dic.preset"] == "custom"
    assert form.put("dic.preset", "finest")
    assert form.config.dic.box == 38  # what was typed before gives way


def test_another_driver_leaves_the_options_of_the_former_behind(form: Form) -> None:
    source = "labs.webcam:Webcam"
    config = load(None, (f"camera.source={source}", "camera.options.stale=2"))
    form.replace(config)
    assert form.values()["camera.options.stale"] == 2
    assert form.field("camera.options.stale").name == "stale"
    assert form.put("camera.source", "sim")
    assert not [key for key in form.values() if key.startswith("camera.options.")]
    assert not form.put("camera.source", "no-such")
    assert "no-such" in form.refused["camera.source"].sentence


def test_a_saved_file_gives_the_same_settings_and_is_the_new_base(
    form: Form, tmp_path: Path
) -> None:
    typed(form, "run.normal_force", "0.3")
    typed(form, "about.note", "first\nsecond, µm")
    form.put_steps(protocols()["cyclic-shear"])
    form.base = write_base(tmp_path / "mine.toml", form.config)
    assert load(tmp_path / "mine.toml") == form.config
    assert not form.changed()
    base = read_base(tmp_path / "mine.toml")
    assert base.config == form.config
    assert base.name == "mine.toml"


def test_a_file_that_can_not_be_used_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("[run]\nnormal_force = 50\n")
    with pytest.raises(ConfigError, match=r"bad\.toml: run\.normal_force must be"):
        read_base(tmp_path / "bad.toml")


def test_the_protocols_that_can_be_chosen(form: Form) -> None:
    assert list(protocols()) == [AS_SET, EXAMPLE_STEPS, "cyclic-shear", "slide-hold-slide"]
    typed(form, "run.reversals", "2")
    for name, steps in protocols().items():
        assert form.put_steps(steps), form.refused
        assert form.protocol() == name
    assert form.config.run.steps == load(Path("slide-hold-slide")).run.steps
    own = [{"do": "approach"}, {"do": "reference"}, {"do": "drive", "travel": 20}]
    assert form.put_steps(own)
    assert form.protocol() == OWN_STEPS
    assert steps_in_words(form.config) == (
        "approach to 0.5 N", "reference, 1.5 s", "drive 20 µm at 5 µm/s",
    )  # fmt: skip
    other = Form(Config())
    assert other.put_steps(form.steps())
    assert other.config.run.steps == form.config.run.steps


@pytest.mark.parametrize(
    ("do", "sentence"),
    [
        ("drive", "step 1 (drive) moves the stage before the reference"),
        ("dance", 'step 1: there is no kind "dance" of steps'),
    ],
)
def test_steps_that_can_not_be_done_are_refused(form: Form, do: str, sentence: str) -> None:
    assert not form.put_steps([{"do": do}])
    assert sentence in form.refused[STEPS_KEY].sentence


def test_texts_have_proper_symbols_and_names_stay() -> None:
    assert typeset("Greatest 5 um/s of u_x(r), sigma(r)") == "Greatest 5 µm/s of uₓ(r), σ(r)"
    assert typeset("slip at t_s s_0, file s_01") == "slip at tₛ s₀, file s_01"
    assert typeset("must be in um; forces.sum") == "must be in µm; forces.sum"
    assert typeset("minimum of the spectrum, 0.5 mu") == "minimum of the spectrum, 0.5 μ"
    assert "um" not in {field.unit for g in Form(Config()).groups() for field in g.fields}
    assert to_toml(Config())
