"""Keypoint files of other detectors, layouts by anatomy, and frame numbers in names."""

import json

import numpy as np
import pytest
from crowd_scenes import CAMERAS, walkers
from damage import refusal
from openpose_scenes import people_in, points, standing
from valid_files import written

from workbench.body.skeleton import JOINT_NAMES
from workbench.detections.readers.detected_points import keypoints_of, numbers_in_names
from workbench.detections.readers.formats import LAYOUTS
from workbench.detections.readers.keypoint_files import is_detections, read_points
from workbench.detections.readers.layout_by_anatomy import CLEAR, check_layout, matching_layout
from workbench.detections.readers.named_points import named_points
from workbench.detections.readers.pairing import paired_frames
from workbench.detections.readers.people import MAX_PEOPLE, SourceImages, people_of_points, read_people
from workbench.utils.errors import InputError

PIXELS = standing(300.0, 100.0)
KNEE = JOINT_NAMES.index("left_knee")


def read(path):
    assert is_detections(path)
    people, _ = people_of_points({"": read_points(path)})
    return people[""]


def test_alphapose_files_are_read(tmp_path):
    keypoints = points("HALPE_26", PIXELS).ravel().tolist()
    rows = [{"image_id": f"{k}.jpg", "keypoints": keypoints, "score": 2.0} for k in (10, 9, 9)]
    (tmp_path / "a.json").write_text(json.dumps(rows))
    people = read(tmp_path / "a.json")
    assert (people.layout, people.frames.tolist(), list(map(len, people.joints))) == ("HALPE_26", [9, 10], [2, 1])
    assert people.joints[0][1, KNEE, :2] == pytest.approx(PIXELS["left_knee"])
    (tmp_path / "b.json").write_text(
        json.dumps({"4.jpg": {"people": [{"pose_keypoints_2d": keypoints}]}, "5.jpg": {"bodies": []}})
    )
    assert read(tmp_path / "b.json").frames.tolist() == [4, 5]
    for text in ("[3]", '{"a": 3}', "[]", '[{"image_id": "x", "keypoints": [1, 2, 3]}]'):
        (tmp_path / "c.json").write_text(text)
        with pytest.raises(InputError, match=r"c\.json"):
            read_points(tmp_path / "c.json")


def test_confidences_may_be_apart_from_the_coordinates(tmp_path):
    keypoints = points("COCO_17", PIXELS)
    person = {"keypoints": keypoints[:, :2].tolist(), "keypoint_scores": keypoints[:, 2].tolist()}
    (tmp_path / "shot_3.json").write_text(json.dumps([person, person]))
    people = people_in(tmp_path)
    assert (people.layout, people.frames.tolist(), list(map(len, people.joints))) == ("COCO_17", [3], [2])
    assert people.joints[0][1, KNEE] == pytest.approx([*PIXELS["left_knee"], 0.8])
    (tmp_path / "shot_3.json").write_text(json.dumps([person | {"keypoint_scores": [0.5]}]))
    with pytest.raises(InputError, match=r"shot_3\.json: expected people"):
        people_in(tmp_path)


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize("index", ["{}", "labeled-data/walk/img{:04d}.png"])
def test_deeplabcut_files_are_read(tmp_path, several, index):
    parts, people = ["LeftKnee", "ankle_r", "tail"], ["anna", "ben"] if several else ["anna"]
    cells = [(person, part, axis) for person in people for part in parts for axis in ("x", "y", "likelihood")]
    lines = [["scorer", *["net"] * len(cells)], ["individuals", *[person for person, _, _ in cells]]][: 1 + several]
    lines += [["bodyparts", *[part for _, part, _ in cells]], ["coords", *[axis for _, _, axis in cells]]]
    for frame in range(3):
        values = [
            10.0 * people.index(person) + 20 + frame if axis != "likelihood" else 0.5 for person, _, axis in cells
        ]
        lines.append([index.format(frame + 7), *map(str, values)])
    lines[-1][1] = ""  # a gap
    (tmp_path / "a.csv").write_text("\n".join(",".join(line) for line in lines))
    detections = read(tmp_path / "a.csv")
    assert detections.frames.tolist() == [7, 8, 9]
    assert detections.joints[1][:, KNEE].tolist() == [
        [21.0 + 10.0 * k, 21.0 + 10.0 * k, 0.5] for k in range(len(people))
    ]
    assert np.isnan(detections.joints[2][0, KNEE]).all()
    assert np.isfinite(detections.joints[2][0, JOINT_NAMES.index("right_ankle"), 0])


