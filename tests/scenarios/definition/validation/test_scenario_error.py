import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from scenarios.definition.errors import ScenarioError, SettingError
from scenarios.definition.scenario import load_scenario


@pytest.mark.parametrize("lines", [[], ["one"], ["first: no", "second: nor that"]])
def test_a_refusal_is_the_same_after_pickling(lines: list[str]) -> None:
    error = ScenarioError(iter(lines))
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is ScenarioError
    assert again.lines == error.lines == tuple(lines)
    assert str(again) == str(error) == "\n".join(lines)
    one = pickle.loads(pickle.dumps(SettingError("path.file", "has not been read")))
    assert (one.key, one.why) == ("path.file", "has not been read")
    assert str(one) == "path.file: has not been read"


def test_a_worker_s_refusal_comes_in_the_lines_it_was_written_in() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        done = pool.submit(load_scenario, "lane_change", ["seed=-1", "duration_s=0"])
        with pytest.raises(ScenarioError) as caught:
            done.result()
    assert len(caught.value.lines) == 2
    assert str(caught.value).splitlines() == list(caught.value.lines)
