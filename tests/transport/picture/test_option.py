from pathlib import Path

import pytest

from tests.made.transport.recording import scene_of
from transport.picture.option import RerunOption, parse_rerun_option, refuse_foreign_file
from transport.picture.view import RerunView
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
    with pytest.raises(ViewerError, match=r"^--") as refused:
        parse_rerun_option(text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"seed = 1\n"])
def test_other_files_are_not_overwritten(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "precious"
    path.write_bytes(content)
    with pytest.raises(ViewerError, match=r"precious: exists and is no recording of Rerun"):
        refuse_foreign_file(parse_rerun_option(f"save={path}"))
    with (
        pytest.raises(ViewerError),
        RerunView(RerunOption("save", str(path)), recording_id="", scene=scene_of(("v1",))),
    ):
        pass
    assert path.read_bytes() == content


def test_a_recording_of_rerun_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    for _ in range(2):
        refuse_foreign_file(RerunOption("save", str(path)))
        with RerunView(RerunOption("save", str(path)), recording_id="x", scene=scene_of(("v1",))):
            pass
        assert path.stat().st_size
