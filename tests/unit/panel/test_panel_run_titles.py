import pytest

from torquebench.campaign.reducers.catalogue import PARTS
from torquebench.panel.pages.records.run import run_title
from torquebench.panel.text import Text


@pytest.mark.parametrize("test", PARTS, ids=lambda test: test.name)
def test_a_reducer_test_is_named_by_its_catalogue(test):
    assert run_title(Text("en"), f"test-{test.name}") == test.title
    assert run_title(Text("en"), f"test-{test.name}-short") == f"{test.title}, short test"
    chinese = run_title(Text("zh"), f"test-{test.name}")
    assert chinese.isascii() is False
    assert run_title(Text("zh"), f"test-{test.name}-short") == f"{chinese}，简短试验"


def test_other_runs_are_named_by_the_panel():
    assert run_title(Text("en"), "zero") == "Zeroing"
    assert run_title(Text("en"), "something") == "something"
