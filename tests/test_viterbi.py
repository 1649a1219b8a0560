"""The dwelling hidden Markov model against enumeration of every sequence."""

from itertools import groupby, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graphnav.common.run import Array
from graphnav.recognition.viterbi import Chain, most_probable, posterior

STEPS, STATES = 6, 3


def random_chain(seed: int, dwell: int) -> Chain:
    rng = np.random.default_rng(seed)
    change = np.log(rng.uniform(0.05, 0.5, (STEPS, STATES, STATES)))
    change[:, np.arange(STATES), np.arange(STATES)] = -np.inf
    return Chain(
        likelihood=rng.normal(0, 2, (STEPS, STATES)),
        change=change,
        stay=np.log(rng.uniform(0.3, 0.9, STATES)),
        initial=np.log(rng.dirichlet(np.ones(STATES))),
        dwell=dwell,
    )


def log_probability(chain: Chain, path: tuple[int, ...]) -> float:
    """Written from the definition: staying is free until the dwell is over."""
    lengths = [len(list(group)) for _, group in groupby(path)]
    if any(length < chain.dwell for length in lengths[1:-1]):
        return -np.inf
    value = chain.initial[path[0]] + chain.likelihood[0, path[0]]
    age = chain.dwell  # the run begins in a state already dwelt in
    for t in range(1, STEPS):
        i, j = path[t - 1], path[t]
        if i != j:
            value, age = value + chain.change[t, i, j], 1
        elif age >= chain.dwell:
            value += chain.stay[i]
        else:
            age += 1
        value += chain.likelihood[t, j]
    return float(value)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), dwell=st.integers(1, 3))
def test_agrees_with_enumeration(seed: int, dwell: int) -> None:
    chain = random_chain(seed, dwell)
    paths = list(product(range(STATES), repeat=STEPS))
    values = np.array([log_probability(chain, path) for path in paths])
    assert tuple(most_probable(chain)) == paths[int(values.argmax())]
    weight = np.exp(values - values.max())
    weight /= weight.sum()
    marginal: Array = np.zeros((STEPS, STATES))
    for path, share in zip(paths, weight, strict=True):
        marginal[np.arange(STEPS), list(path)] += share
    assert posterior(chain) == pytest.approx(marginal, abs=1e-9)


def test_a_glitch_shorter_than_the_dwell_is_passed_over() -> None:
    likelihood = np.zeros((20, 2))
    likelihood[8:10] = [-50.0, 0.0]
    likelihood[[*range(8), *range(10, 20)]] = [0.0, -50.0]
    change = np.full((20, 2, 2), np.log(0.1))
    change[:, [0, 1], [0, 1]] = -np.inf
    chain = Chain(likelihood, change, np.log([0.9, 0.9]), np.log([0.5, 0.5]), dwell=6)
    assert not most_probable(chain).any()
