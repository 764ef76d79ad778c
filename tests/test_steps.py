"""The steps of a protocol in the settings: what is written is what is done, and what cannot be
done is refused in one sentence before anything moves.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from analysis.options import options
from app.settings import config
from app.settings.config import ConfigError, from_data, from_record, load, to_toml
from app.settings.protocol_steps import EXAMPLE, KINDS, Drive, Reverse, durations, legs, reach

START = '{do="background"}, {do="approach"}, {do="reference"}'


def loaded(steps: str, *overrides: str, start: str = START) -> config.Config:
    """The settings of a run with these steps after the usual ones."""
    both = ", ".join(part for part in (start, steps) if part)
    return load(None, [f"run.steps=[{both}]", *overrides])


def test_without_steps_the_keys_of_run_are_the_protocol() -> None:
    run = load(None, ["run.travel=60", "run.velocity=3", "run.reversals=2"]).run
    assert run.steps == ()
    told = [str(step) for step in run.protocol]
    assert told == [
        "background, 1 s",
        "approach to 0.5 N",
        "reference, 1.5 s",
        "drive 60 um at 3 um/s",
        "reverse 2 times at 3 um/s",
    ]
    assert isinstance(run.protocol[-2], Drive)
    assert isinstance(run.protocol[-1], Reverse)
    first = load(None, ["run.background_time=0"]).run.protocol[0]
    assert first.kind == "approach"


def test_what_a_step_leaves_out_is_that_of_run() -> None:
    steps = loaded('{do="drive"}, {do="drive", travel=-5}', "run.travel=70", "run.velocity=2").run
    assert [str(step) for step in steps.protocol[-2:]] == [
        "drive 70 um at 2 um/s",
        "drive -5 um at 2 um/s",
    ]


def test_the_steps_survive_the_way_through_a_session() -> None:
    settings = loaded(
        '{do="drive", travel=100, until_slid=0, unmet="fail"},'
        ' {do="velocity", velocity=7.04, travel=20, until_drop=0.1}, {do="reverse", times=3},'
        ' {do="hold", time=2.5}, {do="cycle", times=2, travel=-10},'
        ' {do="ask", question="Is it \\"dry\\"?", timeout=3, unanswered="go on"}',
        start='{do="zero"}, ' + START,
    )
    assert len(settings.run.steps) == 10
    for comments in (True, False):
        text = to_toml(settings, comments=comments)
        assert from_data(tomllib.loads(text), "again") == settings
        assert from_record(text, "session") == settings
    assert load(None, ["run.travel=100"]) == from_data(
        tomllib.loads(to_toml(load(None, ["run.travel=100"]))), "again"
    )


def test_the_example_in_the_settings_file_can_be_used(tmp_path: Path) -> None:
    text = config.to_toml(config.Config())
    example = "\n".join(f"# {line}".rstrip() for line in EXAMPLE.splitlines())
    assert example in text
    file = tmp_path / "bench.toml"
    file.write_text(text.replace(example, EXAMPLE), encoding="utf-8")
    assert [step.kind for step in load(file).run.steps] == [
        "background", "approach", "reference", "drive", "hold", "drive",
    ]  # fmt: skip


def test_every_kind_is_documented() -> None:
    page = (Path(__file__).parents[1] / "docs" / "protocols.md").read_text(encoding="utf-8")
    assert all(f"`{kind}`" in page for kind in KINDS)


def test_the_worst_path_counts_what_conditions_may_end() -> None:
    steps = loaded(
        '{do="drive", travel=100, until_ratio=0.5}, {do="drive", travel=-30}, {do="reverse"}'
    ).run.protocol
    low, high = reach(steps)
    assert (round(low * 1e6), round(high * 1e6)) == (-30, 100)
    ends = [(leg.number, *(round(place * 1e6) for place in leg.end)) for leg in legs(steps)]
    assert ends == [(4, 0, 100), (5, -30, 70), (6, 0, 100)]
    # as planned no condition ends anything
    seconds = durations(steps)
    assert seconds[3:] == pytest.approx([20.0, 6.0, 6.0])


def test_cycles_and_reversals_go_forth_and_back() -> None:
    steps = loaded('{do="drive", travel=50}, {do="reverse", times=2}, {do="cycle", times=2,'
                   ' travel=-20}').run.protocol  # fmt: skip
    assert [round(leg.end[0] * 1e6) for leg in legs(steps)] == [50, 0, 50, 30, 50, 30, 50]
    assert durations(steps)[3:] == pytest.approx([10.0, 20.0, 16.0])


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ('{do="fly"}', 'step 4: there is no kind "fly" of steps; known: zero, background'),
        ("{travel=3}", "step 4 does not say what it is; write do ="),
        ('{do="hold"}', r"step 4 \(hold\): it needs time, a number more than 0"),
        ('{do="hold", time=3, tims=3}', r"step 4 \(hold\): it has no key 'tims'; it has time"),
        ('{do="hold", time="long"}', r"step 4 \(hold\): time must be a number .*; found \"long\""),
        ('{do="hold", time=inf}', r"step 4 \(hold\): time: a finite number is needed; found inf"),
        ('{do="cycle", times=0}', r"step 4 \(cycle\): times must be a whole number at least 1"),
        ('{do="drive", travel=10, until_time=1e9}', r"until_time must be a number at least 0"),
        ('{do="drive"}, {do="background"}', r"step 5 \(background\) needs the free block"),
        ('{do="zero"}, {do="drive"}', r"step 4 \(zero\) needs the free block"),
        ('{do="drive"}, {do="reference"}', r"step 5 \(reference\) is there a second time"),
        ('{do="drive"}, {do="approach"}', r"step 5 \(approach\) would move the contact after"),
        ('{do="hold", time=3}', "no step moves the stage; add a drive"),
        ('{do="velocity", velocity=3, travel=3}', r"step 4 \(velocity\) goes on with a motion"),
        ('{do="drive"}, {do="hold", time=1}, {do="velocity", velocity=3, travel=3}',
         r"step 6 \(velocity\) goes on with a motion, but none is under way"),
        ('{do="reverse"}, {do="drive"}', r"step 4 \(reverse\) comes before any drive"),
        ('{do="drive", travel=501}', r"step 4 \(drive\) can end 501 um .* limits\.travel = 500"),
        ('{do="drive", travel=300}, {do="drive", travel=300}', r"step 5 \(drive\) can end 600 um"),
        ('{do="drive", travel=-400}, {do="drive", travel=-200}', r"step 5 .* can end -600 um"),
        ('{do="drive", travel=300, until_ratio=0.1}, {do="drive", travel=-510}',
         r"step 5 \(drive\) can end -510 um"),
        ('{do="drive", travel=300}, {do="velocity", velocity=9, travel=250}', "can end 550 um"),
        ('{do="drive", velocity=20.5}', r"goes at 20\.5 um/s, .* beyond actuator\.max_velocity"),
        ('{do="drive", until_force=1.9}', r"goes on until Q = 1\.9 N, which is not below limits"),
        ('{do="drive", unmet="fail"}', "fails where no condition is met, and has none; give one"),
        ('{do="ask", question=" "}, {do="drive"}', "asks a question of 0 characters"),
        ('{do="ask", question="a\\u001b[2J"}', "with a character that cannot be printed"),
        ('{do="ask", question="' + "x" * 201 + '"}', "asks a question of 201 characters"),
    ],
)  # fmt: skip
def test_what_can_not_be_done_is_refused_by_the_number_of_its_step(steps: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        loaded(steps, "actuator.max_velocity=20")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ('{do="background"}, {do="reference"}', r"step 2 \(reference\) comes before the contact"),
        ('{do="approach"}', r"step 2 \(drive\) moves the stage before the reference image"),
        ('{do="approach", normal_force=1.9}, {do="reference"}', "which is not below limits.normal"),
        ('{do="background"}, {do="background"}', "is there a second time"),
    ],
)
def test_the_order_of_the_steps_is_checked(start: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        loaded('{do="drive"}', start=start)


def test_other_keys_of_run_that_steps_do_not_use_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"run\.reversals = 2 goes with the travel of"):
        loaded('{do="drive"}', "run.reversals=2")
    with pytest.raises(ConfigError, match=r"step 1 \(background\) lasts 0 s, as run.background"):
        loaded('{do="drive"}', "run.background_time=0")
    with pytest.raises(ConfigError, match=r"write \[\[run\.steps\]\] above each step"):
        load(None, ["run.steps={do='drive'}"])
    many = ", ".join(['{do="hold", time=1}'] * 200)
    with pytest.raises(ConfigError, match="204 steps found, 200 is the most"):
        loaded(f'{many}, {{do="drive"}}')


_VALUES = st.one_of(
    st.booleans(), st.integers(-(2**70), 2**70), st.floats(), st.text(max_size=9), st.just([])
)
_KEYS = sorted({key for kind in KINDS.values() for key in options(kind)})
_STEP = st.dictionaries(st.sampled_from(_KEYS), _VALUES, max_size=3)


@given(st.lists(st.tuples(st.sampled_from([*KINDS]), _STEP), max_size=5))
def test_any_steps_are_read_or_refused_in_one_sentence(given_steps: list) -> None:
    start = [{"do": kind} for kind in ("background", "approach", "reference", "drive")]
    steps = start + [{"do": kind, **keys} for kind, keys in given_steps]
    try:
        settings = from_data({"run": {"steps": steps}}, "bench.toml")
    except ConfigError as error:
        assert "\n" not in str(error)  # noqa: PT017 - either outcome is right
        assert len(str(error)) < 600  # noqa: PT017
        return
    assert from_data(tomllib.loads(to_toml(settings, comments=False)), "again") == settings
    low, high = reach(settings.run.protocol)
    assert -500.001e-6 <= low <= 0.0 <= high <= 500.001e-6
