"""The kinds of style encoder that a config can name, each a pair (init, apply); put your own in here.

    ENCODERS["mine"] = Encoder(init, apply)          # what both are given and return: style_encoder.Encoder

and `{"model": {"style": {"kind": "mine"}}}` trains it. A model of a kind of your own can be read wherever the kind has
been added first.
"""

import difflib
from typing import Any

import jax
import jax.numpy as jnp

from .bottleneck_encoder import BOTTLENECK
from .parts_encoder import PARTS_ENCODER
from .style_encoder import Encoder as Encoder
from .style_encoder import StyleDistribution, StyleEncoder, StyleEncoderConfig, from_linen

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
        near = difflib.get_close_matches(kind, known, n=2, cutoff=0.5) or known
        raise ValueError(
            f"the style kind '{kind}' is unknown; nearest: {', '.join(near)}; "
            f"a kind of your own is added by ENCODERS['{kind}'] = Encoder(init, apply)."
        )


def init(key: jax.Array, config: StyleEncoderConfig, inputs: int) -> Any:
    """Parameters of the config's kind, after a look at what `apply` makes of them.

    Raises a ValueError where that is not a distribution over embeddings of `config.size` numbers.
    """
    encoder = ENCODERS[config.kind]
    params = encoder.init(key, config, inputs)
    example = jax.ShapeDtypeStruct((2, inputs), jnp.float32)
    made = jax.eval_shape(lambda p, x: encoder.apply(p, config, x, 2, None, "float32"), params, example)
    if not isinstance(made, StyleDistribution):
        told = f"style kind '{config.kind}' returns a {type(made).__name__}"
        raise ValueError(f"{told}; its apply has to return StyleDistribution(mean, log_var or None).")
    for name, leaf in zip(("mean", "log_var"), made, strict=True):
        if leaf is not None and leaf.shape != (config.size,):
            raise ValueError(
                f"style kind '{config.kind}' returns a {name} of shape {leaf.shape}; "
                f"style.size asks for ({config.size},)."
            )
    return params