def test_other_files_are_not_detections(tmp_path):
    (tmp_path / "a.csv").write_text("frame,joint,u,v,visible\n")
    assert not is_detections(tmp_path / "a.csv")
    (tmp_path / "a.h5").write_bytes(b"\x89HDF")
    with pytest.raises(InputError, match="expected DeepLabCut's CSV file"):
        read_points(tmp_path / "a.h5")
    (tmp_path / "b.csv").write_text("scorer,a,a\nbodyparts,tail,tail\ncoords,x,y\n0,30,40\n")
    with pytest.raises(InputError, match="no point has the name of a joint"):
        people_of_points({"": read_points(tmp_path / "b.csv")})


def test_invalid_points_are_missing_and_scores_are_at_most_one():
    keypoints = keypoints_of([0, 0, 0.9, 5, 6, 0, 5, None, 1, float("nan"), 2, 1, 7, 8, 3])
    assert np.isnan(keypoints[:4]).all()
    assert keypoints[4].tolist() == [7.0, 8.0, 1.0]


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["cam1_0001_keypoints", "cam1_0002_keypoints"], [1, 2]),
        (["a_0001_2d", "a_0002_2d"], [1, 2]),
        (["f0001_t33.3", "f0002_t66.7", "f0003_t100.0"], [1, 2, 3]),
        (["walk_9_12", "walk_10_30"], [9, 10]),
        (["7"], [7]),
        (["metadata"], []),
        (["7.0", "7.5", "7.0625", "7.03125"], [7_000_000_000, 7_031_250_000, 7_062_500_000, 7_500_000_000]),
        (["t_0.000", "t_0.033", "t_0.067"], [0, 33, 67]),
        (["1700000000123456789", "1700000000156789122"], [1700000000123456789, 1700000000156789122]),
        (["12-30-59.966", "12-31-00.000", "12-31-00.033"], []),
        (["cam1_1", "cam1_2", "cam2_1", "cam2_2"], [1, 2, 1, 2]),
        ([str(2**63 - 1)], [2**63 - 1]),
        ([str(2**63)], []),
        (["1" * 5000], []),
    ],
)
def test_the_frame_number_of_a_name_is_the_one_that_increases(names, numbers):
    assert list(numbers_in_names(names).values()) == numbers


def test_points_are_recognized_by_many_names():
    layout = named_points(["L_Knee", "right hip", "ankleL", "wrist-right", "nose", "REar", "LEar"])
    assert layout == {
        "left_knee": (0,), "right_hip": (1,), "left_ankle": (2,), "right_wrist": (3,), "head_centre": (6, 5),
    }  # fmt: skip
    with pytest.raises(InputError, match=r"a\.json: .*17 points, found 25"):
        check_layout("a.json", "COCO_17", 25)


@pytest.mark.parametrize("n_people", [1, 3])
@pytest.mark.parametrize("layout", ["BODY_25", "BODY_25B"])
def test_the_layout_of_25_points_is_decided_by_anatomy(layout, n_people):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        paths = [(rng.uniform(-1.0, 1.0, 2), rng.uniform(-1.0, 1.0, 2)) for _ in range(n_people)]
        people = []
        for camera in CAMERAS.values():
            for joints in walkers(paths, n_frames=10):
                for pixels in camera.project(joints):
                    keypoints = points(layout, dict(zip(JOINT_NAMES, pixels, strict=True)))
                    keypoints[(keypoints[:, 2] == 0.0) | (rng.random(25) < 0.2)] = np.nan
                    people.append(keypoints + rng.normal(0.0, 3.0, keypoints.shape))
        best, evidence = matching_layout("", people)
        assert best == layout
        assert evidence >= CLEAR


