"""What files of every format say, and the cameras that they are."""

import json
import math
from dataclasses import replace

import yaml

from omniservo.cameras import DeadZone, UnifiedCamera
from omniservo.cameras.models import (
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    OcamPolynomial,
    Pinhole,
)

OMNIDIR = UnifiedCamera(610.5, 612.25, 639.5, 479.0, 1.125, 1280, 960, distortion=(-0.2, 0.06, 1e-3, -2e-3))
FISHEYE = KannalaBrandt(311.0, 312.0, 320.25, 239.5, 640, 480, k=(0.01, -0.02, 0.003, -0.0004))
BROWN = Pinhole(611.0, 612.0, 320.25, 239.5, 640, 480, distortion=(-0.3, 0.1, 1e-3, -2e-3, 0.02))
RATIONAL = Pinhole(
    611.0, 612.0, 320.25, 239.5, 640, 480, distortion=(0.3, 0.1, 1e-3, -2e-3, 0.02, 0.31, 0.12, 0.03)
)
RADTAN = Pinhole(611.0, 612.0, 320.25, 239.5, 640, 480, distortion=(-0.3, 0.1, 1e-3, -2e-3))
PLAIN = Pinhole(611.0, 612.0, 320.25, 239.5, 640, 480)
OCAM = OcamPolynomial(
    (-153.5, 0.0, 1e-3, 5e-6, -5.7e-9), 456.25, 382.5, 1024, 768, stretch=(1.001, -6e-4, 4e-4)
)

SIZE_640 = "image_width: 640\nimage_height: 480\n"
SIZE_1280 = "image_width: 1280\nimage_height: 960\n"
K_DATA = "[611., 0., 320.25, 0., 612., 239.5, 0., 0., 1.]"
CV_K = f"camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {K_DATA}\n"
ROS_FILE = (
    SIZE_640
    + f"camera_name: left\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: {K_DATA}\ndistortion_model: MODEL\n"
    + "distortion_coefficients:\n  rows: 1\n  cols: COUNT\n  data: VALUES\n"
    + "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
    + "projection_matrix:\n  rows: 3\n  cols: 4\n  data: [600, 0, 321, 0, 0, 601, 240, 0, 0, 0, 1, 0]\n"
)


def ros_file(model, values):
    return (
        ROS_FILE.replace("MODEL", model)
        .replace("COUNT", str(len(values)))
        .replace("VALUES", str(list(values)))
    )


def cv_xml(*fields):
    return '<?xml version="1.0"?>\n<opencv_storage>\n' + "\n".join(fields) + "\n</opencv_storage>\n"


def cv_matrix(name, rows, cols, data, kind="d"):
    return (
        f'<{name} type_id="opencv-matrix"><rows>{rows}</rows><cols>{cols}</cols><dt>{kind}</dt>\n'
        f"  <data>\n    {data}</data></{name}>"
    )


def cv_yaml(count, values, more=""):
    rows = "distortion_coefficients: !!opencv-matrix\n"
    rows += f"   rows: {count}\n   cols: 1\n   dt: d\n   data: {values}\n"
    return "%YAML:1.0\n---\n" + SIZE_640 + more + CV_K + rows


def kalibr(model, intrinsics, distortion="none", coefficients=(), size=(640, 480)):
    return (
        f"cam0:\n  camera_model: {model}\n  intrinsics: {list(intrinsics)}\n"
        f"  distortion_model: {distortion}\n"
        f"  distortion_coeffs: {list(coefficients)}\n  resolution: {list(size)}\n"
    )


def basalt(kind, size=(640, 480), **numbers):
    other = {"camera_type": "ds", "intrinsics": {"fx": 1, "fy": 1, "cx": 1, "cy": 1, "xi": 0, "alpha": 0.5}}
    cameras = [other, {"camera_type": kind, "intrinsics": numbers}]
    value = {
        "T_imu_cam": [],
        "intrinsics": cameras,
        "resolution": [[2, 2], list(size)],
        "imu_update_rate": 200.0,
    }
    return json.dumps({"value0": value})


def camodocal(kind, groups):
    head = f"%YAML:1.0\n---\nmodel_type: {kind}\ncamera_name: camera\n"
    return head + SIZE_640 + yaml.safe_dump(groups)


FOUR = {"fx": 611.0, "fy": 612.0, "cx": 320.25, "cy": 239.5}
BOOF = {**FOUR, "cx": 320.75, "cy": 240.0, "width": 640, "height": 480, "skew": 0.0}

VISP = """<?xml version="1.0"?>
<root>
  <!--camera-->
  <camera>
    <name>Camera</name>
    <image_width>640</image_width>
    <image_height>480</image_height>
    <model>
      <type>KIND</type>
      <px>611.0</px>
      <py>612.0</py>
      <u0>320.25</u0>
      <v0>239.5</v0>
MORE    </model>
  </camera>
</root>
"""

