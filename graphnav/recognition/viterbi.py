"""A hidden Markov model whose states last at least a given number of steps.

A state entered is kept for `dwell` steps, so that it cannot flicker. Log probabilities throughout.
The steps must loop, but a chain forgets within a minute: long ones are cut into overlapping chunks
that run side by side in one array, and each chunk's middle is kept.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from graphnav.common.run import Array

Steps = NDArray[np.intp]
Kind = TypeVar("Kind", bound=np.generic)

CHUNK, OVERLAP = 400, 200  # steps
SIDE_BY_SIDE = 64  # chunks run together; more would only cost memory


@dataclass(frozen=True)
class Chain:
    """T steps of S states, entered and left as the data and the transition table allow."""

    likelihood: Array  # (T, S) log likelihood of each step's data
    change: Array  # (T, S, S) log probability of i -> j on entering step t; diagonal -inf
    stay: Array  # (S,) log probability of staying one step more
    initial: Array  # (S,) log probability at step 0
    dwell: int  # steps a state lasts at least; the first and the last state are exempt


@dataclass(frozen=True)
class _Batch:
    """K chunks side by side."""

    likelihood: Array  # (L, K, S)
    change: Array  # (L, K, S, S)
    begins: Array  # (K, S) log probability at the first step
    chain: Chain


@dataclass(frozen=True)
class _Chunks:
    """Equally long pieces of a chain that overlap by at least `OVERLAP` steps."""

    steps: int
    first: Steps  # (K,) where each begins
    length: int

    def batches(self, chain: Chain) -> Iterator[_Batch]:
        """Some chunks at a time."""
        begins = np.zeros((len(self.first), len(chain.stay)))  # inside the run any state
        begins[0] = chain.initial
        for k in range(0, len(self.first), SIDE_BY_SIDE):
            some = slice(k, k + SIDE_BY_SIDE)
            at = self.first[None, some] + np.arange(self.length)[:, None]
            yield _Batch(chain.likelihood[at], chain.change[at], begins[some], chain)

    def join(self, y: NDArray[Kind]) -> NDArray[Kind]:
        """(length, K, ...) to (T, ...): every step from the chunk whose middle is nearest."""
        middle = self.first + self.length / 2
        borders = np.ceil((middle[1:] + middle[:-1]) / 2).astype(np.intp)
        owner = np.searchsorted(borders, np.arange(self.steps), side="right")
        return np.asarray(y[np.arange(self.steps) - self.first[owner], owner])


def _chunks(steps: int) -> _Chunks:
    count = max(1, -(-(steps - OVERLAP) // CHUNK))
    length = min(steps, CHUNK + OVERLAP)
    first = np.round(np.linspace(0, steps - length, count)).astype(np.intp)
    return _Chunks(steps, first, length)


def most_probable(chain: Chain) -> Steps:
    """Most probable state of every step as one sequence, (T,). Viterbi 1967.

    Only states that have dwelt long enough are carried from step to step; an entry joins them
    `dwell` steps later with the likelihood of those steps as one sum.
    """
    chunks = _chunks(len(chain.likelihood))
    return chunks.join(np.concatenate([_paths(b) for b in chunks.batches(chain)], axis=1))


def _paths(batch: _Batch) -> Steps:
    """Most probable paths of some chunks, (L, K)."""
    likelihood, change, chain = batch.likelihood, batch.change, batch.chain
    steps, count, states = likelihood.shape
    wait = chain.dwell - 1
    total = np.concatenate([np.zeros((1, count, states)), np.cumsum(likelihood, 0)])
    waited = total[wait + 1 :] - total[: steps - wait]  # of the steps t - wait .. t
    staying = likelihood + chain.stay
    entry = np.full((steps, count, states), -np.inf)
    came_from = np.zeros((steps, count, states), dtype=np.intp)  # best state to have left
    entered = np.zeros((steps, count, states), dtype=np.intp)  # when the dwelt state was entered
    score = batch.begins + likelihood[0]
    for t in range(1, steps):
        options = score[:, :, None] + change[t]
        came_from[t] = options.argmax(axis=1)
        entry[t] = options.max(axis=1)
        score = score + staying[t]
        entered[t] = entered[t - 1]
        since = t - wait
        if since >= 1:
            joined = entry[since] + waited[since]
            better = joined > score
            score = np.where(better, joined, score)
            entered[t][better] = since
    late = entry[steps - wait :] + total[-1] - total[steps - wait : steps]
    paths = [
        _trace_back(score[k], late[:, k], entered[:, k], came_from[:, k]) for k in range(count)
    ]
    return np.stack(paths, 1)


def _trace_back(score: Array, late: Array, entered: Steps, came_from: Steps) -> Steps:
    """Walk back one segment at a time from the best end: dwelt, or entered in the last steps."""
    steps = len(entered)
    path = np.empty(steps, dtype=np.intp)
    state, begin = int(score.argmax()), int(entered[-1, score.argmax()])
    if late.size and late.max() > score.max():
        row, state = (int(k) for k in np.unravel_index(int(late.argmax()), late.shape))
        begin = steps - len(late) + row
    end = steps
    while True:
        path[begin:end] = state
        if begin == 0:
            return path
        state = int(came_from[begin, state])
        end, begin = begin, int(entered[begin - 1, state])


def posterior(chain: Chain) -> Array:
    """Probability of each state at each step given all data, (T, S). Forward-backward.

    Every state is a row of `dwell` cells passed one per step; only the last may be left.
    """
    chunks = _chunks(len(chain.likelihood))
    return chunks.join(np.concatenate([_posteriors(b) for b in chunks.batches(chain)], axis=1))


def _posteriors(batch: _Batch) -> Array:
    """Posteriors of some chunks, (L, K, S)."""
    likelihood, chain = batch.likelihood, batch.chain
    steps, count, states = likelihood.shape
    last = chain.dwell - 1
    evidence = np.exp(likelihood - likelihood.max(axis=2, keepdims=True))[:, :, :, None]
    change, stay = np.exp(batch.change), np.exp(chain.stay)
    past = np.zeros((steps, count, states, chain.dwell))
    past[0, :, :, last] = np.exp(batch.begins) * evidence[0, :, :, 0]
    for t in range(1, steps):
        here, held = past[t], past[t - 1, :, :, last]
        here[:, :, 1:] = past[t - 1, :, :, :last]
        here[:, :, 0] = (held[:, None, :] @ change[t])[:, 0]
        here[:, :, last] += held * stay
        here *= evidence[t]
        here /= here.sum(axis=(1, 2), keepdims=True)
    future = np.ones((steps, count, states, chain.dwell))
    for t in range(steps - 1, 0, -1):
        here, seen = future[t - 1], future[t] * evidence[t]
        here[:, :, :last] = seen[:, :, 1:]
        here[:, :, last] = (change[t] @ seen[:, :, :1])[:, :, 0] + stay * seen[:, :, last]
        here /= here.sum(axis=(1, 2), keepdims=True)
    joint = np.einsum("tksd,tksd->tks", past, future)
    joint /= joint.sum(axis=2, keepdims=True)
    return np.asarray(joint)
