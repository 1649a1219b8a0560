"""What holds for every test, and fixtures that several modules share."""

from pathlib import Path

import hypothesis
import pytest
from streams import prepared, wheeled

from graphnav.graph.preparation import Prepared

# the same examples everywhere, however slow the machine: what fails here fails for all
hypothesis.settings.register_profile("same", deadline=None, derandomize=True)
hypothesis.settings.load_profile("same")


@pytest.fixture(scope="session")
def wheeled_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated car's run of 240 s with fixes, of which the first 90 or so at rest."""
    return wheeled(tmp_path_factory.mktemp("stream"), 240.0)


@pytest.fixture(scope="session")
def prep(wheeled_run: Path) -> Prepared:
    """The same, prepared."""
    return prepared(wheeled_run)
