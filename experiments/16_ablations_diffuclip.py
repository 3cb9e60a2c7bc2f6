"""GestureDiffuCLIP without the style loss, with concatenation for AdaIN, without transcript (the ablations of Table 2).

    python experiments/16_ablations_diffuclip.py --checkpoint RUN --corpus CORPUS -o runs/ablations [--only NAME ...]

Of a finished run everything but the denoiser is taken over; each variant's denoiser is trained anew with so many
--updates, the full system's too, so that all have the same. Measured: SRA with held-out paraphrases (10 s each), FGD,
SRGR, SC and the right gesture at its word, over --samplings. Two calls with different --only may run side by side; a
stopped one goes on where it was. The expected order is the paper's: full, then concatenation, then no style loss (SRA);
full before no transcript (SRGR, SC).
"""

import argparse
import os
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import findings
import ledger
import paired
import prompted
import recognised
from prompted import Bench
from zeggs_jax.diffuclip import takes
from zeggs_jax.diffuclip.checkpoints import MODEL, load_model
from zeggs_jax.diffuclip.config import DiffuclipConfig
from zeggs_jax.diffuclip.model import Model
from zeggs_jax.diffuclip.train import train

NAME = "16_ablations_diffuclip"
PROMPT = "text, held-out paraphrase"


def variants(base: DiffuclipConfig, updates: int | None = None) -> dict[str, DiffuclipConfig]:
    """The full system and its variants, one thing changed in each."""
    if updates is not None:
        learn = replace(base.learn_denoiser, steps=updates, warmup=min(base.learn_denoiser.warmup, updates // 3))
        base = replace(base, learn_denoiser=learn)
    return {
        "full": base,
        "without style loss": replace(base, diffusion=replace(base.diffusion, style=0.0)),
        "style concatenated": replace(base, denoiser=replace(base.denoiser, style="concatenated")),
        "without transcript": replace(base, denoiser=replace(base.denoiser, transcript=False)),
    }


def trained(config: DiffuclipConfig, corpus: Path, out: Path, read: Path, initial: Model) -> Model:
    """The variant's model, trained where it is not there; it reads the clips that the first run keeps in `read`."""
    if not (out / MODEL).exists():
        out.mkdir(parents=True, exist_ok=True)
        if not (out / takes.FOLDER).exists():
            os.symlink(read.resolve(), out / takes.FOLDER, target_is_directory=True)
        train(corpus, out, config, initial=initial, only=("denoiser",))
    return load_model(out)


def jobs(bench: Bench, args: argparse.Namespace, name: str, model: Callable[[], Model]) -> ledger.Jobs:
    """What is measured of a variant; classifiers, net and detector are the same for all."""
    own = cache(lambda: bench._replace(model=model()))
    judge, tools = cache(partial(recognised.whole_judge, bench)), cache(partial(paired.instruments, bench))
    clips = paired.chosen(bench, args.clips)
    found = {}
    for k in range(args.samplings):
        found[f"{name}: prompts {k}"] = lambda k=k: recognised.sra(own(), judge(), PROMPT, k)
        found[f"{name}: speech {k}"] = lambda k=k: paired.made(own(), tools(), clips, paired.TEXT, k)
    return found


def table(rows: dict[str, list[ledger.Row]]) -> str:
    """A line for each variant."""
    measures = [measure for measure in findings.MEASURES if measure[0] in ("fgd", "srgr", "sc", "right")]
    body = []
    for name, of in rows.items():
        kinds = ledger.grouped(of, "kind")
        if {"sra", "paired"} - set(kinds):
            continue
        right = [
            sum(a == b for a, b in zip(row["made"], row["seen"], strict=True)) / len(row["made"])
            for row in kinds["sra"]
        ]
        cells = [
            findings.told(findings.spread([row[key] for row in kinds["paired"]]), form) for key, _, form in measures
        ]
        body.append([name, findings.told(findings.spread(right)), *cells])
    return ledger.table(["variant", "SRA", *(title for _, title, _ in measures)], body)


def main() -> None:
    parser = prompted.parser(__doc__)
    parser.add_argument("--updates", type=int, default=3000, help="of every variant's denoiser")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="variants to train and measure now; all if left out")
    args = parser.parse_args()
    bench = prompted.tune(args)
    every = variants(bench.model.config, args.updates)
    if unknown := set(args.only or ()) - set(every):
        parser.error(f"'{unknown.pop()}' is no variant; choose of {', '.join(every)}")
    read = args.checkpoint if args.checkpoint and (args.checkpoint / takes.FOLDER).is_dir() else args.out
    asked = {}
    for name, config in every.items():
        run = args.out / "runs" / f"{name.replace(' ', '_')}_{args.updates}"
        model = cache(partial(trained, config, args.corpus, run, read / takes.FOLDER, bench.model))
        asked[name] = jobs(bench, args, name, model)
    path = args.out / f"ablations_{args.updates}_{args.steps}.jsonl"
    for name in args.only or every:
        ledger.fill(path, asked[name], name)
    done = ledger.read(path)
    rows = {name: [done[job] for job in of if job in done] for name, of in asked.items()}
    about = f"{args.updates} updates of the denoiser each, {args.samplings} samplings:"
    ledger.tell(f"{about}\n\n{table(rows)}", NAME, args.docs)
    ledger.save(args.out / "ablations.json", rows)


if __name__ == "__main__":
    main()
