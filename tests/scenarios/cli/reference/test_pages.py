"""Each row of a table that rules is on its page of `convoy reference`."""

import re
from dataclasses import fields
from inspect import getdoc
from typing import get_args

import pytest
from click.testing import CliRunner
from pydantic import BaseModel

from scenarios.cli.main import cli
from scenarios.cli.plug_in_page import shipped_texts
from scenarios.cli.scenario_commands import PAGES, printers
from scenarios.cli.scenario_pages import limit_texts
from scenarios.cli.table_keys import models_at, scenario_tables, split_doc, tables_at
from scenarios.definition.channel.presets import presets, read_preset
from scenarios.definition.schema.limit_rows import LIMITS, WORDS
from scenarios.definition.schema.plug_ins.point import parameters_of, signature_of
from scenarios.definition.schema.plug_ins.points import POINTS
from scenarios.definition.schema.settings_table import SettingsTable
from scenarios.results.summary import documented_fields
from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_CODES, EXIT_DONE, EXIT_FAILED
from transport.links.laws.registry import LAWS
from transport.log.foxglove import standard_messages
from transport.topics import REASONS, RUN_SENDER, TOPICS, alive_key, clock_key, control_key, end_key
from vehicles.messages import MODES, Message, Mode


def printed(page: str) -> str:
    result = CliRunner().invoke(cli, ["reference", page], env={"COLUMNS": "80"})
    assert result.exit_code == 0, result.output
    return result.stdout


def words(page: str) -> str:
    return " ".join(printed(page).split())


def sections(page: str) -> dict[str, str]:
    parts = printed(page).split("\n\n")
    return {part.partition("\n")[0]: part.partition("\n")[2] for part in parts}


def rows(table: str) -> list[list[str]]:
    found: list[list[str]] = []
    for line in table.splitlines():
        if line.startswith(" "):
            found[-1][-1] += f" {line.strip()}"
        else:
            found.append(re.split(r" {2,}", line.strip()))
    return found


# ---- The list of pages


def test_without_a_page_all_are_listed() -> None:
    result = CliRunner().invoke(cli, ["reference"])
    assert result.exit_code == 0
    assert [line.split()[0] for line in result.stdout.splitlines()] == list(PAGES)
    assert max(map(len, result.stdout.splitlines())) <= 80
    assert set(printers()) == set(PAGES)


def test_an_unknown_page_is_refused_with_the_pages() -> None:
    result = CliRunner().invoke(cli, ["reference", "laws"])
    assert result.exit_code == 2
    assert all(page in result.stderr for page in PAGES)


@pytest.mark.parametrize("page", [page for page in PAGES if page != ".proto"])
def test_lines_fit_a_terminal(page: str) -> None:
    assert max(map(len, printed(page).splitlines())) <= 80


# ---- Pages about scenarios


def inner_models(key: str) -> set[type[BaseModel]]:
    return {table.model for table in tables_at(key)}


@pytest.mark.parametrize(
    ("page", "key"),
    [("links", "links"), ("gnss", "gnss"), ("degradation", "control.degradation")],
)
def test_every_key_of_every_table_is_on_its_page(page: str, key: str) -> None:
    headings = sections(page)
    assert inner_models(key) >= set(models_at(key))
    for table in tables_at(key):
        assert table.place in headings
        expected = table.model.model_fields.keys() - {"kind"}
        assert not table.keys or table.keys.keys() == expected
    text = words(page)
    for model in inner_models(key):
        for name in model.model_fields.keys() - {"kind"}:
            assert name in text
        if issubclass(model, SettingsTable):
            for one in model.by_key.values():
                assert " ".join(one.setting.doc.split()) in text


def test_every_law_is_on_the_page_of_links() -> None:
    text, models = words("links"), inner_models("links")
    for key, laws in LAWS.items():
        for law in laws:
            if issubclass(law, BaseModel) and law in models:
                kind = law.model_fields.get("kind")
                words_of_kind = get_args(kind.annotation) if kind else ()
                head = f"[links.{key}]" + (f' kind = "{words_of_kind[0]}"' if kind else "")
                assert head in text
    entry = printed("links").partition("[[link]]\n")[2].partition("\n\n")[2]
    assert [row[0] for row in rows(entry)] == ["sender", "receiver"]


def test_every_preset_has_its_source() -> None:
    text = words("presets")
    for name in presets():
        preset = read_preset(name)
        assert name in sections("presets")
        assert " ".join(preset.description.split()) in text
        assert " ".join(preset.source.split()) in text


