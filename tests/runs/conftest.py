"""Makes changed_task importable: pytest's importlib mode adds no folder to the path."""

import sys
from pathlib import Path

import pytest

from omniservo.reporting.path_3d import path_3d
from omniservo.reporting.views import outside, views
from omniservo.reporting.write_figures import drawings

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="module", autouse=True)
def few_figures():
    """Reports have three figures: no claim here is of the others, and all of them take as long as a run.

    Every figure of a run is drawn in tests/reporting, and in a job's report in tests/cli/test_run.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(drawings.__globals__, "_FIGURES", (views, outside, path_3d))
        yield
