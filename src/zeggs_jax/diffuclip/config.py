"""Settings of GestureDiffuCLIP, typed and frozen; the defaults are the paper's, `SMALL` fits two cores."""

from dataclasses import dataclass, field
from typing import Literal

from ..data.body import AS_IS, BodyConfig

Parts = tuple[str, ...]


@dataclass(frozen=True)
class CodesConfig:
    """The VQ-VAE (Sec. 4). Where the paper is silent: Jukebox's convolutions with the sizes of the same laboratory."""

    latent: int = 512  # C, channels of Z, for each part of the body
    codes: int = 512  # entries of one codebook
    quantisers: int = 1  # residual codebooks; 1 is the paper's
    width: int = 512  # of the convolutions
    halvings: int = 3  # each halves the rate: 2^3 = 8 frames become one latent
    depth: int = 3  # residual blocks at each rate
    dilation: int = 3  # growth of the dilation from block to block
    decay: float = 0.99  # of the moving averages that the codebook follows
    revive: float = 1.0  # codes used less than this (moving count of latents in a batch) are drawn anew
    commit: float = 0.02
    velocity: float = 1.0
    acceleration: float = 1.0

    @property
    def rate(self) -> int:
        """Frames that one latent stands for, d."""
        return 2**self.halvings


@dataclass(frozen=True)
class JointConfig:
    """The gesture-transcript embedding (Sec. 5)."""

    text: Literal["t5", "minilm", "words"] = "t5"  # T5's encoder, a frozen MiniLM, or a small encoder of hashed words
    width: int = 768  # D of both encoders
    layers: int = 12  # of the gesture encoder
    heads: int = 12
    text_layers: int = 12  # of the text encoder where it is trained from nothing
    words: int = 64  # most tokens of a sentence
    latents: int = 112  # most latents of a sentence (15 s)
    temperature: float = 0.07
    distilled: float = 0.4  # w_contrast of Eq. 6
    momentum: float = 0.995  # of the teachers
    masked: float = 0.15  # share of latents that the masked pretraining hides
    saliency: Literal["paper", "rescaled"] = "paper"  # Eq. 7 and 12 to the letter, or times L_t, from cosines
    sharpness: float = 0.1  # temperature of the rescaled saliency
    normalise: bool = True  # cosine similarities in Eq. 5, as CLIP; Eq. 5 prints plain products
    dropout: float = 0.1
    folder: str = ""  # the local folder with T5, as Hugging Face lays it out, where text is "t5"


@dataclass(frozen=True)
class PromptsConfig:
    """Text, motion and video to one prompt space (Sec. 6.1.2, 6.2.1)."""

    text: Literal["clip", "words"] = "clip"  # CLIP's text tower from a local folder, or a small one trained with us
    size: int = 768  # of the prompt space, C_CLIP
    width: int = 512  # of the motion encoder
    layers: int = 8
    heads: int = 8
    frames: int = 240  # most motion frames of a prompt; longer ones are cut or sampled
    patch: int = 1  # motion frames of one token of the motion encoder
    clip: str = ""  # the local folder with CLIP, as Hugging Face lays it out, where text or image is "clip"
    image: Literal["clip", "small"] = "clip"  # CLIP's frozen image tower, or a small one trained with the video encoder
    pixels: int = 224
    video_frames: int = 16  # images that a video prompt is sampled to
    video_width: int = 768
    video_layers: int = 6
    video_heads: int = 12
    temperature: float = 0.07
    dropout: float = 0.1
    grounded: bool = False  # texts and videos are brought to the nearest motions of the training; the paper's are not


@dataclass(frozen=True)
class DenoiserConfig:
    """The denoising network (Sec. 6.1, Fig. 6)."""

    width: int = 768
    layers: int = 12
    heads: int = 12
    ahead: int = 8  # delta_a: future latents of audio that a latent sees (1.07 s)
    style: Literal["adain", "concatenated"] = "adain"  # the second is the ablation of Table 2
    transcript: bool = True  # without: the ablation of Table 2
    word_times: bool = True  # attention to words depends on how long ago or ahead they are spoken
    output: Literal["noise", "velocity"] = "noise"  # what the last layer gives; the noise follows from the velocity
    dropout: float = 0.1


@dataclass(frozen=True)
class DiffusionConfig:
    """The diffusion process (Sec. 6.1, 6.2)."""

    steps: int = 1000  # N
    schedule: Literal["cosine", "linear"] = "cosine"
    per_token: bool = True  # a noise level for each latent and clean prefixes; False: one level for the whole window
    dropped: float = 0.1  # share of prompts dropped for guidance
    captioned: float = 0.0  # share of prompts that are a caption instead of a motion; the paper trains without labels
    independent: float = 0.2  # share of windows, with `per_token`, whose latents have levels of their own
    context: int = 40  # most clean latents before the noisy ones, in training and in autoregressive use
    chunk: int = 8  # latents made at once in autoregressive use; 1 is Eq. 9 to the letter
    semantic: float = 0.1  # weight of Eq. 15
    style: float = 0.07  # weight of Eq. 16
    perceptual: float = 1.0  # share of a batch that the last two are computed for
    return_step: int = 500  # where the short denoising of the perceptual losses starts
    short_steps: int = 6  # DDIM steps of it; 0: the one-step estimate of z_0, weighted by alpha_bar
    seam: float = 0.01  # w_body of Eq. 19


