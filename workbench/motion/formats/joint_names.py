"""Names of joints and markers in motion files, and the person's joints that they denote.

The skeletons are those of MotionBuilder (also Mixamo, LAFAN1, Rokoko and CMU's BVH), 3ds Max, Blender, Unreal, Unity,
Motive, Xsens, SMPL, Kinect, Bandai and this program; the marker sets Plug-in Gait, OpenSim's, Pose2Sim's, Qualisys' and
Motive's.
"""

import logging
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise, product, takewhile

from workbench.body.skeleton import JOINT_NAMES
from workbench.utils.errors import InputError
from workbench.utils.text import plain_name

log = logging.getLogger(__name__)

_LIMB_PARTS = {
    "shoulder": ("arm", "upperarm", "uarm", "uparm", "humerus", "shldr", "shoulder", "shoulderjoint"),
    "elbow": ("elbow", "forearm", "lowerarm", "lowarm", "loarm", "farm", "radius"),
    "wrist": ("wrist", "hand"),
    "hip": ("upleg", "upperleg", "thigh", "femur", "uleg", "hip"),
    "knee": ("knee", "lowerleg", "lowleg", "loleg", "shin", "calf", "tibia", "leg"),
    "ankle": ("ankle", "foot"),
}
"""Joints of a limb without their side, the preferred first: "LeftShoulder" is a clavicle where there is a "LeftArm"."""
_LIMBS = (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))
_NECK = ("neck", "neck1", "neck01", "lowerneck", "shouldercenter", "spineshoulder", "cneck")
_HEAD = ("head", "head1", "skull", "chead", "headcentre", "headcenter")


_MARKERS = {
    "shoulder": ["shoulder", "sho", "acromion", "acromium", "acr", "shouldertop", "sae", "sjc"],
    "elbow": ["elbow", "ejc", "lelbow melbow", "elbowlat elbowmed", "elbowout elbowin", "elblat elbmed", "elb elbm",
              "elb melb", "lel mel", "hle hme", "elb", "elbowlat", "elbowout"],
    "wrist": ["wrist", "wjc", "wra wrb", "lwrist mwrist", "wristradius wristulna", "wristlat wristmed",
              "wristout wristin", "rsp usp", "faradius faulna", "wri", "wra", "wristout"],
    "hip": ["hip", "hjc", "hipjc", "fep"],
    "knee": ["kjc", "kneejc", "feo", "knee kneemedial", "knee kneemed", "knee mknee", "kneelat kneemed",
             "kneeout kneein", "kne knem", "kne mkne", "kne kneem", "kne kneemed", "lfc mfc", "fle fme", "knee",
             "kne", "kneelat", "kneeout"],
    "ankle": ["ajc", "anklejc", "tio", "ankle anklemedial", "ankle anklemed", "ankle mankle", "anklelat anklemed",
              "ankleout anklein", "ank ankm", "ank mank", "ank ankmed", "lmal mmal", "fal tam", "ankle", "ank",
              "anklelat", "ankleout", "foot"],
    "pelvis": ["pelvis", "midhip", "hip", "hipscenter", "hipcenter", "lhip rhip", "lefthip righthip", "lhjc rhjc"],
    "neck": ["neck", "neckcenter", "c7", "spinetop"],
    "head_centre": ["headcentre", "headcenter", "neck headtop", "neck head", "lear rear", "leftear rightear",
                    "lfhd rfhd lbhd rbhd", "headl headr"],
}  # fmt: skip
"""Markers whose mean is a joint, without their side, the best first; Pose2Sim's "head" is the vertex. Markers on both
sides of a joint come before one on its outside, which is some centimetres from its centre."""

_SIDES = ("l", "r", "left", "right")
_SKELETONS = ("leftcollar", "lcollar", "clavicleleft", "leftclavicle", "spineshoulder", "shouldercenter")
"""Joints of skeletons, SMPL's and Kinect's, whose "head" is a joint at the base of the skull or in the head."""


def marker_joints(names: Sequence[str], place: object = "markers") -> dict[str, tuple[str, ...]]:
    """Return the names of the markers at whose mean a joint is, by joint. Of several subjects the one with most joints
    is used, with a warning. place : of the markers, for messages."""
    subjects = {name.rpartition(":")[0]: None for name in names}
    found, chosen, n_complete = dict[str, tuple[str, ...]](), "", 0
    for subject in subjects:
        own = [name for name in names if name.rpartition(":")[0] == subject]
        best: dict[str, tuple[str, ...]] = {}
        for words in unprefixed(own):
            index = {plain_name(word): name for word, name in reversed(list(zip(words, own, strict=True)))}
            matched = {joint: _markers(index, joint) for joint in JOINT_NAMES}
            joints = {joint: markers for joint, markers in matched.items() if markers}
            best = max(best, joints, key=len)
        n_complete += len(best) > len(JOINT_NAMES) // 2
        found, chosen = max((found, chosen), (best, subject), key=lambda pair: len(pair[0]))
    if n_complete > 1:
        log.warning("%s: markers of %d people; used are those of %s", place, n_complete, chosen or "the first")
    return found


def _markers(index: Mapping[str, str], joint: str) -> tuple[str, ...]:
    """Return the markers of a joint; index : names by plain names without the subject's."""
    side, _, part = joint.partition("_")
    sides = (side, side[0], f"v{side[0]}") if part in _LIMB_PARTS else ("",)
    choices = _MARKERS[part if part in _LIMB_PARTS else joint]
    if joint == "head_centre" and any(word in index for word in _SKELETONS):
        choices = ["head", *choices]
    for words in choices:
        for prefix in sides:
            for form in ([prefix + word for word in words.split()], [word + prefix for word in words.split()]):
                if all(word in index for word in form):
                    return tuple(index[word] for word in form)
    return ()


