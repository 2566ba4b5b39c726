import pytest

from transport.picture.option import RerunOption, parse_rerun_option
from transport.picture.viewer_process import ViewerError


@pytest.mark.parametrize(
    ("text", "option"),
    [
        ("off", RerunOption("off")),
        ("spawn", RerunOption("spawn")),
        ("serve", RerunOption("serve")),
        ("serve=9099", RerunOption("serve", page_port=9099)),
        ("serve=9099:9877", RerunOption("serve", page_port=9099, data_port=9877)),
        ("serve=0.0.0.0", RerunOption("serve", address="0.0.0.0")),
        ("serve=0.0.0.0:9090:9876", RerunOption("serve", "", "0.0.0.0", 9090, 9876)),
        (
            "connect=rerun+http://box:9876/proxy",
            RerunOption("connect", "rerun+http://box:9876/proxy"),
        ),
        ("save=a=b.rrd", RerunOption("save", "a=b.rrd")),
    ],
)
def test_options_are_read(text: str, option: RerunOption) -> None:
    assert parse_rerun_option(text) == option


@pytest.mark.parametrize(
    "text",
    ["", "on", "off=1", "spawn=x", "save", "save=", "connect", "connect=box:9876", "serve=",
     "serve=a.b", "serve=99999", "serve=1:2:3", "serve=0.0.0.0:", "serve=:9090"],
)  # fmt: skip
def test_other_options_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(ViewerError, match=r"^--rerun ") as refused:
        parse_rerun_option(text)
    assert "\n" not in str(refused.value)
