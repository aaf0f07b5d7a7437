import json
import math

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import Target
from omniservo.errors import InputError
from omniservo.targets import Tag

TAG = {"dictionary": "tag36h11", "id": 3, "edge": 0.04}
POINT = {"name": "bolt", "position": [0.1, 0.0, 0.2]}


def document(**fields):
    return {"format": "omniservo.target/1"} | fields


def test_a_file_in_millimetres_and_degrees_is_kept_in_metres_and_radians(tmp_path):
    path = tmp_path / "target.yaml"
    path.write_text(
        "format: omniservo.target/1\n"
        "units: {length: mm, angle: deg}\n"
        "points:\n  - {name: bolt, position: [100, 0, -20]}\n"
        "tags:\n  - {dictionary: 4x4_50, id: 7, edge: 40, translation: [0, 10, 0],"
        " rotation_vector: [0, 90, 0]}\n"
    )
    target = Target.load(path)
    np.testing.assert_allclose(target.points, [[0.1, 0.0, -0.02]])
    (tag,) = target.tags
    assert (tag.dictionary, tag.id, tag.edge) == ("4x4_50", 7, 0.04)
    # turned by 90° about y: the tag's x is the target's −z, its y stays
    np.testing.assert_allclose(tag.corners[1], [0.0, 0.01 - 0.02, -0.02], atol=1e-15)


@pytest.mark.parametrize("name", ["target.json", "target.yaml"])
def test_saved_and_loaded_a_target_is_the_same(tmp_path, name):
    turned = RigidTransform.from_components([0.1, 0.2, 0.3], Rotation.from_rotvec([2.0, -1.0, 0.5]))
    target = Target(("a", "b"), np.array([[0, 0, 0], [0.1, 0, 1e-3]]), (Tag("tag36h11", 5, 0.03, turned),))
    target.save(tmp_path / name)
    again = Target.load(tmp_path / name)
    assert again.names == target.names
    np.testing.assert_array_equal(again.points, target.points)
    np.testing.assert_allclose(again.tags[0].corners, target.tags[0].corners, atol=1e-16)
    with pytest.raises(InputError, match="exists"):
        target.save(tmp_path / name)


