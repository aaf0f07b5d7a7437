"""What every command has: --json, --quiet, help, completion of names; colours on a terminal alone."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
import typer
from PIL import Image
from tests.cli.calling import call
from tests.cli.terminal import shown_on_terminal
from tests.cli.test_command_line import problem, written

from omniservo.cameras import PRESETS
from omniservo.cli.main import app
from omniservo.cli.progress import Progress
from omniservo.robots import shipped_arms
from omniservo.shipped_tasks import shipped_tasks

COMMAND = [sys.executable, "-m", "omniservo"]


def commands(command=None, name=()):
    """Yield the words and the command of each leaf of the tree."""
    command = typer.main.get_command(app) if command is None else command
    subs = getattr(command, "commands", None)
    if subs is None:
        yield " ".join(name), command
        return
    for word, sub in subs.items():
        yield from commands(sub, (*name, word))


LEAVES = dict(commands())

QUICK = {
    "examples": (),
    "doctor": (),
    "plan": ("problem.json", "--out", "new.json"),
    "verify": ("plan.json",),
    "camera show": ("fe185",),
    "camera convert": ("fe185", "new.yaml", "--to", "mei"),
    "camera rectify": ("fe185", "grey.png", "new.png"),
    "camera check": ("grey.png", "grey.png", "--camera", "fe185"),
    "robot show": ("rx60",),
    "robot expand": ("made.xacro", "--out", "new.urdf"),
    "render": ("scene.xml", "--camera", "fe185", "--pose", "0,0,2,1,0,0,0", "--out", "seen.png"),
    "estimate": ("paper-example-1",),
    "teach": ("paper-example-1", "--out", "goal.json"),
    "schema": ("plan",),
    "sim serve": ("paper-example-1", "--projected", "--free-ports", "--seconds", "0"),
}
"""Commands that take a second or two, with what they are called with."""

LONG = {
    "run", "export", "warm-up", "camera calibrate", "robot calibrate-hand-eye", "robot measure-tube",
    "robot check", "robot delay", "view", "study run", "study merge", "study compare",
}  # fmt: skip
"""What takes longer, or needs a robot or many images: their own tests call them."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("commands")
    written(place / "problem.json", problem())
    noise = np.random.default_rng(0).integers(0, 255, (54, 83), dtype=np.uint8)
    Image.fromarray(noise).resize((659, 432), Image.Resampling.BICUBIC).save(place / "grey.png")
    (place / "made.xacro").write_text('<robot name="made"><link name="base"/></robot>')
    (place / "scene.xml").write_text("<mujoco><worldbody><geom size='.4'/></worldbody></mujoco>")
    subprocess.run([*COMMAND, "plan", "problem.json", "--out", "plan.json"], cwd=place, check=True)
    return place


@pytest.mark.parametrize("name", LEAVES)
def test_every_command_has_json_quiet_and_help(name):
    options = {option for parameter in LEAVES[name].params for option in parameter.opts}
    assert {"--json", "--quiet"} <= options
    assert LEAVES[name].help
    for parameter in LEAVES[name].params:
        said = getattr(parameter, "help", None) or ""
        assert parameter.param_type_name == "argument" or said or parameter.hidden
        assert "[" not in said  # it would be taken for a style, and not be shown


def test_every_command_is_called_here_or_elsewhere():
    assert set(QUICK) | LONG == set(LEAVES)


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_json_is_one_object_and_quiet_is_nothing(capsys, folder, monkeypatch, name):
    monkeypatch.chdir(folder)
    arguments = (*name.split(), *QUICK[name])
    code, out, err = call(capsys, *arguments, "--json", *(("--force",) if "--force" in opts(name) else ()))
    assert (code, err) == (0, "")
    assert isinstance(json.loads(out), dict)
    assert out.count("\n") == 1
    code, out, err = call(capsys, *arguments, "--quiet", *(("--force",) if "--force" in opts(name) else ()))
    assert (code, out, err) == (0, "", "")


