"""The joint space of gestures and transcripts: retrieval both ways, and which words matter (GestureDiffuCLIP Fig. 5).

    python experiments/14_joint_space.py MODEL CORPUS -o runs/joint_space [--docs docs/RESULTS.md]

Of the corpus' valid clips, in sentences: does a gesture find its sentence, and a sentence its gesture, against chance
and against what the length of the sentence alone gives away; does a gesture with one meaning find another sentence with
that meaning; are the words that carry a meaning among those of the largest saliency (Eq. 7), also where they are
synonyms that no training clip has. A corpus without known meanings gives the first table alone.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import ledger
from zeggs_jax.data import scale
from zeggs_jax.diffuclip import joint_embedding, takes, vqvae
from zeggs_jax.diffuclip.checkpoints import load_model
from zeggs_jax.diffuclip.model import Model, latents_of
from zeggs_jax.diffuclip.stages import joint
from zeggs_jax.diffuclip.stages.stage import Encoded, Material, Take
from zeggs_jax.metrics import retrieval
from zeggs_jax.stage import plots

NAME = "14_joint_space"
MODES = {"paper": "Eq. 7 as printed", "rescaled": "cosines"}
SHOWN = 6  # sentences in the figure, and gestures in the table of what they find


class Heard(NamedTuple):
    """Held-out sentences in the joint space."""

    said: Sequence[joint.Spoken]
    z_t: np.ndarray  # [N, D]
    z_g: np.ndarray
    weights: dict[str, list[np.ndarray]]  # by mode, the saliency of each sentence's words
    meant: list[dict[int, tuple[str, bool]]]  # word -> its meaning and whether it is a held-out synonym

    @property
    def similarity(self) -> np.ndarray:
        """[N, N], sentences by gestures."""
        return self.z_t @ self.z_g.T


def main() -> None:
    """Measure, tell, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=Path, help="a finished run of zeggs diffuclip train, or its model folder")
    parser.add_argument("corpus", type=Path, help="a corpus with transcripts; of the kind of 13_meaning_corpus.py")
    ledger.add_docs(parser)
    parser.add_argument("-o", "--out", type=Path, required=True)
    args = parser.parse_args()
    model = load_model(args.model)
    read, _, _ = takes.gather(args.corpus, args.out, model.config)
    heard = hear(model, read, args.corpus)
    guess = by_length(model, read, heard.said)
    ledger.tell(report(heard, guess), NAME, args.docs)
    ledger.save(args.out / "joint_space.json", numbers(heard, guess))
    draw(args.out / "joint_space.png", heard, guess)


def hear(model: Model, read: Sequence[Take], corpus: Path) -> Heard:
    """Every sentence of the valid clips, embedded with its gesture."""
    held = [take for take in read if take.split == "valid"]
    material = Material(held, model.motion_scale, model.skeleton, [_encoded(model, take) for take in held])
    said = joint.sentences(model.config, material, "valid")
    if len(said) < 2:
        raise ValueError(f"the corpus has {len(said)} sentences in its valid clips; give one with transcripts.")
    pairs = [joint.pair(model.config, material, one, None) for one in said]
    params = model.params["joint"]
    z_t, z_g = joint.embedded(params, model.config, pairs)
    encode = jax.jit(lambda spoken: joint_embedding.encode_text(params, model.config, spoken))
    weights: dict[str, list[np.ndarray]] = {mode: [] for mode in MODES}
    for one, pair in zip(said, pairs, strict=True):
        text = encode(pair.spoken)
        for mode in MODES:
            sharpness = model.config.joint.sharpness
            found = joint_embedding.saliency(text.words, text.pooled, pair.spoken.mask, mode, sharpness)  # type: ignore[arg-type]
            weights[mode].append(np.asarray(found)[: len(one.words)])
    notes = {take.name: _notes(corpus, take.name) for take in held}
    meant = [_meant(one, notes[held[one.take].name]) for one in said]
    return Heard(said, z_t, z_g, weights, meant)


def _encoded(model: Model, take: Take) -> Encoded:
    """The quantised latents of a take, on the model's scale."""
    z = latents_of(model, take.motion)
    padded = np.pad(z, ((0, -len(z) % 64), (0, 0)), mode="edge")
    quantised, codes = vqvae.quantise(model.params["codes"], model.config, scale.invert(model.latent_scale, padded))
    scaled = scale.apply(model.latent_scale, quantised)
    return Encoded(z, np.asarray(scaled)[: len(z)], np.asarray(codes)[: len(z)])


