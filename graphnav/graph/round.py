"""One round of the solution: what all its factors are made from."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from factors.block import Block
from factors.estimate import Estimate
from factors.preintegration import Preintegrated
from graphnav.graph.nodes import Nodes
from graphnav.graph.noise import Parts, Scales, States
from graphnav.graph.preparation import Prepared

Factor = Callable[[Estimate], list[Block]]


@dataclass(frozen=True)
class Round:
    """What all factors of the running gear are made from, in one round of the solution."""

    prep: Prepared
    nodes: Nodes
    pre: Preintegrated
    state: States  # (N - 1,) motion state of each interval
    at: Estimate
    scales: Scales


def with_noise(noise: Parts, linearise: Callable[[Estimate], Block]) -> Factor:
    """A factor whose errors last: its block carries how much its sigma exceeds their spread."""
    return lambda x: [replace(linearise(x), inflation=noise.inflation)]
