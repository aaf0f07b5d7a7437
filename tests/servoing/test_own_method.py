import numpy as np
import pytest

from omniservo.errors import InputError, InvalidData, NotFinite, ServoStop
from omniservo.servoing import ServoMeasurement
from omniservo.servoing.own_method import OwnMethod

SEEN = ServoMeasurement(0.0, np.eye(3), np.ones(3), np.eye(3), np.ones(3), np.eye(4))

STEP = """import sys
import numpy as np
class Mine:
 def __init__(self, gain): {init}
 def step(self, seen): {step}
"""


def own(tmp_path, step, init="pass"):
    path = tmp_path / "mine.py"
    path.write_text(STEP.format(step=step, init=init))
    return OwnMethod(f"{path}:Mine", 1.0)


@pytest.mark.parametrize(
    "step",
    [
        *(
            "return None",
            "return 'abcdef'",
            "return 1j * np.ones(6)",
            "return np.ones(5)",
            "return np.ones((6, 1))",
        ),
        *(
            "return np.ones((6, 1))",
            "return ['1'] * 6",
            "return [None] * 6",
            "return [True] * 6",
            "return {}",
        ),
    ],
)
def test_a_twist_that_is_not_six_numbers_is_a_named_stop(tmp_path, step):
    with pytest.raises(NotFinite, match=r"mine.py:Mine: gives the twist .*; six finite numbers are needed"):
        own(tmp_path, step).step(SEEN)


@pytest.mark.parametrize(
    "step", ["sys.exit(0)", "raise ValueError('x')", "return [1, [2, 3], 4, 5, 6, 7]", "self.step(seen)"]
)
def test_whatever_a_method_raises_is_a_named_stop(tmp_path, step):
    with pytest.raises(InvalidData, match=r"mine.py:Mine: \w+.py:\d+: \w+"):
        own(tmp_path, step).step(SEEN)


def test_its_own_stop_and_its_own_twist_pass(tmp_path):
    assert own(tmp_path, "return [1, 2, 3, 4, 5, 6.5]").step(SEEN).tolist() == [1, 2, 3, 4, 5, 6.5]
    raises = "raise __import__('omniservo.errors').errors.FeatureLoss('few')"
    with pytest.raises(ServoStop, match="few") as stop:
        own(tmp_path, raises).step(SEEN)
    assert stop.value.reason == "feature_loss"


@pytest.mark.parametrize("init", ["raise ValueError('no')", "sys.exit(0)"])
def test_one_that_cannot_be_made_is_refused_with_its_line(tmp_path, init):
    with pytest.raises(InputError, match=r"method: .*:Mine: mine.py:4: (ValueError: no|SystemExit: 0)"):
        own(tmp_path, "return np.zeros(6)", init)


def test_a_file_that_ends_the_process_is_refused(tmp_path):
    path = tmp_path / "ends.py"
    path.write_text("import sys\nsys.exit(0)\n")
    with pytest.raises(InputError, match=r"ends.py: line 2: SystemExit: 0"):
        OwnMethod(f"{path}:Mine", 1.0)
    path.write_text("class Mine:\n step = 5\n def __init__(self, gain): pass\n")
    with pytest.raises(InputError, match="has no step"):
        OwnMethod(f"{path}:Mine", 1.0)


def test_what_a_method_prints_is_not_on_standard_output(tmp_path, capsys):
    path = tmp_path / "loud.py"
    path.write_text(
        "print('imported')\n" + STEP.format(step="print('step'); return [0] * 6", init="print('made')")
    )
    OwnMethod(f"{path}:Mine", 1.0).step(SEEN)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.split() == ["imported", "made", "step"]