COCO = points("COCO_17", PIXELS)


@pytest.mark.parametrize(("third", "n_points"), [(2.0, 12), (2.1, 18)])
def test_numbers_above_2_are_no_confidences(third, n_points):
    assert len(keypoints_of([50.0, 60.0, third] * 12)) == n_points


NAMES = LAYOUTS["COCO_17"]
ORDER = np.random.default_rng(0).permutation(17).tolist()
BY_NAME = [{"name": NAMES[k], "x": COCO[k, 0], "y": COCO[k, 1], "score": COCO[k, 2]} for k in ORDER]
NAMED_FORMS = {
    "COCO": lambda order: {
        "images": [{"id": 4}],
        "categories": [{"keypoints": [NAMES[k] for k in order]}],
        "annotations": [{"image_id": 4, "keypoints": COCO[order].ravel().tolist()}],
    },
    "MMPose": lambda order: {
        "meta_info": {"keypoint_id2name": {str(n): NAMES[k] for n, k in enumerate(order)}},
        "instance_info": [{"frame_id": 4, "instances": [{"keypoints": COCO[order].tolist()}]}],
    },
    "PoseNet": lambda order: [
        {"frame": 4, "poses": [{"keypoints": [BY_NAME[ORDER.index(k)] for k in order]}]}
    ],
    "OpenPifPaf": lambda order: {
        "4.jpg": [{"keypoints": [
            {"part": NAMES[k], "position": {"x": COCO[k, 0], "y": COCO[k, 1]}, "score": COCO[k, 2]} for k in order
        ]}]
    },
}  # fmt: skip


@pytest.mark.parametrize("order", [list(range(17)), ORDER, list(range(5, 17))])
@pytest.mark.parametrize("form", NAMED_FORMS)
def test_points_have_the_order_of_their_names(tmp_path, form, order):
    (tmp_path / "a.json").write_text(json.dumps(NAMED_FORMS[form](order)))
    people = read(tmp_path / "a.json")
    assert (people.layout, people.frames.tolist()) == ("COCO_17" if order == list(range(17)) else "named points", [4])
    np.testing.assert_allclose(people.joints[0][0, KNEE, :3], [*PIXELS["left_knee"], 0.8])


def test_a_point_that_a_person_lacks_is_missing(tmp_path):
    people = [{"keypoints": BY_NAME}, {"keypoints": [each for each in BY_NAME if each["name"] != "left_knee"]}]
    (tmp_path / "4.json").write_text(json.dumps({"poses": people}))
    joints = read(tmp_path).joints[0]
    assert np.isfinite(joints[:, :, 0]).sum(axis=1).tolist() == [13, 12]
    assert np.isnan(joints[1, KNEE]).all()


def test_a_file_with_a_line_of_json_for_each_image_is_read(tmp_path):
    lines = [{"frame": k, "predictions": [{"keypoints": COCO.ravel().tolist()}]} for k in (4, 6)]
    (tmp_path / "a.jsonl").write_text("\n".join(map(json.dumps, lines)) + "\n")
    assert read(tmp_path / "a.jsonl").frames.tolist() == [4, 6]


def mmpose(k):
    return {"keypoints": COCO[:, :2].tolist(), "keypoint_scores": COCO[:, 2].tolist(), "bbox_score": 0.9}