OCAM_TEXT = """#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB).

5 -1.535000e+02 0.000000e+00 1.000000e-03 5.000000e-06 -5.700000e-09

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB).

3 275.7 217.9 71.1

#center: "row" and "column", starting from 0 (C convention)

382.5 456.25

#affine parameters "c", "d", "e"

1.001 -0.0006 0.0004

#image size: "height" and "width"

768 1024
"""

SVO = """label: rig
cameras:
- camera:
    label: cam0
    image_height: 768
    image_width: 1024
    type: omni
    intrinsics:
      cols: 1
      rows: 24
      data: [-153.5, 0.0, 1.0e-03, 5.0e-06, -5.7e-09, 456.25, 382.5, 1.001, -0.0006, 0.0004, 1, 2,
        3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 0.0, 1.0]
    distortion: {type: none, parameters: {cols: 1, rows: 0, data: []}}
- camera:
    label: cam1
    image_height: 480
    image_width: 640
    type: pinhole
    intrinsics: {cols: 1, rows: 4, data: [311, 312, 320.25, 239.5]}
    distortion: {type: equidistant, parameters: {cols: 1, rows: 4, data: [0.01, -0.02, 0.003, -0.0004]}}
"""

COLMAP = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
1 SIMPLE_PINHOLE 640 480 611 320.75 240
2 PINHOLE 640 480 611 612 320.75 240
3 SIMPLE_RADIAL 640 480 611 320.75 240 -0.1
4 RADIAL 640 480 611 320.75 240 -0.1 0.02
5 OPENCV 640 480 611 612 320.75 240 -0.3 0.1 0.001 -0.002
6 OPENCV_FISHEYE 640 480 311 312 320.75 240 0.01 -0.02 0.003 -0.0004
7 FULL_OPENCV 640 480 611 612 320.75 240 0.3 0.1 0.001 -0.002 0.02 0.31 0.12 0.03
8 RADIAL_FISHEYE 640 480 311 320.75 240 0.01 -0.02
9 THIN_PRISM_FISHEYE 640 480 311 312 320.75 240 0.01 -0.02 0 0 0 0 0 0
10 SIMPLE_FISHEYE 640 480 311 320.75 240
11 FISHEYE 640 480 311 312 320.75 240
12 EUCM 640 480 191 192 320.75 240 0.63 1.04
"""

OMNI_FIELDS = (
    "<image_width>1280</image_width><image_height>960</image_height>",
    cv_matrix("camera_matrix", 3, 3, "6.105e+02 0. 6.395e+02 0. 612.25\n    479. 0. 0. 1."),
    cv_matrix("distortion_coefficients", 1, 4, "-0.2 6.0000000000000000e-02 1e-3 -2e-3"),
)
STEREO = (
    f"%YAML:1.0\n---\nimage_size: [640, 480]\n{CV_K.replace('camera_matrix', 'M1')}"
    "D1: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [-0.3, 0.1, 0.001, -0.002, 0.02]\n"
    f"{CV_K.replace('camera_matrix', 'M2')}"
    "D2: !!opencv-matrix\n   rows: 1\n   cols: 8\n   dt: d\n"
    "   data: [0.3, 0.1, 0.001, -0.002, 0.02, 0.31, 0.12, 0.03]\n"
)
MESSAGE = f"""header:
  seq: 0
  stamp: {{secs: 0, nsecs: 0}}
  frame_id: "camera"