def _notes(corpus: Path, name: str) -> list[dict[str, Any]]:
    """The known meanings of a clip; none where the corpus does not tell them."""
    path = corpus / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")).get("meanings", []) if path.is_file() else []


def _meant(one: joint.Spoken, notes: list[dict[str, Any]]) -> dict[int, tuple[str, bool]]:
    return {
        k: (note["meaning"], note["synonym"])
        for note in notes
        for k, word in enumerate(one.words)
        if word.start <= note["time"] <= word.end
    }


def by_length(model: Model, read: Sequence[Take], said: Sequence[joint.Spoken]) -> np.ndarray:
    """[N, N]: how near the length that a sentence's words and letters suggest is to each gesture's.

    Seconds are fitted to the numbers of words and letters of the training clips' sentences by least squares.
    """
    spoken = joint.sentences(model.config, Material(read, model.motion_scale, model.skeleton), "train")
    rows = np.array([_size(one) for one in spoken])
    fit = np.linalg.lstsq(rows, np.array([one.seconds for one in spoken]), rcond=None)[0]
    guessed = np.array([_size(one) for one in said]) @ fit
    return -np.abs(guessed[:, None] - np.array([one.seconds for one in said])[None, :])


def _size(one: joint.Spoken) -> tuple[float, float, float]:
    return len(one.words), sum(len(word.text) for word in one.words), 1.0


def same_meaning(heard: Heard) -> tuple[float, float, int]:
    """(share of gestures whose nearest sentence but their own means the same, chance's, of how many gestures).

    Of sentences with one meaning each.
    """
    single = [k for k, meant in enumerate(heard.meant) if len(meant) == 1]
    names = np.array([next(iter(heard.meant[k].values()))[0] for k in single])
    similarity = (heard.z_g @ heard.z_t.T)[np.ix_(single, single)]
    np.fill_diagonal(similarity, -np.inf)
    alike = names[:, None] == names[None, :]
    np.fill_diagonal(alike, False)
    some = alike.any(1)
    if not some.any():
        return float("nan"), float("nan"), 0
    right = alike[np.arange(len(names)), similarity.argmax(1)]
    return float(right[some].mean()), float(alike[some].sum(1).mean() / (len(names) - 1)), int(some.sum())


def top_words(heard: Heard, mode: str, synonym: bool) -> tuple[float, float, int]:
    """(share of the words with meaning among their sentence's top-ranked, the same for equal weights, sentences).

    Of the sentences all of whose meanings are of the kind: training words or held-out synonyms.
    """
    some = [k for k, meant in enumerate(heard.meant) if meant and all(held == synonym for _, held in meant.values())]
    if not some:
        return float("nan"), float("nan"), 0
    weights = [heard.weights[mode][k] for k in some]
    return *retrieval.top_share(weights, [list(heard.meant[k]) for k in some]), len(some)


def numbers(heard: Heard, guess: np.ndarray) -> dict[str, Any]:
    """All that is measured, for JSON."""
    found: dict[str, Any] = {
        "retrieval": retrieval.recalls(heard.similarity)._asdict(),
        "by length": retrieval.recalls(guess)._asdict(),
    }
    if any(heard.meant):
        found["same meaning"] = same_meaning(heard)
        found["saliency"] = {f"{m}, {s}": top_words(heard, m, s == "synonyms") for m in MODES for s in KINDS}
    return found


KINDS = ("training words", "synonyms")


def report(heard: Heard, guess: np.ndarray) -> str:
    """The tables for docs/RESULTS.md."""
    found, length = retrieval.recalls(heard.similarity), retrieval.recalls(guess)
    rows = {
        "words → gesture": (*found.there.recalls, found.there.median),
        "gesture → words": (*found.back.recalls, found.back.median),
        "words → gesture by length alone": (*length.there.recalls, length.there.median),
        "gesture → words by length alone": (*length.back.recalls, length.back.median),
        "chance": (*found.chance, found.median),
    }
    head = [f"{found.count} held-out sentences", *(f"R@{k}" for k in retrieval.AT), "median rank"]
    body = [[name, *(f"{100 * x:.0f} %" for x in cells[:-1]), f"{cells[-1]:g}"] for name, cells in rows.items()]
    parts = [ledger.table(head, body)]
    if any(heard.meant):
        right, chance, count = same_meaning(heard)
        parts.append(
            f"Of {count} gestures with one meaning, {100 * right:.0f} % find a sentence of the same meaning first, "
            f"their own left out (chance {100 * chance:.0f} %)."
        )
        parts.append(_saliency_table(heard))
        parts.append(_found_table(heard))
    return "\n\n".join(parts)