def opts(name):
    return {option for parameter in LEAVES[name].params for option in parameter.opts}


STAGED = sorted(set(QUICK) - {"examples", "doctor", "robot expand"})


@pytest.fixture
def interruptible():
    """Ctrl-C interrupts, also where a shell began the tests in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("name", STAGED)
@pytest.mark.parametrize("stage", [1, 2])
def test_ctrl_c_leaves_no_half_result_and_says_where_things_stand(
    capsys, folder, tmp_path, monkeypatch, name, stage
):
    for file in ("problem.json", "plan.json", "grey.png", "scene.xml"):
        shutil.copy(folder / file, tmp_path)
    monkeypatch.chdir(tmp_path)
    before, stages = set(tmp_path.iterdir()), []

    def interrupted(step):
        def say(self, *words, **more):
            stages.append(words)
            if len(stages) == stage:
                signal.raise_signal(signal.SIGINT)
            return step(self, *words, **more)

        return say

    monkeypatch.setattr(Progress, "__enter__", interrupted(Progress.__enter__))
    monkeypatch.setattr(Progress, "__call__", interrupted(Progress.__call__))
    code, _, err = call(capsys, *name.split(), *QUICK[name])
    if len(stages) < stage:  # it has fewer
        assert code == 0
        return
    assert code == 130
    assert re.fullmatch(r"omniservo: interrupted( while \w.*)?; nothing was written", err.splitlines()[-1])
    assert set(tmp_path.iterdir()) == before


@pytest.fixture
def completed(capsys, monkeypatch):
    """What the shell is told when Tab is pressed behind these words."""

    def ask(*words):
        monkeypatch.setenv("_OMNISERVO_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", " ".join(("omniservo", *words)))
        monkeypatch.setenv("COMP_CWORD", str(len(words)))
        with pytest.raises(SystemExit) as ended:
            app(prog_name="omniservo")
        assert not ended.value.code
        return capsys.readouterr().out.split()

    return ask


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (("run", "pap"), ["paper-example-1", "paper-example-2"]),
        (("estimate", "tag"), ["tag-board"]),
        (("run", "tag-board", "--camera", "fe"), ["fe185"]),
        (("camera", "show", "p"), [name for name in PRESETS if name.startswith("p")]),
        (("robot", "show", "u"), ["ur5e"]),
        (("do",), ["doctor"]),
    ],
)
def test_the_shell_completes_commands_tasks_cameras_and_arms(completed, words, names):
    assert completed(*words) == names


def test_what_is_completed_comes_from_what_is_shipped(completed):
    assert completed("teach", "''") == list(shipped_tasks())
    assert completed("robot", "show", "''") == list(shipped_arms())


def shown(arguments, **environment):
    """What a terminal gets of a command, colours and all."""
    plain = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    return shown_on_terminal([*COMMAND, *arguments], env=plain | {"TERM": "xterm"} | environment)


def test_a_command_that_is_ended_while_it_loads_is_one_message_too():
    script = (
        "import sys, signal\n"
        "class Late:\n"
        "    def find_spec(self, name, *rest):\n"
        "        if name == 'numpy': signal.raise_signal(signal.SIGINT)\n"
        "sys.meta_path.insert(0, Late())\n"
        "from omniservo.__main__ import main; main()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (130, "")
    assert ended.stderr == "omniservo: interrupted while loading; nothing was written\n"


COLOUR = ("\x1b[1;3", "\x1b[3", "\x1b[9")


@pytest.mark.slow
def test_colours_are_for_terminals_and_no_color_is_honoured():
    assert any(sign in shown(["--help"]) for sign in COLOUR)
    assert not any(sign in shown(["no-such-command"], NO_COLOR="1") for sign in COLOUR)
    piped = subprocess.run([*COMMAND, "no-such-command"], capture_output=True, text=True, check=False)
    assert "\x1b" not in piped.stdout + piped.stderr
