"""ZeroEGGS Fig. 3a, the speech encoder: speech features to an embedding for every frame.

Follows the release where the paper differs: the first convolution has width 1 (paper: 3) and dropout stands
after the ELU (paper: before it).
"""

from dataclasses import dataclass
from typing import Literal

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float

from ..nn.compute import Matmul
from ..nn.layers import Conv, Dense, Dropout


@dataclass(frozen=True)
class SpeechEncoderConfig:
    """Sizes of the speech encoder; `kernel` is odd and counts the frames that a frame of the embedding sees.

    `lookahead` of these, from 0 to kernel - 1, come later than it; None: half of them, as in the paper (15 of 31). All
    others but its own came before, so that a model that waits less remembers more.
    """

    features: int = 81
    hidden: int = 64
    size: int = 64
    kernel: int = 31
    dropout: float = 0.2
    lookahead: int | None = None

    @property
    def ahead(self) -> int:
        """Frames that are seen ahead."""
        return (self.kernel - 1) // 2 if self.lookahead is None else self.lookahead

    @property
    def behind(self) -> int:
        """Frames that are seen behind."""
        return self.kernel - 1 - self.ahead


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
        drop = Dropout(config.dropout, deterministic)
        x = drop(jax.nn.elu(Conv(config.hidden, 1, matmul=self.matmul, name="conv0")(features)))
        if self.padding == "edge":
            x = jnp.pad(x, ((config.behind, config.ahead), (0, 0)), mode="edge")
        wide = Conv(config.size, config.kernel, padding="none", matmul=self.matmul, name="conv1")
        x = drop(jax.nn.elu(wide(x)))
        return jax.nn.elu(Dense(config.size, matmul=self.matmul, name="dense")(x))