@dataclass(frozen=True)
class StageConfig:
    """How one stage is trained; every count is of updates."""

    steps: int
    batch: int
    learning_rate: float = 1e-4
    warmup: int = 1000
    weight_decay: float = 0.01
    seconds: float = 4.0  # length of a training window
    ema: float | None = None  # decay of the average of the parameters
    clip_norm: float | None = 1.0
    log_every: int = 50
    checkpoint_every: int = 1000


@dataclass(frozen=True)
class DiffuclipConfig:
    """All of GestureDiffuCLIP at the paper's sizes.

    `parts` names the parts of the body with codes and latents of their own (Sec. 6.3); () is one for the whole body.
    `frame_time` is what the motion is resampled to; `joints` and `body`, how files are read, follow from the corpus.
    """

    frame_time: float = 1 / 60
    joints: int = 75
    body: BodyConfig = AS_IS
    parts: Parts = ()
    codes: CodesConfig = field(default_factory=CodesConfig)
    joint: JointConfig = field(default_factory=JointConfig)
    prompts: PromptsConfig = field(default_factory=PromptsConfig)
    denoiser: DenoiserConfig = field(default_factory=DenoiserConfig)
    diffusion: DiffusionConfig = field(default_factory=DiffusionConfig)
    seed: int = 0
    learn_codes: StageConfig = StageConfig(400_000, 32, ema=0.99)
    learn_gestures: StageConfig = StageConfig(100_000, 32, seconds=15.0)  # masked pretraining of the gesture encoder
    learn_joint: StageConfig = StageConfig(50_000, 32, seconds=15.0)
    learn_prompts: StageConfig = StageConfig(200_000, 64)
    learn_video: StageConfig = StageConfig(50_000, 32)
    learn_denoiser: StageConfig = StageConfig(500_000, 128, warmup=2000, seconds=15.0, ema=0.999)

    def __post_init__(self) -> None:
        if self.parts not in ((), ("upper", "lower")):
            raise ValueError(f"parts are {', '.join(self.parts)}; expected none, or upper and lower.")
        for name, (width, heads) in {
            "joint": (self.joint.width, self.joint.heads),
            "prompts": (self.prompts.width, self.prompts.heads),
            "denoiser": (self.denoiser.width, self.denoiser.heads),
        }.items():
            if width % heads:
                raise ValueError(f"{name}.width is {width}, which its {heads} heads do not divide.")

    @property
    def motion_size(self) -> int:
        """Numbers of a motion frame: root displacement and two axes of every joint."""
        return 3 + 6 * self.joints

    @property
    def latent_size(self) -> int:
        """Channels of Z, over all parts."""
        return self.codes.latent * max(len(self.parts), 1)

    @property
    def latents_hz(self) -> float:
        """Latents in a second."""
        return 1.0 / (self.frame_time * self.codes.rate)


SMALL = DiffuclipConfig(
    frame_time=1 / 30,
    parts=("upper", "lower"),
    codes=CodesConfig(latent=32, codes=256, quantisers=4, width=96, halvings=2, depth=2),
    joint=JointConfig("words", 64, 2, 4, text_layers=1, words=24, latents=48, saliency="rescaled"),
    prompts=PromptsConfig(
        "words", 64, 128, 3, 4, frames=180, patch=6, image="small", pixels=48, video_frames=16,
        video_width=64, video_layers=2, video_heads=4, grounded=True,
    ),
    denoiser=DenoiserConfig(128, 4, 4, output="velocity"),
    diffusion=DiffusionConfig(short_steps=0, captioned=0.4, perceptual=0.125),
    learn_codes=StageConfig(4000, 32, 5e-4, 200, seconds=2.14, ema=0.99),
    learn_gestures=StageConfig(1000, 32, 5e-4, 100, seconds=8.0),
    learn_joint=StageConfig(1200, 64, 1e-3, 100, seconds=8.0),
    learn_prompts=StageConfig(1200, 64, 5e-4, 100, seconds=6.0),
    learn_video=StageConfig(800, 16, 5e-4, 100, seconds=6.0),
    learn_denoiser=StageConfig(6000, 32, 5e-4, 300, seconds=6.4, ema=0.999),
)  # fmt: skip
"""The bundled model's settings: every part of the paper's system, small enough to train on two CPU cores."""
