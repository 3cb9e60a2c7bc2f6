"""The kinds of style encoder that a config can name, each a pair (init, apply); put your own in here.

    ENCODERS["mine"] = Encoder(init, apply)          # what both are given and return: style_encoder.Encoder

and `{"model": {"style": {"kind": "mine"}}}` trains it. A model of a kind of your own can be read wherever the kind has
been added first.
"""

import difflib

from .bottleneck_encoder import BOTTLENECK
from .parts_encoder import PARTS_ENCODER
from .style_encoder import Encoder as Encoder
from .style_encoder import StyleEncoder, from_linen

ENCODERS: dict[str, Encoder] = {
    "attn": from_linen(StyleEncoder),
    "gru": from_linen(StyleEncoder),
    "bottleneck": BOTTLENECK,
    "parts": PARTS_ENCODER,
}
LABEL = "label"  # one-hot styles: no encoder


def check(kind: str) -> None:
    """Raises a ValueError with the nearest names where no encoder of this kind is known."""
    if kind not in ENCODERS and kind != LABEL:
        known = [*ENCODERS, LABEL]
        near = difflib.get_close_matches(kind, known, n=2, cutoff=0.5)
        raise ValueError(
            f"the style kind '{kind}' is unknown; "
            + (f"the nearest known are {' and '.join(map(repr, near))}" if near else f"known are {', '.join(known)}")
            + f", and a kind of your own is added by ENCODERS['{kind}'] = Encoder(init, apply)."
        )