FRAMES = [{"frame_id": k, "instances": [mmpose(k)] * (k != 5)} for k in (4, 5, 6)]
FORMS = {
    "MMPose's inferencer": FRAMES,
    "MMPose's predictions": {"meta_info": {"num_keypoints": 17}, "instance_info": FRAMES},
    "COCO's data set": {
        "images": [{"id": 10 + k, "file_name": f"images/{k}.jpg"} for k in (6, 4, 5)],
        "annotations": [{"image_id": 10 + k, "keypoints": COCO.ravel().tolist()} for k in (6, 4)]
        + [{"image_id": 14, "bbox": [0, 0, 1, 1]}],
    },
    "COCO's results": [{"image_id": k, "keypoints": COCO.ravel().tolist()} for k in (4, 6)],
    "MediaPipe's landmarks": [
        {"frame": k, "landmarks": [{"x": u, "y": v, "z": 0.0, "visibility": c} for u, v, c in COCO]} for k in (4, 6)
    ],
    "Ultralytics' coordinates": [
        {"frame": k, "keypoints": dict(zip(("x", "y", "visible"), COCO.T.tolist(), strict=True))} for k in (4, 6)
    ],
    "OpenPose by image": {f"{k}": {"people": [{"pose_keypoints_2d": COCO.ravel().tolist()}]} for k in (4, 6)},
}


@pytest.mark.parametrize(
    ("form", "folder"),
    [*((form, False) for form in FORMS), *((form, True) for form in FORMS if form != "OpenPose by image")],
)
def test_files_of_all_frames_are_read(tmp_path, form, folder):
    """In a folder, each of OpenPose's files has one image."""
    (tmp_path / "results.JSON").write_text(json.dumps(FORMS[form]))
    people = read(tmp_path if folder else tmp_path / "results.JSON")
    there = [frame for frame, joints in zip(people.frames.tolist(), people.joints, strict=True) if len(joints)]
    assert (people.layout, there) == ("COCO_17", [4, 6])
    assert people.joints[0][0, KNEE, :2] == pytest.approx(PIXELS["left_knee"])


def test_a_folder_of_predictions_by_image_is_read(tmp_path):
    """As MMPose writes them for images, and Sapiens."""
    for k, people in enumerate(([mmpose(0)], [])):
        content = {"meta_info": {"num_keypoints": 17}, "instance_info": people}
        (tmp_path / f"{k:04d}.json").write_text(json.dumps(content))
    people = read(tmp_path)
    assert (people.layout, list(map(len, people.joints))) == ("COCO_17", [1, 0])
    np.testing.assert_allclose(people.joints[0][0, KNEE], [*PIXELS["left_knee"], 0.8])


def test_a_list_of_images_without_numbers_is_in_order(tmp_path):
    person = {"pose_keypoints_2d": COCO.ravel().tolist()}
    for content in ([{"people": []}, {"people": [person]}], [[], [person]]):
        (tmp_path / "a.json").write_text(json.dumps(content))
        people = read(tmp_path / "a.json")
        assert (people.frames.tolist(), list(map(len, people.joints))) == ([0, 1], [0, 1])


@pytest.mark.parametrize("layout", ["BODY_25", "COCO_17", "COCO_18", "HALPE_26", "BLAZEPOSE_33", "COCO_133", "MPII_16"])
def test_points_without_confidences_have_the_confidence_1(layout):
    keypoints = points(layout, PIXELS)
    read_back = keypoints_of(keypoints[:, :2].ravel())
    known = keypoints[:, 2] > 0.0
    np.testing.assert_array_equal(read_back[known], np.column_stack([keypoints[known, :2], np.ones(known.sum())]))
    np.testing.assert_array_equal(keypoints_of(keypoints.ravel())[known], keypoints[known])


TABLES = {
    "SLEAP": ("track,frame_idx,instance.score", "track_0,{},0.9", "{}.x,{}.y,{}.score"),
    "MediaPipe": ("frame", "{}", "{}_x,{}_y,{}_visibility"),
    "upper case": ("Frame", "{}.0", "{} X,{} Y,{} Confidence"),
}


@pytest.mark.parametrize(
    ("name", "separator", "point"), [("a.csv", ";", ","), ("a.csv", ";", "."), ("a.tsv", "\t", ",")]
)
def test_tables_may_have_other_separators_and_decimal_commas(tmp_path, name, separator, point):
    header = ["frame", *[f"{each}_{axis}" for each in LAYOUTS["COCO_17"] for axis in ("x", "y", "score")]]
    row = ["4", *[f"{number:.2f}".replace(".", point) for number in COCO.ravel()]]
    (tmp_path / name).write_text("\n".join([separator.join(header), separator.join(row)]))
    people = read(tmp_path / name)
    assert people.frames.tolist() == [4]
    np.testing.assert_allclose(people.joints[0][0, KNEE], [*PIXELS["left_knee"], 0.8], atol=0.005)
    (tmp_path / "b.csv").write_text("\n".join(["a;b;c", "1;2;3"]))
    with pytest.raises(InputError, match=r"b\.csv: .*nose_x"):
        read_points(tmp_path / "b.csv")


