"""What holds for every test."""

import hypothesis

# the same examples everywhere, however slow the machine: what fails here fails for all
hypothesis.settings.register_profile("same", deadline=None, derandomize=True)
hypothesis.settings.load_profile("same")
