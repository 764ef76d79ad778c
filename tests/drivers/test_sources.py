"""Drivers from anywhere: named by module and class or by an installed package, with settings of
their own that are checked like any other; sessions of them open where they are not installed.
"""

import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from analysis.options import as_written, option, options
from app.cli.inspect import changed_settings
from app.settings import config
from app.settings.config import ConfigError, from_record, load, revised, to_toml
from drivers import sources
from drivers.bench import make_bench
from drivers.errors import DeviceNotFound, DeviceTimeout
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings
from drivers.sources import DRIVERS, UnknownDevice, driver, offered

STAGE = """
from dataclasses import dataclass
from analysis.options import Section, option

class Stage:
    name = "lab stage"
    travel_limits_m, velocity_limit_m_s = (0.0, 1e-3), 1e-3

    @dataclass(frozen=True, kw_only=True)
    class Options(Section):
        '''The stage of the lab.'''
        pitch: float = option(0.5, "Pitch of the screw", "mm", gt=0, le=10)
        steps: int = option(200, "Steps of one turn", ge=1)

    def __init__(self, settings, clock):
        self.pitch_m = settings.options.pitch

    def open(self): ...
    def close(self): ...
"""
SOURCE = "actuator.source=lab_stage:Stage"


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """Makes modules that can be imported while the test lasts."""
    monkeypatch.syspath_prepend(str(tmp_path))
    names = []

    def module(text, name="lab_stage"):
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
        names.append(name)

    yield module
    for name in names:
        sys.modules.pop(name, None)


def test_a_class_of_any_module_is_made_with_its_own_options(lab):
    lab(STAGE)
    settings = load(None, [SOURCE, "actuator.options.pitch=2"])
    assert as_written(settings.actuator.options) == {"pitch": 2, "steps": 200}
    bench = make_bench(settings.forces, settings.camera, settings.actuator)
    assert bench.actuator.name == "lab stage"
    assert bench.actuator.pitch_m == 2e-3
    assert driver("actuator", "lab_stage:Stage").nature == "real"


def test_its_options_are_explained_and_survive_the_way_through_a_file(lab):
    lab(STAGE)
    settings = load(None, [SOURCE, "actuator.options.steps=400"])
    text = to_toml(settings)
    assert "# Pitch of the screw [mm] (more than 0 and at most 10).\npitch = 0.5" in text
    assert tomllib.loads(text)["actuator"]["options"] == {"pitch": 0.5, "steps": 400}
    assert config.from_data(tomllib.loads(text), "again") == settings


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("actuator.options.ptch=1", "the nearest known one is 'actuator.options.pitch'"),
        ("actuator.options.pitch=11", "must be a number more than 0 and at most 10 mm; found 11"),
        ("actuator.options.steps=1.5", "must be a whole number at least 1; found 1.5"),
        ("actuator.options.pitch=nan", "a finite number is needed"),
        ("actuator.options=3", "'actuator.options' is a table of the driver's own options"),
        ("camera.options.gain=3", "of the driver 'sim', which has no options of its own"),
        ("run.options.gain=3", "unknown key 'run.options"),
    ],
)
def test_options_that_can_not_be_used_are_refused_like_any_setting(lab, override, words):
    lab(STAGE)
    with pytest.raises(ConfigError) as refused:
        load(None, [SOURCE, override])
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("source", "text", "words"),
    [
        ("nowhere:Stage", "", "cannot be imported (ModuleNotFoundError: No module named"),
        ("lab_stage:Stge", STAGE, "cannot be imported (AttributeError: module 'lab_stage' has"),
        ("lab_stage:Stage", "1 / 0", "(ZeroDivisionError: division by zero); correct the module"),
        ("lab_stage:Stage", STAGE.replace('"mm"', '"furlong"'), "the unit 'furlong'"),
        ("lab_stage:Stage", "Stage = 3", "is no class but a int"),
        ("lab_stage:Stage", "class Stage: Options = 3", "`Options` of the driver"),
        ("os:system", "", "is no class but a builtin_function"),
        ("smc10", "", "no driver is called 'smc10'"),
        ("not a name:Stage", "", "no driver is called 'not a name:Stage'"),
    ],
)
def test_what_is_no_driver_is_refused_in_one_sentence(lab, source, text, words):
    lab(text)
    with pytest.raises(ConfigError) as refused:
        load(None, [f"actuator.source={source}"])
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_driver_says_of_itself_what_it_is_made_from(lab):
    lab("class Stage: nature = 'simulated'\nclass Wrong: nature = 'magic'")
    assert driver("actuator", "lab_stage:Stage").nature == "simulated"
    with pytest.raises(UnknownDevice, match="says of itself that it is 'magic'"):
        _ = driver("actuator", "lab_stage:Wrong").nature