height: 480
width: 640
distortion_model: "plumb_bob"
D: [-0.3, 0.1, 0.001, -0.002, 0.02]
K: {K_DATA}
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [600.0, 0.0, 321.0, 0.0, 0.0, 601.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: {{x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: False}}
---
"""

ORB_SLAM = """%YAML:1.0

# Camera Parameters
File.version: "1.0"
Camera.type: "KannalaBrandt8"
Camera1.fx: 311.0
Camera1.fy: 312.0
Camera1.cx: 320.25
Camera1.cy: 239.5
Camera1.k1: 0.01
Camera1.k2: -0.02
Camera1.k3: 0.003
Camera1.k4: -0.0004
Camera2.fx: 300.0
Camera2.fy: 300.0
Camera2.cx: 320.0
Camera2.cy: 240.0
Camera2.k1: 0.0
Camera2.k2: 0.0
Camera2.k3: 0.0
Camera2.k4: 0.0
Camera.width: 640
Camera.height: 480
Camera.newWidth: 320
Camera.fps: 30
Stereo.T_c1_c2: !!opencv-matrix
   rows: 4
   cols: 4
   dt: f
   data: [1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
ORBextractor.nFeatures: 1000
"""

OKVIS = (
    "%YAML:1.0\ncameras:\n"
    "     - {T_SC:\n        [ 1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, 0.0,\n"
    "          0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],\n"
    "        image_dimension: [640, 480],\n        distortion_coefficients: [0.01, -0.02, 0.003, -0.0004],\n"
    "        distortion_type: equidistant,\n        focal_length: [311.0, 312.0],\n"
    "        principal_point: [320.25, 239.5]}\n"
    "     - {image_dimension: [640, 480],\n"
    f"        distortion_coefficients: {list(RATIONAL.distortion)},\n"
    "        distortion_type: radialtangential8,\n        focal_length: [611.0, 612.0],\n"
    "        principal_point: [320.25, 239.5]}\n"
    "camera_params:\n    camera_rate: 30 # of both\n"
)

PY_OCAM = {
    "date": "18052022_154907",
    "camera_name": "a fisheye",
    "valid": [True, False],
    "taylor_coefficient": [338.0, 0.0, -1.2e-3, 1.4e-6, -3.0e-9],
    "distortion_center": [544.0, 377.5],
    "stretch_matrix": [[1.0, 1.5e-4], [1.75e-4, 1.0]],
    "inverse_poly": [-1.35, 12.9, 338.0],
    "rms_overall": 0.24,
}
OCAM_OF_PY = OcamPolynomial(
    (-338.0, 0.0, 1.2e-3, -1.4e-6, 3.0e-9), 544.0, 377.5, 1032, 778, stretch=(1.0, 1.75e-4, 1.5e-4)
)

EUROC = (
    "# General sensor definitions.\nsensor_type: camera\ncomment: a camera\n"
    "T_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
    "rate_hz: 20\nresolution: [640, 480]\ncamera_model: pinhole\n"
    "intrinsics: [FOCAL, 320.25, 239.5] #fu, fv, cu, cv\ndistortion_model: KIND\n"
    "distortion_coefficients: VALUES\n"
)


def euroc(kind, focal, values):
    return EUROC.replace("KIND", kind).replace("FOCAL", focal).replace("VALUES", str(list(values)))


MAPLAB_CAMERA = {
    "label": "cam0",
    "image_height": 480,
    "image_width": 640,
    "type": "pinhole",
    "intrinsics": {"cols": 1, "rows": 4, "data": [611.0, 612.0, 320.25, 239.5]},
    "distortion": {
        "type": "radial-tangential",
        "parameters": {"cols": 1, "rows": 4, "data": list(RADTAN.distortion)},
    },
}
MAPLAB_SENSORS = [{"sensor_type": "IMU"}, {"sensor_type": "NCAMERA", "cameras": [{"camera": MAPLAB_CAMERA}]}]

REALSENSE = """Device info:
    Name                          : \tIntel RealSense D4
Intrinsic Parameters:

 Intrinsic of "Color" / 640x480 / {YUYV/RGB8}
  Width:      \t640
  Height:     \t480
  PPX:        \t320.25
  PPY:        \t239.5
  Fx:         \t611
  Fy:         \t612
  Distortion: \tInverse Brown Conrady
  Coeffs:     \t-0.3  \t0.1  \t0.001  \t-0.002  \t0.02
  FOV (deg):  \t55.3 x 42.9

 Intrinsic of "Fisheye 1" / 640x480 / {Y8}
  Width:      \t640
  Height:     \t480
  PPX:        \t320.25
  PPY:        \t239.5
  Fx:         \t311
  Fy:         \t312
  Distortion: \tKannala Brandt4
  Coeffs:     \t0.01  \t-0.02  \t0.003  \t-0.0004  \t0
  FOV (deg):  \t110 x 80

Extrinsic from "Color"\t  To\t  "Depth" :
 Rotation Matrix:
   1 0 0
"""

OST_IMAGE = "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n"


def ost_camera(name, focal, distortion):
    matrix = (
        f"{focal:.6f} 0.000000 320.250000\n0.000000 {focal + 1:.6f} 239.500000\n0.000000 0.000000 1.000000\n"
    )
    numbers = " ".join(f"{number:.6f}" for number in distortion)
    return f"[{name}]\n\ncamera matrix\n{matrix}\ndistortion\n{numbers}\n\nrectification\n{matrix}\n"


OST_PAIR = (
    OST_IMAGE
    + ost_camera("stereo/left", 9.0, ())
    + OST_IMAGE
    + ost_camera("stereo/right", 611.0, BROWN.distortion)
)

METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="2">
      <sensor id="0" label="frame" type="frame">
        <resolution width="640" height="480"/>
        <calibration type="frame" class="initial">
          <resolution width="640" height="480"/>
          <f>600</f>
        </calibration>
        <calibration type="frame" class="adjusted">
          <resolution width="640" height="480"/>
          <f>612</f><cx>0.75</cx><cy>0</cy><b1>-1</b1>
          <k1>-0.3</k1><k2>0.1</k2><k3>0.02</k3><p1>-0.002</p1><p2>0.001</p2>
        </calibration>
      </sensor>
      <sensor id="1" label="wide" type="fisheye">
        <calibration type="fisheye" class="adjusted">
          <resolution width="640" height="480"/>
          <f>312</f><cx>0.75</cx><b1>-1</b1>
          <k1>0.01</k1><k2>-0.02</k2><k3>0.003</k3><k4>-0.0004</k4>
        </calibration>
      </sensor>
    </sensors>
  </chunk>
</document>
"""
METASHAPE_ALONE = (
    '<?xml version="1.0"?><calibration><projection>equidistant_fisheye</projection><width>640</width>'
    "<height>480</height><f>312</f><cx>0.75</cx><b1>-1</b1><k1>0.01</k1><k2>-0.02</k2><k3>0.003</k3>"
    "<k4>-0.0004</k4><date>2022-01-01T00:00:00Z</date></calibration>"
)

NERF = {"w": 640, "h": 480, "fl_x": 611.0, "fl_y": 612.0, "cx": 320.75, "cy": 240.0, "frames": []}


def oak(kind, focal, coefficients):
    return {
        "cameraType": kind,
        "width": 640,
        "height": 480,
        "intrinsicMatrix": [[focal, 0.0, 320.25], [0.0, focal + 1.0, 239.5], [0.0, 0.0, 1.0]],
        "distortionCoeff": [*coefficients, *[0.0] * 14][:14],
    }


DEPTHAI = json.dumps(
    {"cameraData": [[0, oak(0, 611.0, RATIONAL.distortion)], [2, oak(1, 311.0, FISHEYE.k)]], "version": 7}
)


def mrcal(lens, distortion):
    """A .cameramodel as mrcal writes it, comments and all."""
    numbers = ", ".join(map(repr, (611.0, 612.0, 320.25, 239.5, *distortion)))
    return f"""# generated on 2024-05-03 with mrcal-calibrate-cameras --corners-cache corners.vnl
{{
    'lensmodel':  '{lens}',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ {numbers},],

    'valid_intrinsics_region': [
    [ 0, 0 ],
    [ 0, 479 ],
],

    # extrinsics are rt_fromref
    'extrinsics': [ 0, 0, 0, 0, 0, 0,],

    'imagersize': [ 640, 480,],

    'optimization_inputs': b'P)h>@6aWAK2mk;8Apq{{0]`tP004Ch000jF003}}la4%n9X>MtBUtcb8c~',
}}
"""


SAMPLES = {
    "mrcal, OPENCV8": (mrcal("LENSMODEL_OPENCV8", RATIONAL.distortion), {}, RATIONAL),
    "mrcal, OPENCV4, no comment before": (
        mrcal("LENSMODEL_OPENCV4", RADTAN.distortion).partition("\n")[2],
        {},
        RADTAN,
    ),
    "mrcal, an older file": (
        mrcal("LENSMODEL_OPENCV8", RATIONAL.distortion).replace("'lensmodel'", "'lens_model'"),
        {},
        RATIONAL,
    ),
    "mrcal, OPENCV12": (
        mrcal("LENSMODEL_OPENCV12", (*RATIONAL.distortion, 1e-3, -1e-3, 2e-3, 5e-4)),
        {},
        replace(RATIONAL, distortion=(*RATIONAL.distortion, 1e-3, -1e-3, 2e-3, 5e-4)),
    ),
    "mrcal, PINHOLE": (mrcal("LENSMODEL_PINHOLE", ()), {}, PLAIN),
    "EuRoC, radial-tangential": (euroc("radial-tangential", "611, 612", RADTAN.distortion), {}, RADTAN),
    "EuRoC, equidistant": (euroc("equidistant", "311, 312", FISHEYE.k), {}, FISHEYE),
    "maplab, one camera alone": (json.dumps(MAPLAB_CAMERA), {}, RADTAN),
    "maplab, a list of sensors": (json.dumps({"sensors": MAPLAB_SENSORS}), {"name": "cam0"}, RADTAN),
    "RealSense, colour": (REALSENSE, {"name": "Color-640x480"}, BROWN),
    "RealSense, fisheye": (REALSENSE, {"name": "Fisheye 1-640x480"}, FISHEYE),
    "ROS ost.txt": (OST_IMAGE + ost_camera("narrow_stereo", 611.0, RATIONAL.distortion), {}, RATIONAL),
    "ROS ost.txt of a pair": (OST_PAIR, {"name": "stereo/right"}, BROWN),
    "ROS ost.txt, the caller says fisheye": (
        OST_IMAGE + ost_camera("camera", 311.0, FISHEYE.k),
        {"model": "fisheye"},
        FISHEYE,
    ),
    "Metashape, frame": (METASHAPE, {"name": "frame"}, BROWN),
    "Metashape, fisheye": (METASHAPE, {"name": "wide"}, FISHEYE),
    "Metashape, a calibration alone": (METASHAPE_ALONE, {}, FISHEYE),
    "nerfstudio, OPENCV": (
        json.dumps({**NERF, "camera_model": "OPENCV", "k1": -0.3, "k2": 0.1, "p1": 1e-3, "p2": -2e-3}),
        {},
        RADTAN,
    ),
    "nerfstudio, OPENCV_FISHEYE": (
        json.dumps(
            {
                **NERF,
                "camera_model": "OPENCV_FISHEYE",
                "fl_x": 311.0,
                "fl_y": 312.0,
                **{f"k{i + 1}": FISHEYE.k[i] for i in range(4)},
            }
        ),
        {},
        FISHEYE,
    ),
    "instant-ngp, an angle and no size": (
        json.dumps({"camera_angle_x": 2.0 * math.atan(0.5), "frames": []}),
        {"size": (640, 480)},
        Pinhole(640.0, 640.0, 319.5, 239.5, 640, 480),
    ),
    "DepthAI, perspective": (DEPTHAI, {"name": "0"}, RATIONAL),
    "DepthAI, fisheye": (DEPTHAI, {"name": "2"}, FISHEYE),
    "ROS plumb_bob with eight numbers": (ros_file("plumb_bob", RATIONAL.distortion), {}, RATIONAL),
    "ROS rational_polynomial with five": (ros_file("rational_polynomial", BROWN.distortion), {}, BROWN),
    "ROS equidistant with a zero more": (
        ros_file("equidistant", (*FISHEYE.k, 0.0)),
        {},
        KannalaBrandt(611.0, 612.0, 320.25, 239.5, 640, 480, k=FISHEYE.k),
    ),
    "ROS fisheye": (
        ros_file("fisheye", FISHEYE.k),
        {},
        KannalaBrandt(611.0, 612.0, 320.25, 239.5, 640, 480, k=FISHEYE.k),
    ),
    "ORB-SLAM3, the first of a stereo fisheye": (ORB_SLAM, {"name": "Camera1"}, FISHEYE),
    "ORB-SLAM2, five coefficients, size from the caller": (
        "%YAML:1.0\n\nCamera.fx: 611.0\nCamera.fy: 612.0\nCamera.cx: 320.25\nCamera.cy: 239.5\n"
        "Camera.k1: -0.3\nCamera.k2: 0.1\nCamera.p1: 1.0e-3\nCamera.p2: -2.0e-3\nCamera.k3: 0.02\n"
        "Camera.fps: 30.0\nCamera.RGB: 1\n",
        {"size": (640, 480)},
        BROWN,
    ),
    "ORB-SLAM3, four coefficients": (
        'Camera.type: "PinHole"\nCamera.fx: 611.0\nCamera.fy: 612.0\nCamera.cx: 320.25\nCamera.cy: 239.5\n'
        "Camera.k1: -0.3\nCamera.k2: 0.1\nCamera.p1: 0.001\nCamera.p2: -0.002\n"
        "Camera.width: 640\nCamera.height: 480\n",
        {},
        RADTAN,
    ),
    "stella_vslam, fisheye": (
        'System:\n  map_format: "msgpack"\nCamera:\n  name: "a fisheye"\n'
        '  setup: "monocular"\n  model: "fisheye"\n'
        "  fx: 311.0\n  fy: 312.0\n  cx: 320.25\n  cy: 239.5\n  k1: 1.0e-02\n  k2: -0.02\n  k3: 0.003\n"
        '  k4: -4.0e-04\n  fps: 30.0\n  cols: 640\n  rows: 480\n  color_order: "RGB"\n',
        {},
        FISHEYE,
    ),
    "OpenVSLAM, perspective": (
        'Camera.name: "a camera"\nCamera.setup: "monocular"\nCamera.model: "perspective"\nCamera.fx: 611.0\n'
        "Camera.fy: 612.0\nCamera.cx: 320.25\nCamera.cy: 239.5\nCamera.k1: -0.3\nCamera.k2: 0.1\n"
        "Camera.p1: 0.001\nCamera.p2: -0.002\nCamera.k3: 0.02\nCamera.fps: 30.0\nCamera.cols: 640\n"
        "Camera.rows: 480\n",
        {},
        BROWN,
    ),
    "OKVIS, equidistant": (OKVIS, {"name": "cam0"}, FISHEYE),
    "OKVIS, eight coefficients": (OKVIS, {"name": "cam1"}, RATIONAL),
    "py-OCamCalib, size from the caller": (json.dumps(PY_OCAM), {"size": (1032, 778)}, OCAM_OF_PY),
    "ORB-SLAM3, rectified": (
        'Camera.type: "Rectified"\nCamera1.fx: 611.0\nCamera1.fy: 612.0\nCamera1.cx: 320.25\n'
        "Camera1.cy: 239.5\nCamera.width: 640\nCamera.height: 480\n",
        {},
        PLAIN,
    ),
    "own, another model": (json.dumps({"format": "omniservo.camera/1", **FISHEYE.to_dict()}), {}, FISHEYE),
    "OpenCV omnidir, XML, xi a number": (cv_xml(*OMNI_FIELDS, "<xi>1.125</xi>"), {}, OMNIDIR),
    "OpenCV omnidir, XML, xi a matrix": (cv_xml(*OMNI_FIELDS, cv_matrix("xi", 1, 1, "1.125")), {}, OMNIDIR),
    "OpenCV omnidir, short names, size from the caller": (
        "K: [[610.5, 0, 639.5], [0, 612.25, 479], [0, 0, 1]]\n"
        "D: [[-0.2, 0.06, 0.001, -0.002]]\nxi: [[1.125]]\n",
        {"size": (1280, 960)},
        OMNIDIR,
    ),
    "OpenCV fisheye, as its sample writes it": (
        cv_yaml(4, "[0.01, -0.02, 0.003, -4.0e-04]", "fisheye_model: 1\n"),
        {},
        FISHEYE.__class__(611.0, 612.0, 320.25, 239.5, 640, 480, k=FISHEYE.k),
    ),
    "OpenCV fisheye, said by distortion_model in JSON": (
        json.dumps(
            {
                "imageSize": [640, 480],
                "cameraMatrix": [[311, 0, 320.25], [0, 312, 239.5], [0, 0, 1]],
                "distCoeffs": [[0.01], [-0.02], [0.003], [-0.0004]],
                "camera_model": "fisheye",
            }
        ),
        {},
        FISHEYE,
    ),
    "OpenCV, four numbers, the caller says pinhole": (
        cv_yaml(4, "[-0.3, 0.1, 1.0e-03, -2.0e-03]"),
        {"model": "pinhole"},
        RADTAN,
    ),
    "OpenCV pinhole, fisheye_model 0": (
        cv_yaml(4, "[-0.3, 0.1, 1.0e-03, -2.0e-03]", "fisheye_model: 0\n"),
        {},
        RADTAN,
    ),
    "OpenCV pinhole, five": (cv_yaml(5, "[-0.3, 0.1, 1.0e-03, -2.0e-03, 2.0e-02]"), {}, BROWN),
    "OpenCV pinhole, eight": (cv_yaml(8, str(list(RATIONAL.distortion))), {}, RATIONAL),
    "OpenCV pinhole, none": ("%YAML:1.0\n---\n" + SIZE_640 + CV_K, {}, PLAIN),
    "OpenCV stereo, first": (STEREO, {"name": "1"}, BROWN),
    "OpenCV stereo, second": (STEREO, {"name": "2"}, RATIONAL),
    "Kalibr omni-radtan": (
        kalibr("omni", (1.125, 610.5, 612.25, 639.5, 479.0), "radtan", OMNIDIR.distortion, (1280, 960)),
        {},
        OMNIDIR,
    ),
    "Kalibr eucm": (
        kalibr("eucm", (0.63, 1.04, 191.0, 192.0, 320.25, 239.5)),
        {},
        ExtendedUnified(191.0, 192.0, 320.25, 239.5, 0.63, 1.04, 640, 480),
    ),
    "Kalibr ds": (
        kalibr("ds", (-0.2, 0.6, 317.5, 316.25, 320.25, 239.5)),
        {},
        DoubleSphere(317.5, 316.25, 320.25, 239.5, -0.2, 0.6, 640, 480),
    ),
    "Kalibr pinhole-equidistant": (
        kalibr("pinhole", (311.0, 312.0, 320.25, 239.5), "equidistant", FISHEYE.k),
        {},
        FISHEYE,
    ),
    "Kalibr pinhole-radtan": (
        kalibr("pinhole", (611.0, 612.0, 320.25, 239.5), "radtan", RADTAN.distortion),
        {},
        RADTAN,
    ),
    "Kalibr pinhole-none": (kalibr("pinhole", (611.0, 612.0, 320.25, 239.5)), {}, PLAIN),
    "CamOdoCal KANNALA_BRANDT": (
        camodocal(
            "KANNALA_BRANDT",
            {
                "projection_parameters": {
                    **dict(zip(("k2", "k3", "k4", "k5"), FISHEYE.k, strict=True)),
                    "mu": 311.0,
                    "mv": 312.0,
                    "u0": 320.25,
                    "v0": 239.5,
                }
            },
        ),
        {},
        FISHEYE,
    ),
    "CamOdoCal PINHOLE": (
        camodocal(
            "PINHOLE",
            {
                "distortion_parameters": {"k1": -0.3, "k2": 0.1, "p1": 1e-3, "p2": -2e-3},
                "projection_parameters": FOUR,
            },
        ),
        {},
        RADTAN,
    ),
    "Basalt ds": (
        basalt("ds", **FOUR, xi=-0.2, alpha=0.6),
        {"name": "cam1"},
        DoubleSphere(611.0, 612.0, 320.25, 239.5, -0.2, 0.6, 640, 480),
    ),
    "Basalt eucm": (
        basalt("eucm", **FOUR, alpha=0.6, beta=1.1),
        {"name": "cam1"},
        ExtendedUnified(611.0, 612.0, 320.25, 239.5, 0.6, 1.1, 640, 480),
    ),
    "Basalt ucm": (
        basalt("ucm", **FOUR, alpha=0.5),
        {"name": "cam1"},
        UnifiedCamera(1222.0, 1224.0, 320.25, 239.5, 1.0, 640, 480),
    ),
    "Basalt kb4": (
        basalt(
            "kb4",
            **{**FOUR, "fx": 311.0, "fy": 312.0},
            **{f"k{i + 1}": FISHEYE.k[i] for i in range(4)},
        ),
        {"name": "cam1"},
        FISHEYE,
    ),
    "Basalt pinhole-radtan8": (
        basalt(
            "pinhole-radtan8",
            **FOUR,
            **dict(zip(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), RATIONAL.distortion, strict=True)),
            rpmax=0.0,
        ),
        {"name": "cam1"},
        RATIONAL,
    ),
    "Basalt pinhole": (basalt("pinhole", **FOUR), {"name": "cam1"}, PLAIN),
    "ROS plumb_bob": (ros_file("plumb_bob", BROWN.distortion), {}, BROWN),
    "ROS rational_polynomial": (
        ros_file("rational_polynomial", RATIONAL.distortion),
        {"name": "left"},
        RATIONAL,
    ),
    "ROS equidistant": (
        ros_file("equidistant", FISHEYE.k),
        {},
        KannalaBrandt(611.0, 612.0, 320.25, 239.5, 640, 480, k=FISHEYE.k),
    ),
    "ROS message": (MESSAGE, {}, BROWN),
    "ROS 2 message": (MESSAGE.replace("D:", "d:").replace("K:", "k:").replace("P:", "p:"), {}, BROWN),
    "OCamCalib": (OCAM_TEXT, {}, OCAM),
    "SVO omni": (SVO, {"name": "cam0"}, OCAM),
    "SVO pinhole, equidistant": (SVO, {"name": "cam1"}, FISHEYE),
    "BoofCV universal": (
        yaml.safe_dump(
            {
                "model": "omnidirectional_universal",
                "version": 0,
                "pinhole": {
                    "fx": 610.5,
                    "fy": 612.25,
                    "cx": 640,
                    "cy": 479.5,
                    "skew": 0,
                    "width": 1280,
                    "height": 960,
                },
                "radial_tangential": {"radial": [-0.2, 0.06], "t1": 1e-3, "t2": -2e-3},
                "mirror_offset": 1.125,
            }
        ),
        {},
        OMNIDIR,
    ),
    "BoofCV pinhole, radial": (
        yaml.safe_dump(
            {
                "model": "pinhole_radial_tangential",
                "pinhole": BOOF,
                "radial_tangential": {"radial": [-0.3, 0.1, 0.02], "t1": 1e-3, "t2": -2e-3},
            }
        ),
        {},
        BROWN,
    ),
    "BoofCV Kannala-Brandt": (
        yaml.safe_dump(
            {
                "model": "kannala_brandt",
                "pinhole": {**BOOF, "fx": 622.0, "fy": 624.0},
                "symmetric": [0.5, 0.005, -0.01, 0.0015, -0.0002],
                "radial": [],
                "tangent": [0.0],
            }
        ),
        {},
        FISHEYE,
    ),
    "BoofCV stereo": (
        yaml.safe_dump(
            {"model": "stereo_camera", "left": {}, "right": {"model": "pinhole", "pinhole": BOOF}}
        ),
        {"name": "right"},
        PLAIN,
    ),
    "COLMAP SIMPLE_PINHOLE": (COLMAP, {"name": "1"}, Pinhole(611.0, 611.0, 320.25, 239.5, 640, 480)),
    "COLMAP PINHOLE": (COLMAP, {"name": "2"}, PLAIN),
    "COLMAP SIMPLE_RADIAL": (
        COLMAP,
        {"name": "3"},
        Pinhole(611.0, 611.0, 320.25, 239.5, 640, 480, distortion=(-0.1, 0.0, 0.0, 0.0)),
    ),
    "COLMAP RADIAL": (
        COLMAP,
        {"name": "4"},
        Pinhole(611.0, 611.0, 320.25, 239.5, 640, 480, distortion=(-0.1, 0.02, 0.0, 0.0)),
    ),
    "COLMAP OPENCV": (COLMAP, {"name": "5"}, RADTAN),
    "COLMAP OPENCV_FISHEYE": (COLMAP, {"name": "6"}, FISHEYE),
    "COLMAP FULL_OPENCV": (COLMAP, {"name": "7"}, RATIONAL),
    "COLMAP RADIAL_FISHEYE": (
        COLMAP,
        {"name": "8"},
        KannalaBrandt(311.0, 311.0, 320.25, 239.5, 640, 480, k=(0.01, -0.02, 0.0, 0.0)),
    ),
    "COLMAP SIMPLE_FISHEYE": (
        COLMAP,
        {"name": "10"},
        KannalaBrandt(311.0, 311.0, 320.25, 239.5, 640, 480, k=(0.0, 0.0, 0.0, 0.0)),
    ),
    "COLMAP FISHEYE": (
        COLMAP,
        {"name": "11"},
        KannalaBrandt(311.0, 312.0, 320.25, 239.5, 640, 480, k=(0.0, 0.0, 0.0, 0.0)),
    ),
    "COLMAP EUCM": (
        COLMAP,
        {"name": "12"},
        ExtendedUnified(191.0, 192.0, 320.25, 239.5, 0.63, 1.04, 640, 480),
    ),
    "Mei toolbox, single values": (
        '{"xi": 1.125, "k1": -0.2, "k2": 0.06, "p1": 0.001, "p2": -0.002, "fx": 610.5, "fy": 612.25,'
        ' "cx": 639.5,'
        ' "cy": 479}',
        {"size": (1280, 960)},
        OMNIDIR,
    ),
    "Mei toolbox, its arrays": (
        "xi: 1.125\nkc: [-0.2, 0.06, 0.001, -0.002, 0]\n"
        "gammac: [610.5, 612.25]\ncc: [639.5, 479]\nalpha_c: 0\n",
        {"size": (1280, 960)},
        OMNIDIR,
    ),
    "ViSP without distortion": (
        VISP.replace("KIND", "perspectiveProjWithoutDistortion").replace("MORE", ""),
        {},
        PLAIN,
    ),
    "ViSP with distortion": (
        VISP.replace("KIND", "perspectiveProjWithDistortion").replace(
            "MORE", "<kud>-0.1</kud><kdu>0.11</kdu>"
        ),
        {"name": "Camera"},
        Pinhole(611.0, 612.0, 320.25, 239.5, 640, 480, distortion=(-0.1, 0.0, 0.0, 0.0)),
    ),
    "ViSP Kannala-Brandt": (
        VISP.replace("KIND", "ProjWithKannalaBrandtDistortion").replace(
            "MORE", "<k1>0.01</k1><k2>-0.02</k2><k3>0.003</k3><k4>-0.0004</k4><k5>0</k5>"
        ),
        {},
        KannalaBrandt(611.0, 612.0, 320.25, 239.5, 640, 480, k=FISHEYE.k),
    ),
}

CAMERAS = {
    "unified": OMNIDIR,
    "unified, plain": UnifiedCamera(-300.0, 301.0, 1 / 3, 240.0, 1.7, 640, 480),
    "Kannala-Brandt": FISHEYE,
    "EUCM": ExtendedUnified(191.0, 192.0, 320.25, 239.5, 0.63, 1.04, 640, 480),
    "double sphere": DoubleSphere(317.5, 316.25, 1 / 3, 239.5, -0.2, 0.6, 640, 480),
    "OCam": OCAM,
    "pinhole": PLAIN,
    "pinhole, k1": Pinhole(611.0, 612.0, 320.25, 239.5, 640, 480, distortion=(-0.1, 0.0, 0.0, 0.0)),
    "pinhole, four": RADTAN,
    "pinhole, five": BROWN,
    "pinhole, eight": RATIONAL,
    "equirectangular": Equirectangular(1000, 500),
    "OCam, lens": OcamPolynomial(
        OCAM.coefficients,
        456.25,
        382.5,
        1024,
        768,
        max_angle=1.5,
        dead_zone=DeadZone((320.0, 240.0), 20.0),
        deviation_px=1 / 3,
    ),
    "lens": KannalaBrandt(
        311.0,
        312.0,
        320.25,
        239.5,
        640,
        480,
        k=(0.01, -0.02, 0.003, -0.0004),
        max_angle=1.5,
        dead_zone=DeadZone((320.0, 240.0), 20.0),
        mask=[[[0, 0], [50, 0], [0, 50]]],
        deviation_px=1 / 3,
    ),
    "unified, deviation": UnifiedCamera(300.0, 301.0, 320.0, 240.0, 1.7, 640, 480, deviation_px=1 / 3),
    "pinhole, deviation": Pinhole(611.0, 612.0, 320.25, 239.5, 640, 480, deviation_px=1 / 3),
    "double sphere, deviation": DoubleSphere(
        317.5, 316.25, 320.0, 239.5, -0.2, 0.6, 640, 480, deviation_px=1 / 3
    ),
}
