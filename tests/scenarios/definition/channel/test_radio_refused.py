"""Radios that cannot be: one clear line each, with file, key, what was given, what is allowed."""

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import scenario_from_text
from tests.made.scenarios.messages import STRAIGHT

TABLE = '[links.radio]\nkind = "table"\ndistance_m = [0.0, 100.0]\ndelivery_ratio = [0.9, 0.1]\n'
LOSS = '[links.radio]\nkind = "path_loss"\n'
REFUSED = {
    "unknown kind": (
        '[links.radio]\nkind = "5g"\n', "radio.kind", '"5g"', '"table" or "path_loss"',
    ),
    "no kind": ("[links.radio]\npower_dbm = 3.0\n", "radio.kind", "missing", '"table"'),
    "no distances": ('[links.radio]\nkind = "table"\n', "radio.distance_m", "missing", ""),
    "empty table": (
        '[links.radio]\nkind = "table"\ndistance_m = []\ndelivery_ratio = []\n',
        "radio.distance_m", "given []", "at least one entry",
    ),
    "per cent": (
        TABLE.replace("0.9", "90.0"), "radio.delivery_ratio[0]", "given 90.0", "0 to 1",
    ),
    "negative distance": (
        TABLE.replace("0.0, 100.0", "-1.0, 100.0"), "radio.distance_m[0]", "-1.0", "at least 0",
    ),
    "unequal lists": (
        TABLE.replace("0.9, 0.1", "0.9"), "radio.delivery_ratio", "given 1 numbers", "allowed 2",
    ),
    "distances out of order": (
        TABLE.replace("0.0, 100.0", "100.0, 100.0"), "radio.distance_m[1]", "100.0",
        "more than 100.0",
    ),
    "unknown burst": (TABLE + 'burst = "long"\n', "radio.burst", '"long"', '"reservation"'),
    "reservations the wrong way round": (
        TABLE + "reselection_messages_min = 20\n", "radio.reselection_messages_max", "given 15",
        "at least reselection_messages_min, 20",
    ),
    "kept for ever": (TABLE + "keep_ratio = 1.0\n", "radio.keep_ratio", "given 1.0", "0 to 0.99"),
    "key of the other kind": (TABLE + "power_dbm = 3.0\n", "radio.power_dbm", "unknown key", ""),
    "frequency in GHz": (LOSS + "frequency_hz = 5.9\n", "radio.frequency_hz", "5.9", "100000000"),
    "power without unit": (LOSS + "power = 3.0\n", "radio.power", "unknown", "radio.power_dbm?"),
    "no error": (
        LOSS + "[links.radio.errors]\nerror_ratio = [0.5, 0.1, 0.0]\n",
        "radio.errors.error_ratio[2]", "given 0.0", "more than 0, less than 1",
    ),
    "a curve of one point": (
        LOSS + "[links.radio.errors]\nsnr_db = [1.0]\n", "radio.errors.snr_db", "[1.0]", "at least",
    ),
    "errors that grow": (
        LOSS + "[links.radio.errors]\nobstructed_error_ratio = [0.1, 0.5, 0.6]\n",
        "radio.errors.obstructed_error_ratio[1]", "given 0.5", "less than 0.1",
    ),
    "no decorrelation": (
        LOSS + "[links.radio.shadowing]\ndecorrelation_m = 0.0\n",
        "radio.shadowing.decorrelation_m", "given 0.0", "1 to 10000",
    ),
    "negative deviation": (
        LOSS + "[links.radio.shadowing]\ndeviation_db = -3.0\n",
        "radio.shadowing.deviation_db", "given -3.0", "0 to 60",
    ),
    "unknown obstruction": (
        LOSS + '[links.radio.obstruction]\nkind = "itu"\n',
        "radio.obstruction.kind", '"itu"', '"etsi" or "3gpp"',
    ),
    "obstruction that helps": (
        LOSS + '[links.radio.obstruction]\nkind = "etsi"\nloss_db = -6.9\n',
        "radio.obstruction.loss_db", "given -6.9", "0.1 to 100",
    ),
    "key of the other obstruction": (
        LOSS + '[links.radio.obstruction]\nkind = "etsi"\nmean_db = 6.9\n',
        "radio.obstruction.mean_db", "unknown key", "",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "key", "given", "allowed"), REFUSED.values(), ids=REFUSED)
@pytest.mark.parametrize("entry", [False, True])
def test_a_radio_that_cannot_be_is_refused_in_one_line(
    text: str, key: str, given: str, allowed: str, entry: bool
) -> None:
    """Both for the convoy and for one link."""
    if entry:
        own = '[[link]]\nsender = "v1"\nreceiver = "*"\n'
        text = own + text.replace("[links.", "[link.")
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(f"{STRAIGHT}\n{text}", label="a.toml")
    line = next(one for one in caught.value.lines if key in one)
    assert line.startswith(f"a.toml: {'link[0]' if entry else 'links'}.{key}: ")
    assert given in line
    assert allowed in line
    assert "\n" not in line
    assert len(line) < 250
