"""Scene files of the lidar: read, written, and the errors about bad files."""

import copy

import pytest

from sitl.lidar import Box, LidarScene, Prism, Tree, Wire
from sitl.lidar_scene import LidarMount, PlacedScene
from sitl.yaml_input import BadInputError

ORIGIN = {"latitude_deg": 45.3781, "longitude_deg": -71.9295, "altitude_amsl_m": 210.0}
LEAST = {"name": "none", "frame": {"origin": ORIGIN, "azimuth_deg": 90.0}}
WIRE = {"start_m": [5, -150, 20], "end_m": [5, 150, 20], "sag_m": 8.0, "diameter_m": 0.02}
FULL = {
    **LEAST,
    "mount": {"position_m": [0.1, 0.0, -0.1], "roll_pitch_yaw_deg": [-90, 0, 5]},
    "wires": [WIRE],
    "trees": [{"centre_m": [-9.0, 2.0, 5.0], "radius_m": 3}],
    "boxes": [{"lower_m": [0, 0, 0], "upper_m": [1, 2, 3]}],
    "prisms": [{"vertices_m": [[0, 0], [1, 0], [0, 4]], "lower_y_m": -3, "upper_y_m": 3}],
    "ground_m": None,
    "rain_per_m": 0.002,
}


def test_all_content_of_a_file_is_in_the_scene():
    placed = PlacedScene.parse(FULL, "scene.yaml")
    assert (placed.origin.latitude_deg, placed.azimuth_deg) == (45.3781, 90.0)
    assert placed.mount == LidarMount(
        position_m=(0.1, 0.0, -0.1), roll_pitch_yaw_deg=(-90.0, 0.0, 5.0)
    )
    assert placed.scene == LidarScene(
        wires=(
            Wire(start_m=(5.0, -150.0, 20.0), end_m=(5.0, 150.0, 20.0), sag_m=8.0, diameter_m=0.02),
        ),
        trees=(Tree(centre_m=(-9.0, 2.0, 5.0), radius_m=3.0),),
        boxes=(Box(lower_m=(0.0, 0.0, 0.0), upper_m=(1.0, 2.0, 3.0)),),
        prisms=(
            Prism(vertices_m=((0.0, 0.0), (1.0, 0.0), (0.0, 4.0)), lower_y_m=-3.0, upper_y_m=3.0),
        ),
        ground_m=None,
        rain_per_m=0.002,
    )


@pytest.mark.parametrize("data", [LEAST, FULL], ids=["least", "full"])
def test_the_file_of_a_scene_is_that_scene(tmp_path, data):
    placed = PlacedScene.parse(data, "scene.yaml")
    file = tmp_path / "scene.yaml"
    file.write_text(placed.text())
    assert PlacedScene.load(file) == placed


@pytest.mark.parametrize(
    ("place", "value", "problem"),
    [
        (("wires", 0, "end_m"), [5, -150, 20], "wires[0]: end_m must be at least 0.1 m from"),
        (("wires", 0, "diameter_m"), 0, "wires[0].diameter_m: 0: must be greater than 0"),
        (("wires", 0, "end_m"), [5, -150], "wires[0].end_m[2]: is missing"),
        (("wires", 0, "end_m"), "there", "wires[0].end_m: 'there': must be a list"),
        (("wires", 0, "colour"), 1, "wires[0].colour: unknown key; allowed: start_m, end_m, sag_m"),
        (("frame", "north"), 1, "frame.north: unknown key; allowed: origin, azimuth_deg"),
        (("colour",), 1, "colour: unknown key; allowed: name, frame, mount, wires"),
        (("frame", "origin", "latitude_deg"), 95.0, "frame.origin.latitude_deg: 95.0: must be"),
        (("boxes", 0, "upper_m"), [1, 2, 0], "boxes[0]: each of lower_m must be less than"),
        (("prisms", 0, "upper_y_m"), -3, "prisms[0]: lower_y_m must be less than upper_y_m"),
        (("prisms", 0, "vertices_m"), [[0, 0], [1, 0]], "prisms[0].vertices_m: List should have"),
        (("dropout",), float("nan"), "dropout: nan: must be"),
        (("wires",), {}, "wires: must be a list"),
    ],
)
def test_a_bad_file_is_one_line_that_names_key_and_value(place, value, problem):
    data = copy.deepcopy(FULL)
    at = data
    for part in place[:-1]:
        at = at[part]
    at[place[-1]] = value
    with pytest.raises(BadInputError) as caught:
        PlacedScene.parse(data, "scene.yaml")
    error_text = str(caught.value)
    assert error_text.startswith(f"scene.yaml: {problem}")
    assert "\n" not in error_text


def test_a_missing_frame_is_reported():
    with pytest.raises(BadInputError, match=r"^scene\.yaml: frame: is missing$"):
        PlacedScene.parse({"name": "none"}, "scene.yaml")
