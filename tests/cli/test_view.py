import os
import subprocess
import sys
import urllib.request
from importlib import import_module

import pytest
from tests.cli.calling import call
from tests.cli.valid_output import check_output


def test_without_viser_one_line_says_how_it_is_installed(capsys, monkeypatch):
    page = import_module("omniservo.viewer.serve_page")
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    code, out, err = call(capsys, "view", "whole-arm-1", "--no-browser")
    assert (code, out) == (2, "")
    assert err.splitlines()[-1] == 'omniservo: view: the live page needs viser: pip install "omniservo[view]"'


def test_what_is_no_task_plan_or_run_is_refused(capsys, tmp_path):
    code, _, err = call(capsys, "view", tmp_path, "--no-browser")
    assert code == 2
    assert "not a folder of omniservo run" in err


@pytest.mark.slow
def test_the_page_is_served_to_this_machine_alone_until_the_end():
    command = [sys.executable, "-m", "omniservo.cli.main", "view", "--no-browser", "--json", "--port", "8420"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            said = check_output(process.stdout.readline())
            assert said["name"] == "whole-arm-1"
            assert said["url"].startswith("http://127.0.0.1:")
            with urllib.request.urlopen(said["url"]) as answered:  # noqa: S310
                assert b"<html" in answered.read(2000).lower()
        finally:
            process.terminate()
    assert process.returncode == 143
