"""Does the matcher know what it does not know? Sigma and confidence against the truth.

    python test/benchmark/match_trust.py [--four] [--efforts navigation balanced quality] [--waters air hazy] [--learn]

On six small pairs (or the four of Middlebury's first set): pixels with a disparity; of these, those over 1 px wrong;
those over 4 px wrong whose sigma is under 1 px, errors within one sigma; what the confidence says is wrong on the mean;
and the errors of the most certain 80 %. All in percent. `--learn` prints the weights of ``match/planes/confidence.py``
instead, from the six pairs, and the figures of each with the weights of the others. Needs ``../shared/data``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from drowned_pairs import STEREO, THIRDS, WATERS, Truth, drown, pairs
from numpy.typing import NDArray

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes import confidence
from uw_recon_ros.match.planes.matcher import GraphCutResult, graph_cut

CERTAIN = 80  # %
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


def signs(truth: Truth, water: str, effort: str) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """What betrays errors, (N, 6), and the errors, (N,), of a pair's matched pixels."""
    seen: list[NDArray[np.float32]] = []
    real = confidence.signs_of_error

    def kept(*arrays: Any) -> NDArray[np.float32]:
        seen.append(real(*arrays))
        return seen[-1]

    confidence.signs_of_error = kept
    result = graph_cut(*drown(truth, WATERS[water]), 0, truth.max_disparity - 1, effort=effort)
    confidence.signs_of_error = real
    known = truth.mask & np.isfinite(result.disparity)
    return seen[0][known], np.abs(result.disparity - truth.disparity)[known] > confidence.WRONG_PX


def learn(x: Floats, wrong: Floats) -> Floats:
    """Logistic regression by iterated weighted least squares."""
    x = np.column_stack([np.ones(len(x)), x])
    weights = np.zeros(x.shape[1])
    for _ in range(ROUNDS):
        p = 1 / (1 + np.exp(-x @ weights))
        curvature = (x * (p * (1 - p) + 1e-6)[:, None]).T @ x + RIDGE * np.eye(len(weights))
        weights -= np.linalg.solve(curvature, x.T @ (p - wrong) + RIDGE * weights)
    return weights


def learnt(effort: str, waters: list[str]) -> Iterator[str]:
    """The weights from all pairs, and what each pair's errors are with the weights of the others."""
    rng = np.random.default_rng(0)
    seen = {truth.name: [signs(truth, water, effort) for water in waters] for truth in pairs(THIRDS)}

    def from_pairs(names: list[str]) -> Floats:
        parts = [part for name in names for part in seen[name]]
        chosen = [rng.integers(len(wrong), size=SAMPLES) for _, wrong in parts]
        return learn(*(np.concatenate([part[i][c] for part, c in zip(parts, chosen, strict=True)]) for i in (0, 1)))

    yield f"{effort}: {', '.join(f'{w:.2f}' for w in from_pairs(list(seen)))}"
    for name, ((x, wrong), *_) in seen.items():
        weights = from_pairs([other for other in seen if other != name])
        trust = -(x @ weights[1:] + weights[0])
        surest = np.argsort(-trust, kind="stable")[: len(trust) * CERTAIN // 100]
        doubtful = trust < np.log(confidence.DOUBTFUL / (1 - confidence.DOUBTFUL))
        shares = [100 * float(share.mean()) for share in (wrong, wrong[surest], doubtful)]
        yield "  {}: wrong {:.2f} %, of the surest {} % {:.2f} %, doubtful {:.1f} %".format(
            name, shares[0], CERTAIN, *shares[1:]
        )


def table(four: bool, effort: str, water: str) -> Iterator[str]:
    """Markdown, a row a pair, then the means."""
    everything = list(pairs(STEREO if four else THIRDS))
    rows = [
        measure(graph_cut(*drown(t, WATERS[water]), 0, t.max_disparity - 1, effort=effort, threads=2), t)
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
    parser.add_argument("--waters", nargs="+", choices=list(WATERS), default=["air", "hazy"])
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
