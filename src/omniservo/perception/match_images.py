"""Two images of one scene: the pixels that show the same points of it, to a fraction of a pixel."""

from __future__ import annotations

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import ByteArray
from omniservo.perception.find_dots import check_image
from omniservo.perception.find_features import find_features
from omniservo.perception.guided_matches import guided_matches
from omniservo.perception.match_features import match_features
from omniservo.perception.refine_matches import ImageMatch, refused
from omniservo.perception.smear_length import smear_length


def match_images(camera: CentralModel, image_initial: ByteArray, image_goal: ByteArray) -> ImageMatch:
    """Find natural features in both images, match them, and lay their patches on each other.

    See `smear_length`, `find_features`, `match_features`, `guided_matches`. Single pairs may still be wrong:
    about one of a hundred, and `estimate_two_view` finds them.

    Args:
        camera: took both images.
        image_initial: (height, width) grey values, uint8.
        image_goal: likewise.

    Raises:
        InputError: not such images, or not of the camera's size.
    """
    for image in (image_initial, image_goal):
        check_image(image, camera)
    for image, name in ((image_initial, "initial"), (image_goal, "goal")):
        if length := smear_length(image):
            return refused("blurred", f"the {name} picture is smeared by motion over {length} px")
    initial, goal = (find_features(image, camera) for image in (image_initial, image_goal))
    return guided_matches(camera, image_initial, image_goal, initial, goal, match_features(initial, goal))
