"""A hidden Markov model whose states last at least a given number of steps.

Every state is a row of `dwell` cells passed one per step; only the last cell may be left, so that
a state cannot flicker. Log probabilities throughout; steps loop, states are vectorised.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graphnav.run import Array


@dataclass(frozen=True)
class Chain:
    """T steps of S states, entered and left as the data and the transition table allow."""

    likelihood: Array  # (T, S) log likelihood of each step's data
    change: Array  # (T, S, S) log probability of i -> j on entering step t; diagonal -inf
    stay: Array  # (S,) log probability of staying one step more
    initial: Array  # (S,) log probability at step 0
    dwell: int  # steps a state lasts at least; the first and the last state are exempt


def most_probable(chain: Chain) -> NDArray[np.intp]:
    """Most probable state of every step as one sequence, (T,). Viterbi 1967.

    Only states that have dwelt long enough are carried from step to step; an entry joins them
    `dwell` steps later with the likelihood of those steps as one sum.
    """
    steps, states = chain.likelihood.shape
    wait = chain.dwell - 1
    total = np.concatenate([np.zeros((1, states)), np.cumsum(chain.likelihood, 0)])
    waited = total[wait + 1 :] - total[: steps - wait]  # of the steps t - wait .. t
    staying = chain.likelihood + chain.stay
    entry = np.full((steps, states), -np.inf)
    came_from = np.zeros((steps, states), dtype=np.intp)  # best state to have left
    entered = np.zeros((steps, states), dtype=np.intp)  # step at which the dwelt state was entered
    score = chain.initial + chain.likelihood[0]
    every = np.arange(states)
    for t in range(1, steps):
        options = score[:, None] + chain.change[t]
        best = options.argmax(axis=0)
        came_from[t], entry[t] = best, options[best, every]
        score = score + staying[t]
        since = t - wait
        if since < 1:
            entered[t] = entered[t - 1]
            continue
        joined = entry[since] + waited[since]
        better = joined > score
        score = np.where(better, joined, score)
        entered[t] = np.where(better, since, entered[t - 1])
    return _trace_back(score, entry, total, entered, came_from, wait)


def _trace_back(
    score: Array,
    entry: Array,
    total: Array,
    entered: NDArray[np.intp],
    came_from: NDArray[np.intp],
    wait: int,
) -> NDArray[np.intp]:
    """Walk back one segment at a time from the best end: dwelt, or entered in the last steps."""
    steps = len(entered)
    path = np.empty(steps, dtype=np.intp)
    state, begin = int(score.argmax()), int(entered[-1, score.argmax()])
    late = entry[steps - wait :] + total[-1] - total[steps - wait : steps]
    if wait and late.max() > score.max():
        row, state = (int(k) for k in np.unravel_index(int(late.argmax()), late.shape))
        begin = steps - wait + row
    end = steps
    while True:
        path[begin:end] = state
        if begin == 0:
            return path
        state = int(came_from[begin, state])
        end, begin = begin, int(entered[begin - 1, state])


def posterior(chain: Chain) -> Array:
    """Probability of each state at each step given all data, (T, S). Forward-backward."""
    steps, states = chain.likelihood.shape
    last = chain.dwell - 1
    evidence = np.exp(chain.likelihood - chain.likelihood.max(axis=1, keepdims=True))[:, :, None]
    change, stay = np.exp(chain.change), np.exp(chain.stay)
    past = np.zeros((steps, states, chain.dwell))
    past[0, :, last] = np.exp(chain.initial) * evidence[0, :, 0]
    for t in range(1, steps):
        here, held = past[t], past[t - 1, :, last]
        here[:, 1:] = past[t - 1, :, :last]
        here[:, 0] = held @ change[t]
        here[:, last] += held * stay
        here *= evidence[t] / np.add.reduce(here, axis=None)
    future = np.ones((steps, states, chain.dwell))
    for t in range(steps - 1, 0, -1):
        here, seen = future[t - 1], future[t] * evidence[t]
        here[:, :last] = seen[:, 1:]
        here[:, last] = change[t] @ seen[:, 0] + stay * seen[:, last]
        here /= np.add.reduce(here, axis=None)
    joint: Array = np.einsum("tsd,tsd->ts", past, future)
    joint /= joint.sum(axis=1, keepdims=True)
    return joint
