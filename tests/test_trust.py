"""A settings file from somebody else names devices and files of this computer, and nothing that
runs before its user has confirmed it.
"""

import http.server
import os
import py_compile
import sys
import threading
from pathlib import Path

import pytest
from python_program import python

from app.settings import config, trusted_settings as trust
from app.settings.config import ConfigError
from app.system.errors import UserError
from drivers.errors import DeviceNotFound
from drivers.sim.contact import read_law
from drivers.stages.newport_line import NewportLine

STAGE = "class Stage:\n    travel_limits_m, velocity_limit_m_s = (0.0, 1e-3), 1e-3\n"
EVIL = "from pathlib import Path\nPath('executed').touch()\n"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.setenv("SLIPSCOPE_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("GENICAM_GENTL64_PATH", raising=False)
    monkeypatch.setenv("PYTHONPYCACHEPREFIX", "")  # set again where code was confirmed
    monkeypatch.setattr(sys, "pycache_prefix", None)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return Path.cwd()


def bench_file(text, folder=Path()):
    (folder / "bench.toml").write_text(text, encoding="utf-8")
    return folder / "bench.toml"


@pytest.mark.parametrize(
    "port",
    [
        "spy://loop://?file=precious",
        "loop://",
        "alt:///dev/ttyS0?class=Serial",
        "hwgrep://0403",
        "cp2110://0001:0004:00",
        "rfc2217://127.0.0.1:1",
        "SPY://COM3",
        "socket://127.0.0.1:1/?logging=debug",
        "/dev/../etc/passwd",
        "/etc/passwd",
        "../ttyUSB0",
        r"\\server\share\port",
    ],
)
def test_a_port_is_a_device_or_an_address(port, here):
    (here / "precious").write_text("precious", encoding="utf-8")
    path = bench_file(f"[actuator]\nsource = 'smc100'\nport = '{port}'")
    with pytest.raises(ConfigError, match=r"actuator\.port must be the name of a device"):
        config.load(path)
    assert (here / "precious").read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize(
    "port",
    [
        *("COM3", r"\\.\COM12", "/dev/ttyUSB0", "/dev/pts/4", "socket://localhost:4001"),
        "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A10K-if00-port0",
        *("/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0", "socket://[::1]:4001"),
    ],
)
def test_ports_of_a_lab_are_taken(port):
    path = bench_file(f"[actuator]\nsource = 'smc100'\nport = '{port}'")
    assert config.load(path).actuator.port == port


def test_a_driver_opens_no_other_port_whoever_made_its_settings(here):
    (here / "precious").write_text("precious", encoding="utf-8")
    with pytest.raises(DeviceNotFound, match="neither a device nor socket://host:port"):
        NewportLine("SMC100", "spy://loop://?file=precious", 1, 57600)
    assert (here / "precious").read_text(encoding="utf-8") == "precious"


def test_what_was_recorded_with_another_port_can_be_read():
    assert config.from_record("[actuator]\nport = 'loop://'", "session").actuator.port == "loop://"


# ---------------------------------------------------------------------- files


@pytest.mark.parametrize(
    "setting",
    [
        "sim.law_table",
        "sim.pressure_table",
        "forces.certificate",
        "camera.folder",
        "camera.producer",
        "replay.session",
    ],
)
@pytest.mark.parametrize(
    "name", ["http://127.0.0.1:1/law.csv", "file:///etc/passwd", "//server/share/a", "/dev/null"]
)
def test_files_are_those_of_this_computer(setting, name):
    if name == "/dev/null" and os.name != "posix":
        return
    table, key = setting.split(".")
    with pytest.raises(ConfigError, match=rf"{setting} must be a file or folder of this computer"):
        config.load(bench_file(f"[{table}]\n{key} = '{name}'"))


def test_a_server_is_a_host_and_a_port():
    with pytest.raises(ConfigError, match=r"forces\.server must be 'host:port'"):
        config.load(bench_file("[forces]\nserver = 'unix:///run/socket'"))


def test_no_law_is_fetched(here):
    asked = []

    class Web(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

    with http.server.HTTPServer(("127.0.0.1", 0), Web) as web:
        threading.Thread(target=web.serve_forever, daemon=True).start()
        with pytest.raises(ValueError, match="cannot be read"):
            read_law(f"http://127.0.0.1:{web.server_port}/law.csv")
        web.shutdown()
    assert not asked
    assert not list(here.iterdir())


def test_a_law_of_many_characters_is_not_read(here):
    (here / "law.csv").write_bytes(b"1" * (1 << 20) + b"11")
    with pytest.raises(ValueError, match="more than 1048576 characters"):
        read_law("law.csv")


# ---------------------------------------------------------------------- code


def test_a_producer_runs_once_it_is_confirmed_and_only_as_it_was(here):
    producer = here / "cam.cti"
    producer.write_bytes(b"\x7fELF")
    path = bench_file("[camera]\nsource = 'gentl'\nproducer = './cam.cti'")
    with pytest.raises(ConfigError, match=rf'slipscope trust "{producer}"'):
        config.load(path)
    assert trust.confirm(producer) == trust.fingerprint(producer)
    assert config.load(path).camera.producer == "./cam.cti"
    producer.write_bytes(b"\x7fELF2")
    with pytest.raises(ConfigError, match="not confirmed as it is now"):
        config.load(path)


def test_an_installed_producer_needs_no_confirmation(here, monkeypatch):
    (here / "vendor").mkdir()
    (here / "vendor" / "cam.cti").write_bytes(b"\x7fELF")
    monkeypatch.setenv("GENICAM_GENTL64_PATH", str(here / "vendor"))
    config.load(bench_file("[camera]\nsource = 'gentl'\nproducer = 'vendor/cam.cti'"))


@pytest.mark.parametrize("where", ["beside", "here"])
@pytest.mark.parametrize("form", ["module", "package", "namespace"])
def test_a_driver_beside_the_settings_runs_once_it_is_confirmed(here, monkeypatch, where, form):
    folder = here / "settings"
    folder.mkdir()
    lying = folder if where == "beside" else here
    name = f"strange_{where}_{form}"
    monkeypatch.syspath_prepend(str(lying))
    code = {
        "module": lying / f"{name}.py",
        "package": lying / name / "__init__.py",
        "namespace": lying / name / "stage.py",
    }[form]
    code.parent.mkdir(exist_ok=True)
    code.write_text(EVIL + STAGE, encoding="utf-8")
    module = f"{name}.stage" if form == "namespace" else name
    path = bench_file(f"[actuator]\nsource = '{module}:Stage'", folder)
    with pytest.raises(ConfigError, match=r"actuator\.source would run the code in"):
        config.load(path)
    assert not (here / "executed").exists()
    confirmed = code if form == "module" else code.parent
    trust.confirm(confirmed)
    assert config.load(path).actuator.source == f"{module}:Stage"
    assert (here / "executed").exists()
    if form != "module":
        (confirmed / "more.py").write_text("", encoding="utf-8")
        with pytest.raises(ConfigError, match="not confirmed as it is now"):
            config.load(path)


def test_code_that_was_compiled_from_another_source_is_not_run(here, monkeypatch):
    monkeypatch.syspath_prepend(str(here))
    (here / "two_faced.py").write_text(EVIL + STAGE, encoding="utf-8")
    py_compile.compile(
        "two_faced.py", invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH
    )
    (here / "two_faced.py").write_text(STAGE, encoding="utf-8")
    trust.confirm(here / "two_faced.py")
    config.load(bench_file("[actuator]\nsource = 'two_faced:Stage'"))
    assert not (here / "executed").exists()
    assert os.environ["PYTHONPYCACHEPREFIX"]


def test_what_the_user_names_himself_needs_no_confirmation(here, monkeypatch):
    monkeypatch.syspath_prepend(str(here))
    (here / "my_own_stage.py").write_text(STAGE, encoding="utf-8")
    config.load(None, ["actuator.source=my_own_stage:Stage"])


def test_importing_a_folder_imports_no_driver_that_its_settings_name(here, monkeypatch):
    monkeypatch.syspath_prepend(str(here))
    (here / "strange.py").write_text(EVIL + STAGE, encoding="utf-8")
    config.load(bench_file("[actuator]\nsource = 'strange:Stage'"), recorded=True)
    assert not (here / "executed").exists()


def test_what_lies_in_the_current_folder_is_not_run_by_the_processes_of_a_run(here):
    for name in ("psutil", "numpy", "app", "sitecustomize"):
        (here / f"{name}.py").write_text(EVIL, encoding="utf-8")
    code = (
        "from app.processes.starting import start_process, wait_until_ready\n"
        "print(wait_until_ready(start_process('app.processes.supervisor', None)))"
    )
    python("-P", "-c", code, cwd=here)
    assert not (here / "executed").exists()


@pytest.mark.parametrize("is_confirmed", [False, True])
def test_the_command_confirms(here, monkeypatch, capsys, is_confirmed):
    from app.cli.device_commands import trust as command

    (here / "cam.cti").write_bytes(b"\x7fELF")
    if is_confirmed:
        assert command(Path("cam.cti"), as_json=False) == 0
        assert "may be run as it is now, SHA-256 " in capsys.readouterr().out
        trust.check_confirmed("camera.producer", Path("cam.cti"))
    else:
        with pytest.raises(UserError, match="check the name"):
            command(Path("nowhere.cti"), as_json=False)
        monkeypatch.setenv("SLIPSCOPE_HOME", str(here / "cam.cti"))
        with pytest.raises(UserError, match="set SLIPSCOPE_HOME to a folder of your own"):
            command(Path("cam.cti"), as_json=False)