@pytest.mark.parametrize("form", TABLES)
def test_tables_with_named_points_are_read(tmp_path, form):
    keys, values, columns = TABLES[form]
    names = LAYOUTS["COCO_17"]
    lines = [",".join([keys, *[columns.replace("{}", name) for name in names]])]
    lines += [",".join([values.format(k), *[f"{u},{v},{c}" for u, v, c in COCO]]) for k in (9, 7, 7)]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    people = read(tmp_path / "a.csv")
    assert (people.frames.tolist(), list(map(len, people.joints))) == ([7, 9], [2, 1])
    np.testing.assert_allclose(people.joints[0][0, KNEE], [*PIXELS["left_knee"], 0.8])
    by_hand = [",".join([values.format(8), *[f"{u},{v}," for u, v, _ in COCO]])]
    (tmp_path / "a.csv").write_text("\n".join([*lines, *by_hand]))
    np.testing.assert_allclose(read(tmp_path / "a.csv").joints[1][0, KNEE], [*PIXELS["left_knee"], 1.0])
    (tmp_path / "a.csv").write_text("\n".join([*lines, lines[-1].replace("0.8", "a")]))
    with pytest.raises(InputError, match=r"a\.csv: expected numbers in the columns of points"):
        read(tmp_path / "a.csv")


@pytest.mark.parametrize(("header", "numbered"), [
    ("frame,landmark_index,landmark_name,x,y,z,visibility", False), ("Frame,Landmark,X,Y,Z,Visibility", True),
])  # fmt: skip
def test_tables_with_a_row_for_each_point_are_read(tmp_path, header, numbered):
    keypoints = points("BLAZEPOSE_33", PIXELS)
    names = [(str(k),) if numbered else (str(k), name) for k, name in enumerate(LAYOUTS["BLAZEPOSE_33"])]
    lines = [",".join([str(frame), *name, str(u), str(v), "0.1", str(c)])
             for frame in (9, 11) for name, (u, v, c) in zip(names, keypoints, strict=True)]  # fmt: skip
    (tmp_path / "a.csv").write_text("\n".join([header, *lines]))
    people = read(tmp_path / "a.csv")
    assert people.layout == ("BLAZEPOSE_33" if numbered else "named points")
    assert (people.frames.tolist(), list(map(len, people.joints))) == ([9, 11], [1, 1])
    np.testing.assert_allclose(people.joints[0][0, KNEE, :3], [*PIXELS["left_knee"], 0.8])
    (tmp_path / "a.csv").write_text("\n".join([header, *lines, lines[-1]]))
    with pytest.raises(InputError, match=r"a\.csv: .*duplicate"):
        read(tmp_path / "a.csv")


def test_people_of_a_table_with_a_row_for_each_point_have_a_number(tmp_path):
    named = list(zip(LAYOUTS["COCO_17"], COCO, strict=True))
    lines = [f"3,{person},{name},{u},{v}" for person in (1, 2) for name, (u, v, _) in named]
    (tmp_path / "a.csv").write_text("\n".join(["frame,person_id,keypoint,x,y", *lines]))
    people = read(tmp_path / "a.csv")
    assert (people.frames.tolist(), list(map(len, people.joints))) == ([3], [2])


