"""What GestureDiffuCLIP's small model does, measured beside truth, chance and ZeroEGGS (Table 2, Eq. 20, Fig. 9, 10).

    python experiments/15_diffuclip.py --checkpoint RUN --corpus CORPUS -o runs/diffuclip [--only PART ...]

Parts: codes (reconstruction and perplexity of the VQ-VAE), prompts (styles recognised under text, motion and video
prompts), paired (FGD, SRGR, SC and the right gesture at its word, with and without transcript, beside ZeroEGGS),
guidance (the prompted factor against the scale), changes (peak acceleration where the prompt changes), halves (upper
and lower body under prompts of their own). Everything that is drawn is drawn so many times as --samplings says; speech
is of valid clips, whose voices no training has heard. Prints tables, writes OUT/diffuclip.json and a figure; a stopped
run goes on where it was.
"""

import argparse
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import jax
import jax.numpy as jnp

import findings
import guided
import ledger
import paired
import prompted
import recognised
import truth
from prompted import Bench
from zeggs_jax.diffuclip import checkpoints, prompts
from zeggs_jax.diffuclip.stages import codes
from zeggs_jax.diffuclip.stages.stage import Material
from zeggs_jax.synthetic import styles
from zeggs_jax.training.step import TrainState

NAME = "15_diffuclip"
GUIDED = 3  # samplings at seven scales each
Job = Callable[[], ledger.Row]


def reconstructed(bench: Bench) -> ledger.Row:
    """What the codes lose of the valid clips, as the stage that trains them judges it."""
    takes = [said.take for said in bench.said]
    stage = codes.stage(bench.model.config, Material(takes, bench.model.motion_scale, bench.model.skeleton), {})
    assert stage.validate
    state = TrainState(jnp.zeros((), jnp.int32), jax.tree.map(jnp.asarray, bench.model.params["codes"]), None, None)
    sizes = {
        name: sum(leaf.size for leaf in jax.tree.leaves(component)) for name, component in bench.model.params.items()
    }
    return {"kind": "codes", "parameters": sizes, **stage.validate(state)}


def told(bench: Bench, judges: dict[str, recognised.Judge], head: str) -> ledger.Row:
    """How good the judges are."""
    own = {name: {"own": j.own, "clips": j.clips, "styles": list(j.centroids.names)} for name, j in judges.items()}
    return {"kind": "judges", "head": head, "judges": own}


def instrument(bench: Bench, of: Callable[[], paired.Instruments]) -> ledger.Row:
    """How good the recogniser of meanings is, and which net FGD is of."""
    at = of()
    return {"kind": "instruments", "accuracy": at.own.accuracy, "alarms": at.own.alarms, "net": at.weights}


def jobs(bench: Bench, args: argparse.Namespace) -> dict[str, dict[str, Job]]:
    """All that is asked, by part and name; instruments are made when the first of them is done."""
    count = args.samplings
    whole = cache(partial(recognised.whole_judge, bench))
    halves = cache(lambda: {half: recognised.half_judge(bench, half) for half in ("upper", "lower")})
    tools, ruler = cache(partial(paired.instruments, bench)), cache(partial(truth.ruler, args.ruler))
    clips = paired.chosen(bench, args.clips)
    head = prompts.best_head(bench.model.params["prompts"], bench.model.config)
    kinds = [kind for kind in recognised.PROMPTS if kind != "video" or "video" in bench.model.params["prompts"]]
    found: dict[str, dict[str, Job]] = {"codes": {"codes": partial(reconstructed, bench)}, "prompts": {}, "paired": {}}
    found |= {"guidance": {}, "changes": {"truth": partial(guided.true_peaks, bench)}, "halves": {}}
    found["prompts"]["judges"] = lambda: told(bench, {"whole": whole(), **halves()}, head)
    found["prompts"]["no prompt"] = lambda: recognised.unprompted(bench, whole())
    found["paired"] |= {
        "instruments": partial(instrument, bench, tools), "truth": lambda: paired.true(bench, tools(), clips)
    }  # fmt: skip
    for k in range(count):
        for kind in (*kinds, recognised.BRIDGE):
            found["prompts"][f"{kind} {k}"] = lambda kind=kind, k=k: recognised.sra(bench, whole(), kind, k)
        for name in paired.CONDITIONS:
            found["paired"][f"{name} {k}"] = lambda name=name, k=k: paired.made(bench, tools(), clips, name, k)
        found["changes"][f"changes {k}"] = partial(guided.changed, bench, k)
        for seam in (None, 0.0) if bench.model.config.parts else ():
            found["halves"][f"{seam} {k}"] = lambda k=k, seam=seam: recognised.halves(bench, halves(), k, seam)
    for k in range(min(count, GUIDED)):
        for style in styles.TRAINING:
            found["guidance"][f"{style} {k}"] = lambda k=k, style=style: guided.scaled(bench, ruler(), style, k)
    return {part: {f"{part}: {name}": job for name, job in of.items()} for part, of in found.items()}


def main() -> None:
    parser = prompted.parser(__doc__)
    parser.add_argument("--only", nargs="+", metavar="PART", help="codes, prompts, paired, guidance, changes, halves")
    parser.add_argument("--ruler", type=Path, default=Path("runs/ruler"), help="where the ruler of factors is kept")
    args = parser.parse_args()
    bench = prompted.tune(args)
    asked = jobs(bench, args)
    if unknown := set(args.only or ()) - set(asked):
        parser.error(f"'{unknown.pop()}' is no part; choose of {', '.join(asked)}")
    path = args.out / f"{checkpoints.digest(bench.model)[:12]}_{args.steps}.jsonl"
    for part in args.only or asked:
        ledger.fill(path, asked[part], part)
    done = ledger.read(path)
    rows = [done[job] for part in asked.values() for job in part if job in done]
    found = findings.summary(rows)
    ledger.tell(findings.tables(found), NAME, args.docs)
    ledger.save(args.out / "diffuclip.json", found)
    findings.draw(args.out / "diffuclip.png", found)


if __name__ == "__main__":
    main()
