"""``omniservo doctor`` finds what is wrong with a machine, and says what to do."""

import json
import os
import tomllib
from pathlib import Path

import pytest
from tests.cli.calling import call

from omniservo.cli import machine_checks
from omniservo.cli.machine_checks import GIVES

ROOT = Path(__file__).resolve().parents[2]


def asked(capsys):
    code, out, err = call(capsys, "doctor", "--json")
    said = json.loads(out)
    return code, {check["name"]: check for check in said["checks"]}, err


def test_a_machine_on_which_all_is_well_is_exit_code_0(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(machine_checks, "_DEVICES", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1})
    code, checks, err = asked(capsys)
    assert (code, err) == (0, "")
    assert {"python", "packages", "numba", "cores", "memory", "disk", "kernels", "timer"} <= set(checks)
    assert checks["cores"]["values"]["usable"] == 2
    assert all(check["verdict"] in ("ok", "note") for check in checks.values())
    code, out, _ = call(capsys, "doctor")
    assert code == 0
    assert out.splitlines()[-1] == "all is well"


def test_every_thing_that_is_wrong_has_a_next_step_and_exit_code_1(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(machine_checks, "_DEVICES", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {3})
    monkeypatch.setattr(machine_checks, "_LEAST_MEMORY", 2**60)
    monkeypatch.setattr(machine_checks, "_requirements", lambda extra: {"numba": "==0.1", "no-such": ">=1"})
    code, checks, err = asked(capsys)
    wrong = {name for name, check in checks.items() if check["verdict"] == "wrong"}
    assert (code, wrong) == (1, {"packages", "cores", "memory"})
    assert all(checks[name]["next_step"] for name in wrong)
    assert "numba is 0." in checks["packages"]["found"]
    assert "no-such is missing" in checks["packages"]["found"]
    assert all(checks[name]["next_step"] in err for name in wrong)
    extra = checks["extra ros2"]
    assert (extra["verdict"], extra["next_step"][:11]) == ("note", "pip install")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_cache_that_cannot_be_written_is_wrong(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    tmp_path.chmod(0o500)
    assert asked(capsys)[1]["kernels"]["verdict"] == "wrong"


def test_a_cache_that_is_not_whole_is_named_with_the_command_that_fills_it(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kernels = asked(capsys)[1]["kernels"]
    assert (kernels["verdict"], kernels["next_step"]) == ("note", "omniservo warm-up")
    assert kernels["values"]["folder"].startswith(str(tmp_path))
    assert kernels["values"]["complete"] is False


def test_a_camera_that_may_not_be_opened_is_wrong_and_says_how_to_open_it(capsys, monkeypatch, tmp_path):
    (tmp_path / "video0").touch()
    monkeypatch.setattr(machine_checks, "_DEVICES", tmp_path)
    assert asked(capsys)[1]["cameras"]["verdict"] == "ok"
    monkeypatch.setattr(os, "access", lambda path, mode: "video" not in str(path))
    code, checks, _ = asked(capsys)
    assert (code, checks["cameras"]["verdict"]) == (1, "wrong")
    assert "usermod -aG video" in checks["cameras"]["next_step"]


def test_versions_are_compared_as_numbers():
    within = machine_checks._is_within
    assert within("3.11.7", ">=3.11")
    assert within("1.10.0", ">=1.9,<2")
    assert not within("2.0", ">=1.9,<2")
    assert within("0.68.1", "==0.68.1")
    assert not within("0.68.2", "==0.68.1")
    assert not within("3.9", ">=3.11")


def test_every_extra_of_the_package_says_what_it_gives():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(GIVES) == set(extras)


def test_omniservo_alone_says_what_to_do_next_and_not_the_whole_help(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    code, out, err = call(capsys)
    assert (code, err) == (0, "")
    assert len(out.splitlines()) < 10
    commands = [line.split()[1] for line in out.splitlines() if line.startswith("  omniservo ")]
    assert commands == ["warm-up", "run", "examples", "doctor", "--help"]