def unprefixed(names: Sequence[str]) -> list[list[str]]:
    """Return variants of names without the subject's name: as they are after a colon, without a first word that most
    share ("Skeleton_Hips"), without the beginning ("mixamorigHips") or the end ("hips_JNT") that all share."""
    after_colon = [re.split(r"[:|]", name)[-1] for name in names]
    variants, words = [after_colon], after_colon
    for _ in range(2):  # "J_Bip_L_Hand"
        first = [match[0] if (match := re.match(r"[^_ .-]*[_ .-]+", name)) else "" for name in words]
        common, n = Counter(filter(None, first)).most_common(1)[0] if any(first) else ("", 0)
        is_shared = 2 * n > len(names) and plain_name(common) not in _SIDES
        words = [name.removeprefix(common) for name in words] if is_shared else words
        variants.append(words)
    inner = [name for name in words if not name.endswith("_end")]
    begin, end = _beginning(inner), _beginning([name[::-1] for name in inner])[::-1]
    return [*variants, [name.removeprefix(begin) for name in words], [name.removesuffix(end) for name in words]]


def _beginning(names: Sequence[str]) -> str:
    """Return the longest string with which all names begin."""
    ends = zip(min(names, default=""), max(names, default=""), strict=False)
    return "".join(a for a, _ in takewhile(lambda pair: pair[0] == pair[1], ends))


def skeleton_joints(names: Sequence[str], parents: Sequence[int], given: Mapping[str, str] | None = None,
                    place: object = "skeleton") -> dict[str, str]:  # fmt: skip
    """Return the names of a skeleton's joints by the person's joints that they are.

    The pelvis is omitted. "head_centre" is the joint at the base of the skull, or an end site of the neck. A wrist, an
    ankle or a head without a joint of its own is the end site of its parent.

    Parameters
    ----------
    names, parents : K joints, parents before children, -1 for the root.
    given : names by the person's joints, which take precedence.
    place : of the skeleton, for messages.

    Raises
    ------
    InputError : `given` names an unknown joint.
    """
    given = given or {}
    if unknown := sorted(set(given) - set(JOINT_NAMES)):
        raise InputError(f"{place}: landmarks: unknown joint {unknown[0]!r}, expected some of {', '.join(JOINT_NAMES)}")
    variants = [{plain_name(word): k for k, word in reversed(list(enumerate(words)))} for words in unprefixed(names)]
    known = {joint: _index(place, names, variants, name) for joint, name in given.items()}
    found = max((_matches(variant, parents, known) for variant in variants), key=len)
    return {joint: names[found[joint]] for joint in JOINT_NAMES if joint in found and joint != "pelvis"}


def _index(place: object, names: Sequence[str], variants: Sequence[Mapping[str, int]], name: str) -> int:
    """Return the index of a joint named by the user, with or without the subject's name."""
    for index in ({each: k for k, each in reversed(list(enumerate(names)))}, *variants):
        for key in (name, plain_name(name)):
            if key in index:
                return index[key]
    raise InputError(f"{place}: landmarks: no joint {name!r}, expected some of {', '.join(names)}")


def _matches(index: Mapping[str, int], parents: Sequence[int], given: Mapping[str, int]) -> dict[str, int]:
    """Return the index of a joint by the person's joint. index : of the joints by their plain names."""
    found = dict(given)
    for side, limb in product(("left", "right"), _LIMBS):
        joints = [f"{side}_{part}" for part in limb]
        choices = [[given[joint]] if joint in given else _candidates(index, side, part)
                   for joint, part in zip(joints, limb, strict=True)]  # fmt: skip
        choices[2] = choices[2] or [end for k in choices[1] for end in _children(parents, k) if end not in parents]
        chains = [chain for chain in product(*choices) if _descends(parents, chain)]
        if chains:
            found |= dict(zip(joints, chains[0], strict=True))
        else:
            found |= {joint: choice[0] for joint, choice in zip(joints, choices, strict=True) if choice}
    heads = [index[name] for name in _HEAD if name in index]
    necks = [index[name] for name in _NECK if name in index] or [parents[k] for k in heads if parents[k] >= 0]
    if necks:
        found.setdefault("neck", necks[0])
    if "neck" in found:
        heads += [end for end in _children(parents, found["neck"]) if end not in parents]
    if heads:
        found.setdefault("head_centre", heads[0])
    return found


def _candidates(index: Mapping[str, int], side: str, part: str) -> list[int]:
    """Return the joints that may be a part of one side, the preferred first."""
    forms = [form for word in _LIMB_PARTS[part] for form in
             (f"{side}{word}", f"{side[0]}{word}", f"{word}{side}", f"{word}{side[0]}")]  # fmt: skip
    return [index[form] for form in forms if form in index]


def _children(parents: Sequence[int], joint: int) -> list[int]:
    return [k for k, parent in enumerate(parents) if parent == joint]


def _descends(parents: Sequence[int], chain: Sequence[int]) -> bool:
    """Return whether every joint of a chain descends from the one before it."""
    for upper, lower in pairwise(chain):
        k = parents[lower]
        while k > upper:
            k = parents[k]
        if k != upper:
            return False
    return True