def test_corners_stand_in_the_order_in_which_opencv_finds_them():
    """A drawn tag seen squarely by a camera with the tag's axes: found corners = projected corners."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    side, place = 120, np.array([40, 60])
    picture = np.full((240, 240), 255, np.uint8)
    picture[place[1] : place[1] + side, place[0] : place[0] + side] = dictionary.generateImageMarker(9, side)
    found, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(picture)
    assert ids.ravel().tolist() == [9]
    distance, edge = 0.3, 0.05
    tag = Tag("4x4_50", 9, edge, RigidTransform.from_translation([0.0, 0.0, distance]))
    projected = place + (side - 1) / 2 + tag.corners[:, :2] / distance * (side * distance / edge)
    np.testing.assert_allclose(found[0][0], projected, atol=1.0)


def test_image_points_join_by_number_and_strangers_are_named():
    target = Target.from_dict(document(points=[POINT], tags=[TAG, TAG | {"id": 1, "translation": [1, 0, 0]}]))
    corners, known = target.corners_of(np.array([4 * 1 + 2, 4 * 3, 99]))
    assert known.tolist() == [True, True, False]
    np.testing.assert_allclose(corners[:2], [[1.02, 0.02, 0.0], [-0.02, -0.02, 0.0]])
    assert np.isnan(corners[2]).all()
    points, known = target.points_of([0, 1])
    assert known.tolist() == [True, False]
    np.testing.assert_array_equal(points[0], POINT["position"])
    ids, corners = target.tag_corners()
    assert ids.tolist() == [12, 13, 14, 15, 4, 5, 6, 7]
    assert corners.shape == (8, 3)


def test_opencvs_name_of_a_dictionary_is_understood_as_where_tags_are_looked_for():
    target = Target.from_dict(document(tags=[TAG | {"dictionary": "DICT_APRILTAG_36h11"}]))
    assert target.dictionaries == ("tag36h11",)
    for name in ("DICT_APRILTAG_36H11", "tag36h11", None):
        assert target.tag_corners(name)[0].tolist() == [12, 13, 14, 15]
    with pytest.raises(InputError, match="tags: dictionary and id: .* given 2 times"):
        Target.from_dict(document(tags=[TAG, TAG | {"dictionary": "DICT_APRILTAG_36h11"}]))


def test_of_several_dictionaries_one_must_be_named():
    target = Target.from_dict(document(tags=[TAG, TAG | {"dictionary": "4x4_50"}]))
    with pytest.raises(InputError, match="dictionary: None given; legal: 4x4_50, tag36h11"):
        target.tag_corners()
    assert target.tag_corners("4x4_50")[0].tolist() == [12, 13, 14, 15]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ([], "a mapping with the fields"),
        ({"points": [POINT]}, "format: missing"),
        (document(format="omniservo.target/2", points=[POINT]), "format: 'omniservo.target/2' given"),
        (document(), "neither points nor tags"),
        (document(points=[]), "neither points nor tags"),
        (document(point=[POINT]), "point: no such field; legal: format, points, tags, units"),
        (document(points={"bolt": [0, 0, 0]}), "points: .* a list is needed"),
        (document(points=[POINT, POINT]), "points: name: 'bolt' given 2 times"),
        (document(points=[{"name": "bolt"}]), r"points\[0\]: position: missing"),
        (document(points=[POINT | {"size": 1}]), r"points\[0\]: size: no such field"),
        (document(points=[POINT | {"name": 3}]), "points: name: 3 given; text"),
        (document(points=[POINT | {"name": ""}]), "points: name: '' given; text"),
        (document(points=[POINT | {"position": [0, 0]}]), r"points\[0\]: position: shape \(2,\)"),
        (document(points=[POINT | {"position": [0, 0, math.nan]}]), r"points\[0\]: position: nan"),
        (document(points=[POINT | {"position": "here"}]), r"points\[0\]: position: 'here'"),
        (document(tags=[TAG, TAG]), r"tags: dictionary and id: \('tag36h11', 3\) given 2 times"),
        (document(tags=[TAG | {"edge": 0}]), r"tags\[0\]: edge: 0 given; legal: > 0"),
        (document(tags=[TAG | {"edge": math.inf}]), r"tags\[0\]: edge: inf"),
        (document(tags=[TAG | {"edge": "4 cm"}]), r"tags\[0\]: edge: '4 cm' given; a number"),
        (document(tags=[TAG | {"id": -1}]), r"tags\[0\]: id: -1 given; legal: whole numbers from 0"),
        (document(tags=[TAG | {"id": 1.5}]), r"tags\[0\]: id: 1.5"),
        (document(tags=[TAG | {"id": True}]), r"tags\[0\]: id: True"),
        (document(tags=[TAG | {"id": 587}]), r"tags\[0\]: id: 587 given; legal: whole numbers from 0 to 586"),
        (document(tags=[TAG | {"dictionary": 4}]), r"tags\[0\]: dictionary: 4 given; legal: 4x4_100, "),
        (document(tags=[TAG | {"quaternion": [0, 0, 0, 2]}]), r"tags\[0\]: quaternion: norm 2"),
        (
            document(tags=[TAG | {"quaternion": [0, 0, 0, 1], "rotation_vector": [0, 0, 0]}]),
            r"tags\[0\]: quaternion and rotation_vector given",
        ),
        (
            document(tags=[TAG | {"rotation_vector": [1e300, 0, 0]}]),
            r"tags\[0\]: rotation_vector: \[1e\+300, 0.0, 0.0\] given; legal: -1e6 to 1e6",
        ),
        (document(tags=[TAG | {"translation": [0, 0, 1e400]}]), r"tags\[0\]: translation: inf"),
        (document(tags=[TAG | {"translation": [1.7e308, 0, 0], "edge": 1.7e308}]), "corners"),
        (document(units={"length": "inch"}, tags=[TAG]), "units.length: 'inch' given; legal: m, cm, mm"),
        (document(units={"length": ["m"]}, tags=[TAG]), "units.length: .* given; legal: m, cm, mm"),
        (document(units="mm", tags=[TAG]), "units: 'mm' given"),
    ],
)
def test_a_wrong_document_is_one_message_that_names_the_field(fields, message):
    with pytest.raises(InputError, match=message) as caught:
        Target.from_dict(fields, "board.yaml")
    assert str(caught.value).startswith("board.yaml: ")
    assert "\n" not in str(caught.value)


def test_a_nan_in_a_json_file_is_refused(tmp_path):
    path = tmp_path / "target.json"
    path.write_text(json.dumps(document(points=[POINT | {"position": [0, math.nan, 0]}])))
    with pytest.raises(InputError, match="position: nan"):
        Target.load(path)


def test_points_and_names_must_be_as_many():
    with pytest.raises(InputError, match="points: 1 given for 2 names"):
        Target(("a", "b"), np.zeros((1, 3)))


def test_ids_must_be_whole_numbers():
    target = Target.from_dict(document(points=[POINT]))
    with pytest.raises(InputError, match="ids: float64"):
        target.points_of([0.5])
    assert target.points_of([])[0].shape == (0, 3)