def test_a_class_that_is_no_driver_is_not_called():
    settings = load(None, ["actuator.source=subprocess:Popen"])
    with pytest.raises(UnknownDevice, match="'subprocess:Popen' cannot be opened and closed"):
        make_bench(ForceSettings(), CameraSettings(), settings.actuator)


HANGS = """
import threading

class Stage:
    def __init__(self, settings, clock): threading.Event().wait(20)
    def open(self): ...
    def close(self): ...
"""


def test_a_driver_that_is_never_made_is_given_up_by_its_name(lab, monkeypatch):
    lab(HANGS)
    monkeypatch.setattr(sources, "MAKE_S", 0.1)
    actuator = load(None, ["actuator.source=lab_stage:Stage"]).actuator
    with pytest.raises(
        DeviceTimeout, match=r"^actuator: .*'lab_stage:Stage' did not return within"
    ):
        make_bench(ForceSettings(), CameraSettings(), actuator)


def test_installed_packages_offer_drivers_by_name(lab, monkeypatch):
    lab(STAGE)
    points = {
        "slipscope.actuator": [
            metadata.EntryPoint("lab", "lab_stage:Stage", "slipscope.actuator"),
            metadata.EntryPoint("sim", "lab_stage:Stage", "slipscope.actuator"),
        ]
    }
    monkeypatch.setattr(metadata, "entry_points", lambda group: points.get(group, []))
    assert list(offered("actuator")) == ["lab"]
    settings = load(None, ["actuator.source=lab", "actuator.options.pitch=3"])
    bench = make_bench(ForceSettings(), CameraSettings(), settings.actuator)
    assert bench.actuator.pitch_m == 3e-3
    assert driver("actuator", "sim") is DRIVERS["actuator"]["sim"]  # its name is not given away
    with pytest.raises(UnknownDevice, match="known: conex-cc, conex-cc-emulated, lab, replay"):
        driver("actuator", "lob")


def test_a_record_of_a_driver_that_is_gone_is_read_without_it(lab, tmp_path):
    lab(STAGE)
    text = to_toml(load(None, [SOURCE, "actuator.options.pitch=2"]))
    sys.modules.pop("lab_stage")
    (tmp_path / "lab_stage.py").write_text("raise SystemExit('executed')", encoding="utf-8")
    held = from_record(text, "session")
    assert as_written(held.actuator.options) == {"pitch": 2, "steps": 200}
    assert changed_settings(held)["actuator.options.pitch"] == 2
    assert from_record(to_toml(held), "session") == held == from_record(text, "session")
    assert revised(held, ["dic.box=32"]).dic.box == 32
    with pytest.raises(ConfigError, match=r"actuator\.options is .* as it was measured"):
        revised(held, ["actuator.options.pitch=3"])
    assert "lab_stage" not in sys.modules


@pytest.mark.parametrize("own", ["class = 1", "__init__ = 1", "when = 1979-05-27", "a.b = 1"])
def test_a_record_from_elsewhere_can_not_make_up_options(own):
    with pytest.raises(ConfigError):
        from_record(f"[actuator.options]\n{own}", "session")


def test_only_devices_have_options_of_a_driver():
    having = {table for table, kind in config.tables().items() if hasattr(kind(), "options")}
    assert having == {"forces", "camera", "actuator"}
    assert "options" not in options(ActuatorSettings)
    assert Path(config.__file__).exists()
    assert issubclass(UnknownDevice, DeviceNotFound)


@pytest.mark.parametrize(
    ("text", "remedy", "not_said"),
    [
        (
            "from analysis.options import option\noption(1.0, 'Speed', 'furlong')\n",
            "the unit 'furlong' .* correct the module, or the name of the class$",
            "PYTHONPATH",
        ),
        ("import no_such_library\n", "install its package, or put", "current folder"),
    ],
)
def test_a_driver_that_can_not_be_imported_is_told_what_helps(
    tmp_path, monkeypatch, text, remedy, not_said
):
    (tmp_path / "odd_driver.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "odd_driver", raising=False)
    with pytest.raises(UnknownDevice, match=remedy) as caught:
        assert driver("actuator", "odd_driver:Stage").driver_class
    assert not_said not in str(caught.value)


def test_a_driver_in_the_current_folder_is_told_that_this_is_not_looked_in(tmp_path, monkeypatch):
    (tmp_path / "here_driver.py").write_text("class Stage: ...", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    with pytest.raises(UnknownDevice, match=r"it lies in the current folder, .* set PYTHONPATH=\."):
        assert driver("actuator", "here_driver:Stage").driver_class


@pytest.mark.parametrize(
    ("unit", "held"), [("mm/s", 2e-3), ("mm/s2", 2e-3), ("A", 2.0), ("mA", 2e-3), ("degC", 2.0)]
)
def test_units_that_drivers_of_stages_need_are_known(unit, held):
    declared = option(1.0, "Something", unit).metadata
    (found,) = declared.values()
    assert found.si(2.0) == pytest.approx(held)
    assert found.written(found.si(2.0)) == 2.0
