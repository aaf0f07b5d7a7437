"""Made-up surfaces: detail of all sizes, from a seed alone; and tags and faces of tasks as panels."""

import typing

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.perception import tag_picture
from omniservo.scenes.panels_of_target import panels_of_target
from omniservo.scenes.textures import texture, texture_kinds
from omniservo.tasks.target import TargetSection, TexturedFace

KINDS = texture_kinds()
WORLD_T_INITIAL = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([0.3, -0.2, 1.0]))


def test_task_files_know_the_kinds_that_are_made():
    assert typing.get_args(TexturedFace.model_fields["kind"].annotation) == KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_gives_one_picture_and_another_seed_another(kind):
    first, again, other = (texture(kind, seed, 60, 80) for seed in (4, 4, 5))
    assert first.shape == (60, 80)
    assert 0.0 <= first.min() < 0.2 < 0.4 < first.max() <= 1.0
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).mean() > 0.05


@pytest.mark.parametrize("kind", KINDS)
def test_detail_of_every_size_is_there_and_falls_about_as_one_over_f(kind):
    picture = texture(kind, 1, 512, 512)
    amplitude = np.abs(np.fft.fft2((picture - picture.mean()) * np.outer(np.hanning(512), np.hanning(512))))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(512, 1 / 512), np.fft.fftfreq(512, 1 / 512)))
    rings = 2.0 ** np.arange(2, 9)
    mean = [
        np.sqrt((amplitude[(frequency >= low) & (frequency < 2 * low)] ** 2).mean()) for low in rings[:-1]
    ]
    fall = -np.polyfit(np.log(rings[:-1]), np.log(mean), 1)[0]
    assert 0.7 < fall < 1.6


@pytest.mark.parametrize("kind", KINDS)
def test_a_usual_detector_finds_features_all_over(kind):
    picture = np.rint(255 * texture(kind, 2, 384, 512)).astype(np.uint8)
    places = np.array([point.pt for point in cv2.SIFT_create().detect(picture, None)])
    counts = np.histogram2d(*places.T, bins=(4, 3), range=((0, 512), (0, 384)))[0]
    assert len(places) > 200
    assert counts.min() >= 3


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (("wool", 0, 64, 64), "kind: 'wool' given; legal: stones, poster, crate"),
        (("stones", -1, 64, 64), "seed"),
        (("stones", 0, 8, 64), "rows"),
        (("stones", 0, 64, 10**6), "columns"),
    ],
)
def test_impossible_textures_are_refused(given, says):
    with pytest.raises(InputError, match=says):
        texture(*given)


def test_tags_become_panels_whose_black_square_has_the_stated_edge():
    tag = {"id": 5, "edge": 0.08, "center": [0.1, 0.0, 0.5], "rotation_vector": [0.0, 0.4, 0.0]}
    target = TargetSection.model_validate({"tags": {"dictionary": "4x4_50", "panels": [tag]}})
    (panel,) = panels_of_target(target, WORLD_T_INITIAL)
    assert panel.name == "tag 5"
    dark = panel.picture < 0.5
    np.testing.assert_array_equal(dark, tag_picture("4x4_50", 5, pixels_per_cell=1) < 128)
    rows, columns = np.nonzero(dark)
    pitch = panel.size / dark.shape
    edges = [(np.ptp(columns) + 1) * pitch[0], (np.ptp(rows) + 1) * pitch[1]]
    np.testing.assert_allclose(edges, 0.08)
    known = target.known.tags[0].corners * panel.size[0] / 0.08  # the panel's are the square's, drawn out
    initial_T_tag = target.tags.panels[0].transform
    np.testing.assert_allclose(panel.corners, WORLD_T_INITIAL.apply(initial_T_tag.apply(known)), atol=1e-12)


def test_faces_become_panels_with_square_picture_elements():
    face = {"kind": "poster", "seed": 1, "size": [0.2, 0.15], "center": [0.0, 0.0, 0.5]}
    (panel,) = panels_of_target(TargetSection.model_validate({"textures": [face]}), WORLD_T_INITIAL)
    assert panel.picture.shape == (768, 1024)
    np.testing.assert_array_equal(panel.picture, texture("poster", 1, 768, 1024))
    np.testing.assert_allclose(panel.world_T_panel.translation, WORLD_T_INITIAL.apply([0, 0, 0.5]))