def test_every_limit_and_its_word_are_printed() -> None:
    found = rows(sections("limits")["bounds in [limits]"])
    assert found == [list(row) for row in limit_texts()]
    assert [key for key, _ in found] == list(LIMITS)
    assert all(f"--limit {word}" in words("limits") for word in WORDS)
    assert {"[limits.modes]", "[limits.sources]", "[limits.recovery]"} <= sections("limits").keys()


@pytest.mark.parametrize("page", ["limits", "topics"])
def test_every_mode_has_its_meaning(page: str) -> None:
    assert rows(sections(page)["modes of a vehicle"]) == [list(row) for row in MODES.items()]
    assert set(MODES) == set(get_args(Mode))


# ---- Pages about messages


def test_topics_are_those_of_the_log() -> None:
    expected = [[name, topic.message.__name__, topic.meaning] for name, topic in TOPICS.items()]
    assert rows(sections("topics")["topics"]) == expected
    standard = [
        [one.name, one.kind.DESCRIPTOR.full_name, f"from {topic.name}"]
        for topic in TOPICS.values()
        for one in standard_messages().get(topic.message, ())
    ]
    assert rows(sections("topics")["Foxglove messages"]) == standard


def test_every_message_has_its_fields() -> None:
    text = words("topics")
    for message in get_args(Message):
        assert f"{message.__name__}: {message.__doc__.split()[0]}" in text
        assert f"fields: {', '.join(one.name for one in fields(message))}" in text


def test_every_topic_and_query_has_its_key() -> None:
    text = words("wire")
    for topic in TOPICS.values():
        assert topic.name in text
        sender = "run" if topic.name in {"start", "end"} else "VEHICLE"
        assert topic.batched or f"RUN/convoy/{sender}/{topic.name}" in text
    assert clock_key(RUN_SENDER) in text
    assert end_key(RUN_SENDER) in text
    assert control_key("VEHICLE") in text
    assert control_key("run") in text
    assert alive_key("ROLE", "NAME", "FINGERPRINT", "SESSION") in text


def test_reasons_are_those_of_links_and_receivers() -> None:
    _, *found = rows(sections("reasons")["reasons"])
    for (word, reason), row in zip(REASONS.items(), found, strict=True):
        counts = ["lost"] * reason.counts_as_loss + ["late"] * reason.counts_as_late
        source = "link" if reason.is_drop else "receiver"
        assert row == [word, source, *counts, reason.meaning]


# ---- Other pages


def test_fields_are_those_of_the_summary() -> None:
    for group, docs in documented_fields().items():
        assert rows(sections("fields")[group]) == [list(row) for row in docs.items()]


def test_the_contract_of_each_plug_in_is_complete() -> None:
    text = words("plug-ins")
    for point in POINTS:
        assert rows(sections("plug-ins")[point.key]) == [list(row) for row in shipped_texts(point)]
        for method in point.results if point.base is None and not point.calls else ():
            assert f"{method}{signature_of(point.contract, method)}: " in text
        for kind in point.types:
            assert f"{kind.__name__}: " in text
            if listed := split_doc(getdoc(kind) or "")[1]:
                assert list(listed) == [one.name for one in fields(kind)]


@pytest.mark.parametrize("name", ["stanley", "acc", "cacc", "ploeg", "flatbed", "consensus"])
def test_the_parameters_of_shipped_controllers_are_those_of_their_settings(name: str) -> None:
    (point,) = (point for point in POINTS if name in point.shipped)
    printed_rows = rows(sections("plug-ins")[f"parameters of {name}"])
    settings = fields(parameters_of(point, point.load(name)).settings)
    assert len(printed_rows) == len(settings)
    for (key, text), one in zip(printed_rows, settings, strict=True):
        assert key.startswith(one.name)
        assert text.endswith(f"default {one.default:g}")


def test_every_exit_code_is_printed() -> None:
    found = rows(sections("exit-codes")["exit codes"])
    assert found == [[str(code), meaning] for code, meaning in EXIT_CODES.items()]
    assert [int(code) for code, _ in found] == [EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT, 130, 143]


def test_every_key_of_a_scenario_is_documented() -> None:
    undocumented = [
        f"{table.place} {key}"
        for table in scenario_tables()
        for key, text in table.keys.items()
        if not text.partition(";")[0].strip() or text.startswith(("text", "table", "0 to"))
        if key not in LIMITS and not table.place.startswith("[link")
    ]
    assert undocumented == []
