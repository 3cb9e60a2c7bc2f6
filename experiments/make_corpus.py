"""Build the training corpus of the bundled model: our own voice, and TTS voices where their programs exist.

    python experiments/make_corpus.py OUT --minutes 120 --hold-out-voices kal_diphone +m4 +f3

Clips by a held-out voice go to OUT/new_speaker, which training never sees (03_generalisation.py wants it).
espeak-ng and festival are asked for only here (Debian: espeak-ng festival festvox-kallpc16k festvox-kdlpc16k
festvox-us-slt-hts); without them every clip is spoken by the package's own voice.
"""

import argparse
import multiprocessing
import os
import shutil
import subprocess
import tempfile
from functools import partial
from pathlib import Path

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import numpy as np
from tqdm import tqdm

from zeggs_jax.speech import wav
from zeggs_jax.synthetic import corpus, prosody, recording, sentences

ESPEAK = ("en-us", "en-gb", "en-gb-scotland", "en-gb-x-rp", "en-029", "en-gb-x-gbclan")
ESPEAK_VARIANTS = (
    "",
    "+f1",
    "+f2",
    "+f3",
    "+f4",
    "+m1",
    "+m2",
    "+m3",
    "+m4",
    "+m5",
    "+m7",
    "+croak",
    "+whisperf",
)
FESTIVAL = ("kal_diphone", "ked_diphone", "cmu_us_slt_arctic_hts")
SECONDS = (15.0, 30.0)
NEW_SPEAKER = "new_speaker"


def programs() -> tuple[str, ...]:
    """The TTS programs found on this machine."""
    found = {"espeak": shutil.which("espeak-ng"), "festival": shutil.which("text2wave")}
    return tuple(name for name, path in found.items() if path)


def espeak(text: str, path: Path, draw: np.random.Generator) -> str:
    """Say `text` with one of espeak-ng's voices, at some speed and pitch; which one."""
    voice = f"{draw.choice(ESPEAK)}{draw.choice(ESPEAK_VARIANTS)}"
    speed, pitch = int(draw.integers(125, 190)), int(draw.integers(25, 75))
    command = ["espeak-ng", "-v", voice, "-s", str(speed), "-p", str(pitch), "-w", str(path), text]
    subprocess.run(command, check=True, capture_output=True)
    return f"espeak-ng {voice} -s {speed} -p {pitch}"


def festival(text: str, path: Path, draw: np.random.Generator) -> str:
    """Say `text` with one of festival's voices, at some speed; which one."""
    voice, stretch = str(draw.choice(FESTIVAL)), round(float(draw.uniform(0.9, 1.25)), 2)
    choose = f"(begin (voice_{voice}) (Parameter.set 'Duration_Stretch {stretch}))"
    command = ["text2wave", "-eval", choose, "-o", str(path)]
    subprocess.run(command, input=text, text=True, check=True, capture_output=True)
    return f"festival {voice} stretch {stretch}"


def pause_longer(wave: np.ndarray, draw: np.random.Generator) -> np.ndarray:
    """The speech with most of its pauses longer by 0.2 to 1.2 s, for TTS programs hardly breathe."""
    hop = 16000 // prosody.ENVELOPE_HZ
    silent = prosody.envelope(wave) < prosody.SILENT
    edges = np.flatnonzero(np.diff(np.concatenate([[0], silent.astype(np.int8), [0]]))).reshape(-1, 2)
    parts, last = [], 0
    for start, end in edges.tolist():
        if end - start > 0.13 * prosody.ENVELOPE_HZ and draw.random() < 0.75:
            middle = (start + end) // 2 * hop
            parts += [wave[last:middle], np.zeros(int(16000 * draw.uniform(0.2, 1.2)), np.float32)]
            last = middle
    return np.concatenate([*parts, wave[last:]])


def record(take: corpus.Take, spoken_by: tuple[str, ...], synthetic_share: float) -> recording.Recording:
    """The take's text by a voice drawn from its seed: ours, or one of the programs `spoken_by`."""
    draw = np.random.default_rng([take.seed, 41])
    if not spoken_by or draw.random() < synthetic_share:
        return recording.speak(take.seconds, take.seed)
    speak = {"espeak": espeak, "festival": festival}[str(draw.choice(spoken_by))]
    text = sentences.monologue(take.seed, int(recording.WORDS_PER_SECOND * take.seconds))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speech.wav"
        speaker = speak(text, path, draw)
        wave = pause_longer(wav.read(path), draw)
    heard = prosody.measure(wave)
    start = int(heard.phrases[0, 0] * 16000) if len(heard.phrases) else 0
    silence = np.zeros(int(16000 * recording.lead_silence(take.seed)), np.float32)
    return recording.Recording(np.concatenate([silence, wave[max(start - 1600, 0) :]]), text, (), speaker)


def held_out(speaker: str, voices: tuple[str, ...]) -> bool:
    """Whether the speaker, such as 'espeak-ng en-us+m4 -s 150 -p 50', is one of the voices, such as '+m4'."""
    return any(word.endswith(voice) for word in speaker.split() for voice in voices)


def make(
    take: corpus.Take, folder: Path, spoken_by: tuple[str, ...], synthetic_share: float, without: tuple[str, ...]
) -> corpus.Take:
    """Record, perform and write one take; one of the corpus itself by a voice of `without` goes to NEW_SPEAKER."""
    speech = record(take, spoken_by, synthetic_share)
    if "/" not in take.name and held_out(speech.speaker, without):
        take = take._replace(name=f"{NEW_SPEAKER}/{take.name}", split="valid")
    corpus.write_take(folder, take, speech)
    return take


def main() -> None:
    """Plan the takes, write them in parallel, write the index."""
    parser = argparse.ArgumentParser(description="Build the training corpus of the bundled model.")
    parser.add_argument("out", type=Path)
    parser.add_argument("--minutes", type=float, default=120.0, help="length of the corpus")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--synthetic-share", type=float, default=0.4, help="clips by our own voice where TTS exists")
    parser.add_argument("--random-share", type=float, default=0.6, help="clips of random points between the styles")
    parser.add_argument("--hold-out-voices", nargs="+", default=(), metavar="VOICE", help="ends of voice names")
    arguments = parser.parse_args()
    clips = max(1, round(60.0 * arguments.minutes / (0.5 * sum(SECONDS))))
    share = arguments.random_share
    takes = corpus.plan(corpus.CorpusConfig(clips=clips, seconds=SECONDS, seed=arguments.seed, random_share=share))
    spoken_by = programs()
    print(f"{len(takes)} clips, voices: {', '.join(('synthetic', *spoken_by))}")
    settings = {"folder": arguments.out, "spoken_by": spoken_by, "synthetic_share": arguments.synthetic_share}
    one = partial(make, **settings, without=tuple(arguments.hold_out_voices))
    with multiprocessing.get_context("spawn").Pool(arguments.processes) as pool:
        made = list(tqdm(pool.imap(one, takes), total=len(takes), unit="clip"))
    corpus.write_index(arguments.out, made)


if __name__ == "__main__":
    main()
