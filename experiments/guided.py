"""Guidance (GestureDiffuCLIP Eq. 17, Fig. 9) and prompts that change with every sentence (Fig. 10), measured."""

from collections.abc import Sequence

import numpy as np

import ledger
import prompted
import recognised
import transitions
import truth
from prompted import Ask, Bench
from zeggs_jax.diffuclip import representation, request
from zeggs_jax.diffuclip.generate import Wishes
from zeggs_jax.metrics import factors
from zeggs_jax.metrics.factors import Ruler
from zeggs_jax.speech import transcript
from zeggs_jax.synthetic import captions, styles

SCALES = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)


def factor_of(style: str) -> tuple[str, float]:
    """(the factor that makes a style what it is, +1 or -1): the farthest from the mean of all, in its span."""
    middle = np.mean([np.asarray(styles.STYLES[name]) for name in styles.TRAINING], axis=0)
    apart = (np.asarray(styles.STYLES[style]) - middle) / truth.SPAN
    most = int(np.abs(apart).argmax())
    return truth.NAMES[most], float(np.sign(apart[most]))


def scaled(bench: Bench, ruler: Ruler, style: str, sampling: int) -> ledger.Row:
    """What the ruler reads of a style's factor at every scale, same speech, same noise, same prompt."""
    name, sign = factor_of(style)
    said = recognised.speech(bench, sampling + sum(map(ord, style)))
    prompt = prompted.prompt(bench, "text, held-out paraphrase", style, sampling)
    read = []
    asked = [Ask(said, prompted.wish(bench, prompt, scale), sampling, recognised.SECONDS) for scale in SCALES]
    for made in prompted.perform(bench, asked):
        settled = made.motion[round(recognised.SETTLE_S / bench.model.config.frame_time) :]
        clip = representation.decode(settled, bench.model.skeleton, bench.model.config.frame_time)
        found = factors.recover(ruler, factors.measures(clip))
        read.append(float(found[truth.NAMES.index(name)]))
    return {"kind": "guidance", "style": style, "factor": name, "sign": sign, "sampling": sampling, "read": read}


def changed(bench: Bench, sampling: int) -> ledger.Row:
    """Peak accelerations where the prompt changes, by part of the body; and at the same times where it does not."""
    able = [said for said in bench.of("valid") if len(transcript.sentences(said.take.words)) > 1]
    if not able:
        raise ValueError("no clip of the corpus has two sentences; give one with transcripts.")
    said = able[sampling % len(able)]
    order = np.random.default_rng([sampling, 3]).permutation(list(styles.TRAINING)).tolist()
    sentences = transcript.sentences(said.take.words)
    texts = [captions.captions(order[k % len(order)], 300 + sampling, held_out=True) for k in range(len(sentences))]
    cues = request.by_sentence(sentences, texts)
    each = [prompted.wish(bench, prompted.of_text(bench, cue.prompt)).each[0] for cue in cues]
    times = [cue.time for cue in cues[1:] if cue.time + 0.5 < len(said.take.motion) * bench.model.config.frame_time]
    wishes = Wishes(tuple(cue.time for cue in cues), tuple(each)), Wishes((0.0,), (each[0],))
    many, one = prompted.perform(bench, [Ask(said, wish, sampling) for wish in wishes])
    return {
        "kind": "changes", "sampling": sampling, "clip": said.take.name, "order": order[: len(cues)], "times": times,
        "peaks": transitions.peaks_of(many.movement, times), "steady": transitions.peaks_of(one.movement, times),
    }  # fmt: skip


def true_peaks(bench: Bench) -> ledger.Row:
    """The truth's: all windows of the clips of all named styles, as the codes show them and as they are."""
    named = [said for said in bench.said if said.upper]
    peaks: dict[str, list[float]] = {}
    for said in named[:: max(len(named) // 60, 1)]:
        motion = prompted.movement(bench.model, said.take.motion)
        seconds = len(motion.positions) / motion.rate_hz
        times: Sequence[float] = np.arange(0.0, seconds - transitions.WINDOW_S + 1e-6, transitions.WINDOW_S).tolist()
        for part, values in transitions.peaks_of(motion, times).items():
            peaks.setdefault(part, []).extend(values)
    return {"kind": "true peaks", "clips": len(named), "peaks": peaks}
