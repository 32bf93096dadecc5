"""Does the matcher know what it does not know? Sigma and confidence against the truth.

    python test/benchmark/match_trust.py [--four] [--efforts navigation balanced quality] [--waters air hazy] [--learn]

On six small pairs (or the four of Middlebury's first set): pixels with a disparity; of these, those over 1 px wrong;
those over 4 px wrong whose sigma is under 1 px, errors within one sigma; what the confidence says is wrong on the mean;
and the errors of the most certain 80 %. All in percent. `--learn` prints the weights of ``match/planes/confidence.py``
instead, from the six pairs, and the figures of each with the weights of the others: `WRONG` from the waters given (it
is that of air), `FAR` from all waters of ``drowned_pairs.py``; murk and grain are others. Needs ``../shared/data``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from drowned_pairs import STEREO, THIRDS, WATERS, Truth, drown, pairs
from held_out import DROWNED
from numpy.typing import NDArray

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes import confidence, matcher
from uw_recon_ros.match.planes.matcher import GraphCutResult, graph_cut

CERTAIN = 80  # %
FAR_AND_SURE = 0.001  #: share of all pixels that `FAR` may leave over 4 px wrong with a sigma under 1
TOLD = ("wrong", f"of the surest {CERTAIN} %", "doubtful", "far and sure all the same")
ALL_WATERS = {**WATERS, **DROWNED}
SAMPLES, ROUNDS, RIDGE = 8000, 12, 1e-2
Floats = NDArray[np.floating[Any]]


def measure(result: GraphCutResult, truth: Truth) -> list[float]:
    """See the head of the file."""
    known = truth.mask & np.isfinite(result.disparity)
    error = np.abs(result.disparity - truth.disparity)[known]
    sigma, trust = result.sigma[known], result.confidence[known]
    surest = np.argsort(-trust, kind="stable")[: len(trust) * CERTAIN // 100]
    sure = (error > 4) & (sigma < 1)
    shares = ((error > 1), sure, error <= sigma, 1 - trust, (error > 1)[surest])
    return [100 * float(x) for x in (known.sum() / truth.mask.sum(), *(np.mean(share) for share in shares))]


class Seen(NamedTuple):
    """A pair's matched pixels: what betrays errors, (N, 8), errors and sigma without regard to that, px, (N,)."""

    signs: Floats
    error: Floats
    sigma: Floats


def look(truth: Truth, water: str, effort: str) -> Seen:
    """Match a pair and keep some of its pixels."""
    kept: list[confidence.Signs] = []
    real = matcher.signs_of_error

    def keep(*arrays: Any) -> confidence.Signs:
        kept.append(real(*arrays))
        return kept[-1]

    with (
        patch.object(matcher, "signs_of_error", keep),
        patch.object(matcher, "doubtful", lambda signs, _: np.zeros(signs.step.shape, np.bool_)),
    ):
        result = graph_cut(*drown(truth, ALL_WATERS[water]), 0, truth.max_disparity - 1, effort=effort)
    known = np.flatnonzero(truth.mask & np.isfinite(result.disparity))
    known = np.random.default_rng(0).choice(known, SAMPLES)
    columns = [np.broadcast_to(sign, truth.mask.shape).ravel()[known] for sign in kept[0]]
    error = np.abs(result.disparity - truth.disparity).ravel()[known]
    return Seen(np.column_stack(columns), error, result.sigma.ravel()[known])


def learn(x: Floats, wrong: Floats) -> Floats:
    """Logistic regression by iterated weighted least squares."""
    x = np.column_stack([np.ones(len(x)), x])
    weights = np.zeros(x.shape[1])
    for _ in range(ROUNDS):
        p = 1 / (1 + np.exp(-x @ weights))
        curvature = (x * (p * (1 - p) + 1e-6)[:, None]).T @ x + RIDGE * np.eye(len(weights))
        weights -= np.linalg.solve(curvature, x.T @ (p - wrong) + RIDGE * weights)
    return weights


