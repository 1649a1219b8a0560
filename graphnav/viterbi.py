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
    """Most probable state of every step as one sequence, (T,). Viterbi 1967."""
    steps, states = chain.likelihood.shape
    last = chain.dwell - 1
    score = np.full((states, chain.dwell), -np.inf)
    score[:, last] = chain.initial + chain.likelihood[0]
    came_from = np.zeros((steps, states), dtype=np.intp)  # best state to have left
    entered = np.zeros((steps, states), dtype=np.intp)  # step at which the dwelt state was entered
    fresh = np.zeros((states, chain.dwell), dtype=np.intp)
    every = np.arange(states)
    for t in range(1, steps):
        options = score[:, last, None] + chain.change[t]
        came_from[t] = options.argmax(axis=0)
        enter, stay = options[came_from[t], every], score[:, last] + chain.stay
        started = fresh[:, last].copy()
        score[:, 1:], fresh[:, 1:] = score[:, :last], fresh[:, :last]  # numpy minds the overlap
        score[:, 0], fresh[:, 0] = enter, t
        longer = stay >= score[:, last]
        score[:, last] = np.where(longer, stay, score[:, last])
        fresh[:, last] = np.where(longer, started, fresh[:, last])
        score += chain.likelihood[t][:, None]
        entered[t] = fresh[:, last]
    return _trace_back(score, fresh, entered, came_from)


def _trace_back(
    score: Array,
    fresh: NDArray[np.intp],
    entered: NDArray[np.intp],
    came_from: NDArray[np.intp],
) -> NDArray[np.intp]:
    """Walk from the best final cell back, one segment at a time."""
    path = np.empty(len(entered), dtype=np.intp)
    state, cell = np.unravel_index(int(score.argmax()), score.shape)
    end, begin = len(path), int(fresh[state, cell])
    while True:
        path[begin:end] = state
        if begin == 0:
            return path
        state = came_from[begin, state]
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
