"""What a motion shows without any ruler: heights, pitches, reach and speeds, measured directly (Sec. 5.2.2)."""

import numpy as np

from zeggs_jax.metrics import kinematic
from zeggs_jax.motion import bvh
from zeggs_jax.motion.bvh import Clip

UNITS = {
    "hand height": "cm", "reach": "cm", "hands apart": "cm", "hips height": "cm", "lean": "rad", "head pitch": "rad",
    "nod": "rad", "hand speed": "cm/s", "hand span": "cm", "root speed": "cm/s", "sway": "cm", "right hand": "share",
}  # fmt: skip


def measured(clip: Clip) -> dict[str, float]:
    """Means over the clip, in the body's heading; the names and units are those of `UNITS`.

    `hand height`: hands above the shoulders; `reach`: horizontal distance of a hand from its shoulder; `nod`, `hand
    span`, `sway`: standard deviations of the head's pitch, the hands' places, the hips sideways; `root speed`: of the
    hips over the ground; `right hand`: its share of both hands' speed.
    """
    skeleton, rate_hz = clip.skeleton, bvh.rate_hz(clip.frame_time)
    body = kinematic.in_heading(clip)
    hips, head = skeleton.role("hips"), skeleton.role("head")
    hands = [skeleton.role("left_hand"), skeleton.role("right_hand")]
    shoulders = [skeleton.parents[skeleton.parents[hand]] for hand in hands]
    neck = skeleton.parents[head]
    arms = body[:, hands] - body[:, shoulders]
    trunk = body[:, shoulders].mean(axis=1) - body[:, hips]
    tip = next((joint for joint, parent in enumerate(skeleton.parents) if parent == head), None)
    skull = body[:, head] - body[:, neck] if tip is None else body[:, tip] - body[:, head]
    nod = np.arctan2(skull[:, 2], skull[:, 1])
    pace = kinematic.speeds(body[:, hands] - body[:, [hips]], rate_hz).mean(axis=0)
    over_ground = body[:, hips] * np.array([1.0, 0.0, 1.0])
    values = (
        arms[..., 1].mean(),
        np.linalg.norm(arms[..., [0, 2]], axis=-1).mean(),
        np.linalg.norm(body[:, hands[0]] - body[:, hands[1]], axis=-1).mean(),
        body[:, hips, 1].mean(),
        np.arctan2(trunk[:, 2], trunk[:, 1]).mean(),
        nod.mean(),
        nod.std(),
        pace.mean(),
        np.sqrt((arms.std(axis=0) ** 2).sum(axis=-1)).mean(),
        kinematic.speeds(over_ground[:, None], rate_hz).mean(),
        body[:, hips, 0].std(),
        pace[1] / (pace.sum() + 1e-9),
    )
    return dict(zip(UNITS, map(float, values), strict=True))
