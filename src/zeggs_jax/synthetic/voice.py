"""Words to a waveform: a formant voice whose word times, stresses and pitch are known exactly."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32
from scipy.ndimage import gaussian_filter1d

from zeggs_jax.synthetic.phones import Phone, syllables

RATE = 16000
HOP = 80  # samples of one control frame: 5 ms
PAUSE = {
    ",": (0.25, 0.45),
    ";": (0.35, 0.6),
    ":": (0.35, 0.6),
    ".": (0.6, 1.3),
    "!": (0.6, 1.3),
    "?": (0.6, 1.3),
}


class Word(NamedTuple):
    """One spoken word; times in s, `nucleus` the middle of its stressed (or first) vowel."""

    text: str
    start: float
    end: float
    stressed: bool
    nucleus: float


class Voice(NamedTuple):
    """Who speaks: pitch in Hz, pace relative to 1, formants relative to a male tract, breath 0..1."""

    pitch: float = 120.0
    pace: float = 1.0
    tract: float = 1.0
    breath: float = 0.1
    liveliness: float = 0.2  # relative rise of the pitch on stressed syllables


class Controls(NamedTuple):
    """Synthesis targets, one row for each 5 ms frame."""

    pitch: Float[np.ndarray, " F"]  # Hz
    formants: Float[np.ndarray, "F 3"]  # Hz
    voice: Float[np.ndarray, " F"]
    noise: Float[np.ndarray, " F"]
    centre: Float[np.ndarray, " F"]  # Hz


class _Score(NamedTuple):
    phones: list[Phone]
    levels: list[float]
    accents: list[tuple[float, float]]  # time s, relative size
    words: list[Word]


def random_voice(seed: int) -> Voice:
    """A voice between a low man's and a child's."""
    draw = np.random.default_rng([seed, 3])
    tract = float(draw.uniform(0.95, 1.25))
    pitch = float(110.0 * tract**3 * draw.uniform(0.8, 1.2))
    return Voice(
        pitch,
        float(draw.uniform(0.85, 1.2)),
        tract,
        float(draw.uniform(0.02, 0.3)),
        float(draw.uniform(0.1, 0.35)),
    )


def _rest(seconds: float) -> Phone:
    return Phone(seconds, 500.0, 1500.0, 2500.0, 0.0, 0.0, 3000.0)


def _score(text: Sequence[str], voice: Voice, draw: np.random.Generator, lead: float) -> _Score:
    """Lay the words out in time; stressed vowels are longer, louder and higher."""
    score = _Score([_rest(lead)], [1.0], [], [])
    now = lead
    for written in text:
        start, nucleus, stressed = now, None, False
        for syllable in syllables(written):
            push = float(draw.uniform(0.8, 1.25)) if syllable.stressed else float(draw.uniform(0.38, 0.52))
            for phone in syllable.phones:
                stretch = (1.35 if syllable.stressed else 0.75) if phone.vowel else 1.0
                seconds = phone.seconds * stretch / voice.pace * float(draw.uniform(0.92, 1.08))
                if phone.vowel and (nucleus is None or (syllable.stressed and not stressed)):
                    nucleus, stressed = now + 0.5 * seconds, syllable.stressed
                    if stressed:
                        score.accents.append((nucleus, push))
                score.phones.append(phone._replace(seconds=seconds))
                score.levels.append(push)
                now += seconds
        score.words.append(Word(written.rstrip(".,;:!?"), start, now, stressed, start if nucleus is None else nucleus))
        if written[-1] in PAUSE:
            gap = float(draw.uniform(*PAUSE[written[-1]]))
            score.phones.append(_rest(gap))
            score.levels.append(1.0)
            now += gap
    return score


def _pitch(score: _Score, voice: Voice, frames: int) -> Float[np.ndarray, " F"]:
    """Declination through each phrase and a rise on each stressed vowel."""
    time = np.arange(frames) * HOP / RATE
    starts = np.array([w.start for k, w in enumerate(score.words) if k == 0 or w.start > score.words[k - 1].end + 0.1])
    since = time - starts[np.clip(np.searchsorted(starts, time, "right") - 1, 0, None)]
    contour = 0.9 + 0.2 * np.exp(-np.maximum(since, 0.0) / 1.5)
    for when, size in score.accents:
        contour = contour + voice.liveliness * size * np.exp(-0.5 * ((time - when) / 0.07) ** 2)
    return voice.pitch * contour


def _controls(score: _Score, voice: Voice) -> Controls:
    ends = np.cumsum([p.seconds for p in score.phones])
    frames = int(np.ceil(ends[-1] * RATE / HOP))
    owner = np.minimum(np.searchsorted(ends, (np.arange(frames) + 0.5) * HOP / RATE, "right"), len(ends) - 1)
    formants = np.array([[p.f1, p.f2, p.f3] for p in score.phones])[owner] * voice.tract
    levels = np.array(score.levels)[owner]
    loud = gaussian_filter1d(np.array([p.voice for p in score.phones])[owner] * levels, 2.5)
    hiss = np.array([p.noise for p in score.phones])[owner] * np.sqrt(levels)
    return Controls(
        _pitch(score, voice, frames),
        gaussian_filter1d(formants, 4.0, axis=0),
        loud,
        gaussian_filter1d(hiss, 1.5) + voice.breath * 0.15 * loud,
        np.array([p.centre for p in score.phones])[owner],
    )


def _resonances(hz: Float[np.ndarray, "F K"], formants: Float[np.ndarray, "F 3"]) -> Float[np.ndarray, "F K"]:
    """Gain of the vocal tract: three second-order resonances in cascade with a fixed fourth."""
    gain = np.ones_like(hz)
    for centre, width in (
        (formants[:, :1], 80.0),
        (formants[:, 1:2], 110.0),
        (formants[:, 2:], 160.0),
        (3700.0, 250.0),
    ):
        gain = gain * centre**2 / np.sqrt((centre**2 - hz**2) ** 2 + (width * hz) ** 2)
    return gain


def _voiced(c: Controls, samples: int) -> Float[np.ndarray, " n"]:
    """Harmonics of the pitch, -6 dB an octave, shaped by the tract."""
    grid, time = np.arange(len(c.pitch)) * HOP, np.arange(samples)
    phase = 2.0 * np.pi * np.cumsum(np.interp(time, grid, c.pitch)) / RATE
    count = int(min(40, 6500.0 / np.median(c.pitch)))
    order = np.arange(1, count + 1)
    hz = c.pitch[:, None] * order[None, :]
    levels = np.where(hz < 7500.0, _resonances(hz, c.formants) / order[None, :], 0.0) * c.voice[:, None]
    wave = np.zeros(samples)
    for k in range(count):
        wave += np.interp(time, grid, levels[:, k]) * np.sin(order[k] * phase)
    return wave


def _hissed(c: Controls, samples: int, draw: np.random.Generator) -> Float[np.ndarray, " n"]:
    """White noise in a moving band, by overlap-add of 10 ms windows."""
    size, frames = 2 * HOP, len(c.noise)
    hz = np.fft.rfftfreq(size, 1.0 / RATE)
    band = np.exp(-0.5 * ((hz[None, :] - c.centre[:, None]) / 1300.0) ** 2) * c.noise[:, None]
    noise = np.fft.irfft(np.fft.rfft(draw.standard_normal((frames, size)), axis=1) * band, axis=1)
    noise *= np.hanning(size + 1)[None, :size]
    wave = np.zeros((frames + 1) * HOP)
    wave[: frames * HOP] += noise[:, :HOP].ravel()
    wave[HOP:] += noise[:, HOP:].ravel()
    return np.resize(wave, samples) if len(wave) >= samples else np.pad(wave, (0, samples - len(wave)))


def speak(
    text: str | Sequence[str], seed: int, voice: Voice | None = None, lead: float = 0.3
) -> tuple[Float32[np.ndarray, " n"], list[Word]]:
    """Say `text` (punctuation makes pauses): (mono wave at 16 kHz, peak 0.5; its words).

    `lead` is the silence in s before the first word. Same arguments, same samples. ValueError for a text
    without words.
    """
    spoken = [w for w in (text.split() if isinstance(text, str) else text) if any(ch.isalpha() for ch in w)]
    if not spoken:
        raise ValueError(f"nothing to say in {text!r}; give at least one word.")
    draw = np.random.default_rng([seed, 5])
    who = random_voice(seed) if voice is None else voice
    score = _score(spoken, who, draw, lead)
    controls = _controls(score, who)
    samples = len(controls.pitch) * HOP
    wave = _voiced(controls, samples) + _hissed(controls, samples, draw)
    return (0.5 * wave / max(float(np.abs(wave).max()), 1e-9)).astype(np.float32), score.words