def _saliency_table(heard: Heard) -> str:
    body = []
    for mode, name in MODES.items():
        for kind in KINDS:
            share, even, count = top_words(heard, mode, kind == "synonyms")
            if count:
                body.append([f"{name}, {kind}", str(count), f"{100 * share:.0f} %", f"{100 * even:.0f} %"])
    head = ["saliency", "sentences", "words with meaning that are top-ranked", "with equal weights"]
    return ledger.table(head, body)


def _found_table(heard: Heard) -> str:
    """Some gestures with meaning, their own sentences and the sentences that they find first."""
    body = []
    for k in shown(heard):
        first = retrieval.nearest(heard.z_g[[k]] @ heard.z_t.T, 1)[0][0]
        place = int((heard.z_g[k] @ heard.z_t.T > heard.z_g[k] @ heard.z_t[k]).sum()) + 1
        body.append([_marked(heard, k), _marked(heard, first), str(place)])
    return ledger.table(["the gesture's own sentence", "the sentence that it finds first", "rank of its own"], body)


def _marked(heard: Heard, k: int) -> str:
    words = enumerate(heard.said[k].words)
    return " ".join(f"**{word.text}**" if at in heard.meant[k] else word.text for at, word in words)


def shown(heard: Heard) -> list[int]:
    """Sentences of different meanings, of middle length, the same ones for every model."""
    picked: dict[str, int] = {}
    for k in np.argsort([abs(len(one.words) - 9) for one in heard.said], kind="stable").tolist():
        for name, _ in heard.meant[k].values():
            if name not in picked and k not in picked.values():
                picked[name] = k
    return list(picked.values())[:SHOWN] or list(range(min(SHOWN, len(heard.said))))


def draw(path: Path, heard: Heard, guess: np.ndarray) -> None:
    """The figure: (a) saliency over the words of some sentences, (b) recall against the number of candidates taken."""
    picked = shown(heard)
    with plots.sheet(path, plots.PAGE, 0.62 * len(picked) + 0.6) as figure:
        grid = figure.add_gridspec(len(picked), 3)
        for row, k in enumerate(picked):
            axes = figure.add_subplot(grid[row, :2])
            if row == 0:
                axes.set_title("(a) saliency of words; those with a gesture of their own in colour")
            values = heard.weights["rescaled"][k]
            inks = [plots.COLOURS[1] if at in heard.meant[k] else plots.SOFT for at in range(len(values))]
            axes.bar(np.arange(len(values)), values, 0.72, color=inks)
            axes.axhline(1.0, color=plots.INK, linewidth=0.5, linestyle=":")
            names = [word.text for word in heard.said[k].words]
            axes.set_xticks(np.arange(len(values)), names, rotation=0 if len(values) < 11 else 18, fontsize=5.5)
            axes.tick_params(axis="x", length=0)
        axes = figure.add_subplot(grid[:, 2])
        axes.set_title("(b) recall")
        curves = {"words → gesture": heard.similarity, "gesture → words": heard.similarity.T, "by length": guess}
        counts = np.arange(1, len(heard.said) + 1)
        for (name, matrix), ink in zip(curves.items(), (*plots.COLOURS[:2], plots.SOFT), strict=True):
            places = retrieval.ranks(matrix)
            axes.plot(counts / len(counts), [(places <= k).mean() for k in counts], color=ink, label=name)
        axes.plot([0, 1], [0, 1], color=plots.SOFT, linestyle=":", label="chance")
        axes.set(xlabel="share of the candidates taken", ylabel="found among them", xlim=(0, 1), ylim=(0, 1.02))
        axes.legend(loc="lower right")


if __name__ == "__main__":
    main()
