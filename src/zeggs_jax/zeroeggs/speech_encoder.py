"""ZeroEGGS Fig. 3a, the speech encoder: speech features to an embedding for every frame.

Follows the release where the paper differs: the first convolution has width 1 (paper: 3) and dropout stands
after the ELU (paper: before it).
"""

from dataclasses import dataclass
from typing import Literal

import jax
from flax import linen as nn
from jaxtyping import Array, Float

from ..nn.compute import Matmul
from ..nn.layers import Conv, Dense


@dataclass(frozen=True)
class SpeechEncoderConfig:
    """Sizes of the speech encoder; `kernel` is odd and counts frames (31: it looks 15 frames ahead)."""

    features: int = 81
    hidden: int = 64
    size: int = 64
    kernel: int = 31
    dropout: float = 0.2


class SpeechEncoder(nn.Module):
    """Two convolutions and a dense layer, ELU after each (the last one too); edges are repeated, not zero.

    With padding "none" only the frames come out that see `kernel` frames of speech: kernel - 1 less.
    """

    config: SpeechEncoderConfig
    matmul: Matmul = "float32"
    padding: Literal["edge", "none"] = "edge"

    @nn.compact
    def __call__(self, features: Float[Array, "T F"], deterministic: bool = True) -> Float[Array, "N S"]:
        """Scaled speech features -> speech embedding."""
        config = self.config
        drop = nn.Dropout(config.dropout, deterministic=deterministic)
        x = drop(jax.nn.elu(Conv(config.hidden, 1, matmul=self.matmul, name="conv0")(features)))
        wide = Conv(config.size, config.kernel, padding=self.padding, matmul=self.matmul, name="conv1")
        x = drop(jax.nn.elu(wide(x)))
        return jax.nn.elu(Dense(config.size, matmul=self.matmul, name="dense")(x))
