"""Reference pages about summaries and exit codes."""

from scenarios.cli.reference.printing import print_section, print_text
from scenarios.results.summary import documented_fields
from scenarios.runs.stop import EXIT_CODES


def fields_page() -> None:
    print_text(
        "Fields of summary.json and of `convoy report --json`. A field is null where nothing was "
        "measured."
    )
    for group, docs in documented_fields().items():
        print_section(group, docs.items())


def exit_codes_page() -> None:
    print_text("Exit codes of all commands.")
    print_section("exit codes", [(str(code), meaning) for code, meaning in EXIT_CODES.items()])