def joined(parts: list[Seen]) -> Seen:
    """As of one pair."""
    return Seen(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def far_weights(seen: Seen) -> Floats:
    """Of errors over `confidence.FAR_PX`, so that more than 0 is doubtful."""
    weights = learn(seen.signs, seen.error > confidence.FAR_PX)
    odds = seen.signs @ weights[1:] + weights[0]
    order = np.argsort(odds)
    left = np.cumsum((_far_and_sure(seen))[order]) / len(order)
    weights[0] -= odds[order][np.searchsorted(left, FAR_AND_SURE)]
    return weights


def _far_and_sure(seen: Seen) -> NDArray[np.bool_]:
    return (seen.error > confidence.FAR_PX) & (seen.sigma < 1)


def learnt(effort: str, waters: list[str]) -> Iterator[str]:
    """The weights from all pairs, and what each pair's errors are with the weights of the others."""
    seen = {t.name: {w: look(t, w, effort) for w in {*WATERS, *waters}} for t in pairs(THIRDS)}
    names = list(seen)

    def wrong_of(some: list[str]) -> Floats:
        parts = joined([seen[name][water] for name in some for water in waters])
        return learn(parts.signs[:, :-2], parts.error > confidence.WRONG_PX)

    def far_of(some: list[str]) -> Floats:
        return far_weights(joined([seen[name][water] for name in some for water in WATERS]))

    for title, weights in (("WRONG", wrong_of(names)), ("FAR", far_of(names))):
        yield f"{effort}: {title} {', '.join(f'{w:.2f}' for w in weights)}"
    for name in names:
        others = [other for other in names if other != name]
        wrong, far = wrong_of(others), far_of(others)
        for water in waters:
            one = seen[name][water]
            surest = np.argsort(one.signs[:, :-2] @ wrong[1:], kind="stable")[: len(one.error) * CERTAIN // 100]
            doubtful = one.signs @ far[1:] + far[0] > 0
            told = [(one.error > 1).mean(), (one.error > 1)[surest].mean(), doubtful.mean()]
            told.append((_far_and_sure(one) & ~doubtful).mean())
            shares = ", ".join(f"{title} {100 * share:.2f} %" for title, share in zip(TOLD, told, strict=True))
            yield f"  {name}, {water}: {shares}"


def table(four: bool, effort: str, water: str) -> Iterator[str]:
    """Markdown, a row a pair, then the means."""
    everything = list(pairs(STEREO if four else THIRDS))
    rows = [
        measure(graph_cut(*drown(t, ALL_WATERS[water]), 0, t.max_disparity - 1, effort=effort, threads=2), t)
        for t in everything
    ]
    for name, row in zip([*(t.name for t in everything), "mean"], [*rows, np.mean(rows, axis=0)], strict=True):
        density, bad, sure, within, told, surest = row
        yield (
            f"| {name} | {water} | {effort} | {density:.1f} | {bad:.2f} | {sure:.2f} | {within:.0f} | {told:.2f} |"
            f" {surest:.2f} |"
        )


def main() -> int:
    """Print the table, or the weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--four", action="store_true")
    parser.add_argument("--efforts", nargs="+", choices=EFFORTS, default=list(EFFORTS))
    parser.add_argument("--waters", nargs="+", choices=list(ALL_WATERS), default=["air", "hazy"])
    parser.add_argument("--learn", action="store_true")
    args = parser.parse_args()
    if args.learn:
        lines = (line for effort in args.efforts for line in learnt(effort, args.waters))
    else:
        sys.stdout.write(
            "| pair | water | effort | density | bad-1 | over 4 px, sigma under 1 | within sigma | said to be wrong |"
            f" bad-1 of the surest {CERTAIN} % |\n" + "|" + " --- |" * 9 + "\n"
        )
        lines = (x for water in args.waters for effort in args.efforts for x in table(args.four, effort, water))
    for line in lines:
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
