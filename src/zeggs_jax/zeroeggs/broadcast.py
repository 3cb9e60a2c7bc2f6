"""What a live stream tells who listens: who the body is, where its joints are in each frame, what has happened.

Each message is a dict of plain values, for one line of JSON. The first one tells the body: `rate` (Hz), `joints`,
`parents`, `offsets` (cm, in the parent's frame), `latency` (s). One for each frame tells `frame`, `time` (s), `place`
of joint 0 (cm, y up) and `turns`, the rotation (wxyz) of each joint in its parent's frame, of joint 0 in world: the
world in which the stream begins in the middle, facing +Z, as in the BVH that `generate` makes. Others tell what
happens: `style`, `dropped` (frames left out), `note`, and with `end` how many frames there were.
"""

from collections.abc import Iterator
from functools import cached_property
from importlib.metadata import version
from typing import Any

import jax
import numpy as np

from ..motion import features
from ..motion.bvh import Clip
from ..motion.pose import Pose, Root
from .stream import StreamSession

Message = dict[str, Any]


class Broadcast:
    """The messages of one session."""

    def __init__(self, session: StreamSession):
        self.session = session
        root = session.first.root
        self._origin = Root(root.pos, root.rot / np.linalg.norm(root.rot))
        self._offsets = np.asarray(features.joints(session.first, self._origin)[1], np.float64)

    @cached_property
    def clip(self) -> Clip:
        """The first pose as a clip of one frame: the body that is shown."""
        model, first = self.session.model, jax.tree.map(lambda a: a[None], self.session.first)
        return features.decode(first, model.skeleton, model.config.frame_time)

    def body(self) -> Message:
        """The first message."""
        skeleton, latency = self.session.model.skeleton, self.session.latency
        return {
            "zeggs": version("zeggs-jax"),
            "rate": self.session.rate,
            "latency": [round(seconds, 4) for seconds in latency],
            "joints": list(skeleton.names),
            "parents": list(skeleton.parents),
            "offsets": np.round(self._offsets, 4).tolist(),
        }

    def frames(self, poses: Pose) -> Iterator[Message]:
        """The messages of the poses that a push has just made."""
        count = len(poses.root.pos)
        for k in range(count):
            rotations, positions = features.joints(jax.tree.map(lambda a, k=k: a[k], poses), self._origin)
            number = self.session.frame - count + k
            yield {
                "frame": number,
                "time": round(number / self.session.rate, 4),
                "place": np.round(np.asarray(positions[0], np.float64), 4).tolist(),
                "turns": np.round(np.asarray(rotations, np.float64), 6).tolist(),
            }