@pytest.mark.parametrize("columns", ["x_{0},y_{0}", "x{0},y{0},v{0}", "landmark_{0}_x,landmark_{0}_y", "{0}_x,{0}_y"])
def test_tables_with_numbered_points_have_a_layout(tmp_path, columns):
    keypoints = points("BLAZEPOSE_33", PIXELS)
    has_confidence = columns.count(",") == 2
    lines = [",".join(columns.format(k) for k in reversed(range(33)))]
    lines += [",".join(str(x) for point in keypoints[::-1] for x in point[: 2 + has_confidence])] * 2
    (tmp_path / "a.csv").write_text("\n".join(lines))
    people = read(tmp_path / "a.csv")
    assert (people.layout, people.frames.tolist()) == ("BLAZEPOSE_33", [0, 1])
    expected = [*PIXELS["left_knee"], 0.8 if has_confidence else 1.0]
    np.testing.assert_allclose(people.joints[0][0, KNEE, :3], expected)


@pytest.mark.parametrize(
    ("layout", "width", "after"),
    [(layout, 3, after) for layout in ("COCO_17", "HALPE_26") for after in ("", " 0.9", " 0.9 3")]
    + [("COCO_17", 2, ""), ("COCO_17", 2, " 0.9")],
)
def test_text_of_ultralytics_is_read(tmp_path, layout, width, after):
    keypoints = points(layout, PIXELS)[:, :width] / ([640.0, 480.0, 1.0][:width])
    line = "0 0.5 0.5 0.2 0.5 " + " ".join(f"{x:.6f}" for x in keypoints.ravel()) + after
    for k in (9, 10):
        (tmp_path / f"cam1_{k}.txt").write_text(f"{line}\n{line}\n")
    read_back = read_points(tmp_path)
    scaled, _ = read_back.in_pixels((640, 480))
    people = people_of_points({"": scaled})[0][""]
    assert (people.layout, people.frames.tolist(), list(map(len, people.joints))) == (layout, [9, 10], [2, 2])
    assert people.joints[0][0, KNEE, :2] == pytest.approx(PIXELS["left_knee"], abs=1e-3)
    (tmp_path / "cam1_10.txt").write_text("0 0.5 0.5\n")
    with pytest.raises(InputError, match=r"cam1_10\.txt, line 1: expected Ultralytics'"):
        read_points(tmp_path)


@pytest.mark.parametrize("more", [0, 1])
def test_of_a_crowd_the_likeliest_people_are_used(tmp_path, caplog, more):
    person = points("COCO_17", PIXELS)
    rows = []
    for k in range(MAX_PEOPLE + more):
        person[:, 2] = (k + 1) / 100.0
        rows.append({"image_id": 3, "keypoints": person.ravel().tolist()})
    (tmp_path / "a.json").write_text(json.dumps(rows))
    (joints,) = read(tmp_path / "a.json").joints
    assert len(joints) == MAX_PEOPLE
    assert joints[0, KNEE, 2] == pytest.approx((1 + more) / 100.0)
    assert ("the likeliest are used" in caplog.text) == bool(more)


@pytest.mark.parametrize(("frame", "message"), [(10**9 - 1, ""), (10**9, "expected frames below"), (10**30, "number")])
def test_numbers_of_frames_without_images_are_bounded(tmp_path, frame, message):
    rows = [{"image_id": f"{frame}.jpg", "keypoints": COCO.ravel().tolist(), "score": 2.0}]
    path = written(tmp_path / "a.json", json.dumps(rows))
    assert message in refusal(lambda: read_people({"": path}, {"": SourceImages()}))


@pytest.mark.parametrize(
    ("numbers", "frames", "assumption"),
    [
        ([0, 1, 2, 3], [0, 1, 2, 3], ""),
        ([0, 40, 80, 120], [0, 1, 2, 3], "in order"),  # times in ms
        ([0, 1, 80, 120], [0, 1, -1, -1], ""),
        ([0, 40, 80, 120, 160], [0, -1, -1, -1, -1], "4 of 5"),
    ],
)
def test_detections_named_by_times_are_paired_in_order(numbers, frames, assumption):
    paired, assumptions = paired_frames({"a": np.array(numbers)}, {"a": np.arange(4)})
    assert paired["a"].tolist() == frames
    assert ("a" in assumptions) == bool(assumption)
    assert assumption in assumptions.get("a", "")
