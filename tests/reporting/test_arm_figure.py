"""An arm's picture holds all of it, and little besides."""

import re

import numpy as np
import pytest
from tests.robots.urdf_arms import urdf

from omniservo.reporting.arm_figure import draw_arm
from omniservo.robots import load_arm, shipped_arms, suggested_posture


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_arms())
def test_an_arm_fills_its_picture_and_none_of_it_is_cut_off(name):
    arm, random = load_arm(name), np.random.default_rng(3)
    for q in (suggested_posture(arm), *random.uniform(*(0.5 * arm.joint_range.T), (1, arm.dof))):
        picture = draw_arm(arm, q)[0].figure.axes[0]
        shown = np.asarray(picture.images[0].get_array())
        is_arm = (shown != shown[0, 0]).any(axis=2)
        assert not is_arm[[0, -1]].any()
        assert not is_arm[:, [0, -1]].any()
        places = [
            np.argwhere(is_arm)[:, ::-1],
            *(arrow.xy for arrow in picture.texts if hasattr(arrow, "xy")),
        ]
        low, high = np.vstack(places).min(axis=0), np.vstack(places).max(axis=0)
        assert (low >= 0.0).all()
        assert (high < len(shown)).all()
        assert max(high - low) > 0.75 * len(shown)


def test_an_arm_without_shapes_shows_its_joints_and_its_flange(tmp_path):
    file = tmp_path / "bare.urdf"
    file.write_text(re.sub(r"<(visual|collision)>.*?</\1>", "", urdf(), flags=re.DOTALL))
    arm = load_arm(file)
    picture = draw_arm(arm, np.full(6, 0.3))[0].figure.axes[0]
    places = np.array([text.get_position() for text in picture.texts if text.get_text()])
    side = len(picture.images[0].get_array())
    assert (places > 0.0).all()
    assert (places < side).all()
    assert np.ptp(places, axis=0).max() > 0.5 * side
