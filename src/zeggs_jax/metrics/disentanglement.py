"""How factors of style lie in the numbers of an embedding: DCI (Eastwood & Williams 2018), SAP (Kumar et al. 2018).

Each factor is predicted from the embedding's numbers ("codes") by a lasso regression; the sizes of its weights, as
shares of what is explained, say how important each code is to each factor. Codes and factors are standardised first,
so units do not count. Traps: the regression is linear, so what an embedding says in a curved way counts as not said;
factors that go together in the clips are told through each other, so draw them independently; and codes of few factors
are no better a space to mix styles in: a turned embedding says the same and scores low.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

PENALTIES = np.geomspace(1.0, 1e-3, 13)  # of the lasso, on standardised codes and factors; 1 and more leave no weight
FOLDS = 5
SWEEPS, TOLERANCE = 300, 1e-6  # of the coordinate descent


class Disentanglement(NamedTuple):
    """Scores between 0 and 1, and what they are made of."""

    disentanglement: float  # each code is important to one factor alone
    completeness: float  # each factor needs one code alone
    informativeness: float  # mean share of the factors' variance that the codes explain on clips left out
    sap: float  # mean gap of explained variance between a factor's best code and its second
    explained: Float[np.ndarray, " F"]  # the share for each factor; 0 where the mean would have done better
    importance: Float[np.ndarray, "Z F"]  # absolute weights of the lasso, a factor's summing to what is explained of it


def score(codes: Float[np.ndarray, "N Z"], factors: Float[np.ndarray, "K F"]) -> Disentanglement:
    """DCI and SAP of the embeddings of N = K clips with known factors.

    Raises:
        ValueError: numbers of clips that differ or are below 20, fewer than two codes or factors, a factor that does
            not vary, or numbers that are not finite.
    """
    codes, factors = np.asarray(codes, np.float64), np.asarray(factors, np.float64)
    _check(codes, factors)
    codes, factors = _standard(codes, codes), _standard(factors, factors)
    errors = np.stack([_left_out(codes, factors, fold) for fold in range(FOLDS)])  # [folds, penalties, F]
    mean, apart = errors.mean(0), errors.std(0, ddof=1) / np.sqrt(FOLDS)
    best = mean.argmin(0)
    columns = np.arange(factors.shape[1])
    enough = mean <= (mean + apart)[best, columns]  # the sparsest regression that is as good within one standard error
    explained = np.clip(1.0 - mean[best, columns], 0.0, 1.0)
    importance = np.abs(lasso(codes, factors, PENALTIES[enough.argmax(0)]))
    importance *= explained / np.maximum(importance.sum(0), 1e-12)  # codes that repeat each other get huge ones
    return Disentanglement(
        disentangled(importance), disentangled(importance.T, equally=True), float(explained.mean()),
        gap(codes, factors), explained, importance,
    )  # fmt: skip


def disentangled(importance: Float[np.ndarray, "Z F"], equally: bool = False) -> float:
    """Mean over rows of 1 - entropy (base F) of a row's shares, by the rows' sums or `equally`; 0 for rows of zeros."""
    sums = importance.sum(1)
    shares = importance / np.where(sums > 0, sums, 1.0)[:, None]
    entropy = -(shares * np.log(np.where(shares > 0, shares, 1.0))).sum(1) / np.log(importance.shape[1])
    each = np.where(sums > 0, 1.0 - entropy, 0.0)
    if equally or sums.sum() == 0:
        return float(each.mean())
    return float((each * sums).sum() / sums.sum())


def gap(codes: Float[np.ndarray, "N Z"], factors: Float[np.ndarray, "K F"]) -> float:
    """SAP: how much better than every other the best single code explains a factor, the mean over factors."""
    explained = (_standard(codes, codes).T @ _standard(factors, factors) / len(codes)) ** 2
    first, second = np.sort(explained, axis=0)[::-1][:2]
    return float((first - second).mean())


def lasso(
    codes: Float[np.ndarray, "N Z"], factors: Float[np.ndarray, "K F"], penalty: float | Float[np.ndarray, " F"]
) -> Float[np.ndarray, "Z F"]:
    """Weights w that make |y - x w|^2 / 2 N + penalty |w|_1 smallest, by coordinate descent; x, y have mean 0."""
    square, aim = codes.T @ codes / len(codes), codes.T @ factors / len(codes)
    weights = np.zeros_like(aim)
    for _ in range(SWEEPS):
        before = weights.copy()
        for code, own in enumerate(np.diag(square)):
            if own > 0:
                pull = aim[code] - square[code] @ weights + own * weights[code]
                weights[code] = np.sign(pull) * np.maximum(np.abs(pull) - penalty, 0.0) / own
        if np.abs(weights - before).max() < TOLERANCE:
            break
    return weights


def own_share(influence: Float[np.ndarray, "P P"]) -> float:
    """Share of the diagonal in what changed: influence[p, q] is how much part q of a body changed through slice p.

    1: every slice moves its part alone. 1 / P: a slice moves its part as much as any other.

    Raises:
        ValueError: a number below 0, or nothing changed at all.
    """
    if not (influence >= 0).all() or influence.sum() <= 0:
        raise ValueError(
            f"the influence of slices on parts goes from {influence.min():g} to {influence.max():g}; give numbers that "
            "are at least 0, and not all 0."
        )
    return float(np.trace(influence) / influence.sum())


def _left_out(codes: np.ndarray, factors: np.ndarray, fold: int) -> Float[np.ndarray, "L F"]:
    """Mean squared errors on every FOLDS-th clip of regressions made without it, as shares of the factors' variance."""
    out = np.arange(len(codes)) % FOLDS == fold
    seen, known = _standard(codes[~out], codes[~out]), factors[~out] - factors[~out].mean(0)
    asked = _standard(codes[out], codes[~out])
    made = [asked @ lasso(seen, known, penalty) + factors[~out].mean(0) for penalty in PENALTIES]
    return np.stack([((m - factors[out]) ** 2).mean(0) for m in made])


def _standard(x: np.ndarray, like: np.ndarray) -> np.ndarray:
    """`x` in deviations of `like`'s columns from their mean; columns without spread become 0."""
    spread = like.std(0)
    moves = spread > 1e-9 * (np.abs(like).max(0) + 1e-300)
    return np.where(moves, (x - like.mean(0)) / np.where(moves, spread, 1.0), 0.0)


def _check(codes: np.ndarray, factors: np.ndarray) -> None:
    if len(codes) != len(factors) or len(codes) < 20 or min(codes.shape[1], factors.shape[1]) < 2:
        raise ValueError(
            f"got {len(codes)} embeddings of {codes.shape[1]} numbers and {len(factors)} rows of {factors.shape[1]} "
            "factors; give 20 clips or more, one row each, with two numbers and two factors or more."
        )
    if not (np.isfinite(codes).all() and np.isfinite(factors).all()):
        raise ValueError("embeddings or factors hold numbers that are not finite; leave those clips out.")
    still = np.flatnonzero(~_standard(factors, factors).any(0))
    if len(still):
        raise ValueError(f"factor {still[0]} is the same in all {len(factors)} clips; give clips in which it varies.")
