"""Points of a rolling shutter are led back to the time stamp; stops are named after blur and shutter."""

import numpy as np
import pytest

from omniservo.errors import Divergence, FeatureLoss, InconsistentImage, InputError, JointLimit
from omniservo.safety import SafetyOptions
from omniservo.safety.moving_image import MotionBlur, MovingImage, RollingShutter

HEIGHT, READOUT = 480, 0.03
START = np.array([[100.0, 20.0], [300.0, 240.0], [500.0, 470.0]])
FLOW = np.array([[200.0, 50.0], [-300.0, 0.0], [0.0, -400.0]])  # [px/s]


def moving(flow=FLOW, known=True, **options):
    """An image whose points move with the flow from START on."""
    image = MovingImage(SafetyOptions(**options), HEIGHT)
    image.predict(lambda time: (START + flow * time, np.full(3, known)), 0.0)
    return image


def seen_by_rows(flow=FLOW):
    """Where a rolling shutter shows the points: each at the instant of the row that it is on then."""
    pixels = START.copy()
    for _ in range(50):
        late = ((pixels[:, 1] + 0.5) / HEIGHT - 0.5) * READOUT
        pixels = START + flow * late[:, None]
    return pixels


def test_points_are_led_back_from_their_rows_instants_to_the_time_stamp():
    image = moving(readout=READOUT)
    seen = seen_by_rows()
    assert np.abs(seen - START).max() > 2.0
    np.testing.assert_allclose(seen - image.displaced(seen), START, atol=1e-9)


def test_points_are_looked_for_where_their_rows_see_them():
    image = moving(readout=READOUT)
    assert np.abs(START + image.displaced(START) - seen_by_rows()).max() < 0.2


def test_a_global_shutter_and_points_without_prediction_displace_nothing():
    assert not moving(exposure=0.03).displaced(START).any()
    assert not moving(readout=READOUT, known=False).displaced(START).any()
    assert not MovingImage(SafetyOptions(), HEIGHT).displaced(START).any()


def test_a_loss_is_named_after_motion_blur_where_the_points_moved_two_pixels():
    loss = FeatureLoss("2 of 12 points are seen")
    named = moving(exposure=0.03).named(loss)
    assert type(named) is MotionBlur
    assert isinstance(named, FeatureLoss)
    assert str(named) == "motion blur: 9 px during the exposure of 30 ms; 2 of 12 points are seen"
    assert moving(exposure=0.006).named(loss) is loss
    assert moving(readout=READOUT).named(loss) is loss


@pytest.mark.parametrize("kind", [Divergence, InconsistentImage])
def test_points_that_disagree_are_named_after_a_rolling_shutter_where_they_moved_four_pixels(kind):
    named = moving(readout=READOUT).named(kind("they disagree"))
    assert (type(named), named.reason) == (RollingShutter, "rolling_shutter")
    assert str(named) == "rolling shutter: 9 px during the readout of 30 ms; they disagree"
    slow = kind("they disagree")
    assert moving(readout=0.01).named(slow) is slow
    assert moving(exposure=0.03).named(slow) is slow


def test_what_has_another_cause_keeps_its_name():
    stop = JointLimit("j3")
    assert moving(readout=READOUT, exposure=0.03).named(stop) is stop
    assert MovingImage(SafetyOptions(), HEIGHT).named(stop) is stop


@pytest.mark.parametrize("name", ["exposure", "readout"])
@pytest.mark.parametrize("value", [-0.01, np.nan])
def test_times_of_a_sensor_that_cannot_be_are_refused(name, value):
    with pytest.raises(InputError, match=f"{name}: "):
        SafetyOptions(**{name: value})
