"""A sweep carried out: what is left of its runs, then its tables and pictures."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from scenarios.definition.errors import ScenarioError
from scenarios.studies.many.engine.countdown import Countdown
from scenarios.studies.many.engine.driver import JobDriver, Outcome
from scenarios.studies.many.engine.fleet import Fleet
from scenarios.studies.many.engine.journal import JOURNAL, Entry, RunJournal, open_journal
from scenarios.studies.many.sweeps.files import CELLS, PARQUET, RUNS, TWIN, write_tables
from scenarios.studies.many.sweeps.plan import SweepPlan
from scenarios.studies.many.sweeps.table import SweepTable, table_of

HEAT_MAP, SEEDS = "sweep.png", "seeds.png"
GIVEN_UP = "given_up"
"""Of an entry whose worker died: the fault may be the machine's, so the run is tried again."""


def carry_out_sweep(
    plan: SweepPlan,
    out: Path,
    fleet: Callable[[], AbstractContextManager[Fleet]],
    say: Callable[[str], None],
    *,
    parquet: bool = False,
    pictures: bool = True,
) -> tuple[SweepTable, list[Path]]:
    """Do all runs that the journal in `out` does not have yet; the table, and the files written.

    `fleet` is asked for if there is something to do. Killed at any instant and called again, it
    goes on and ends with the same bytes in all tables. Raises ScenarioError if the folder holds
    something else.
    """
    _refuse_used(out)
    with open_journal(out, plan.asked()) as journal:
        _complete(plan, journal, fleet, say)
        table = table_of(plan, journal.entries)
        written = write_tables(table, out, parquet=parquet)
        return table, [*written, *(_draw(table, out, say) if pictures else ())]


def _draw(table: SweepTable, out: Path, say: Callable[[str], None]) -> list[Path]:
    """Draw what can be drawn; the files."""
    from scenarios.studies.many.sweeps.pictures import draw_seeds, draw_sweep  # noqa: PLC0415

    draw_seeds(table, out / SEEDS)
    if why_not := draw_sweep(table, out / HEAT_MAP):
        say(why_not)
        return [out / SEEDS]
    return [out / HEAT_MAP, out / SEEDS]


def _refuse_used(out: Path) -> None:
    """Raise ScenarioError if a file would be overwritten that no sweep of this folder wrote."""
    if (out / JOURNAL).exists():
        return
    for name in (CELLS, RUNS, TWIN, HEAT_MAP, SEEDS, *PARQUET):
        if (out / name).exists():
            raise ScenarioError([f"{out / name}: exists; give another folder by --out"])


def _complete(
    plan: SweepPlan,
    journal: RunJournal,
    fleet: Callable[[], AbstractContextManager[Fleet]],
    say: Callable[[str], None],
) -> None:
    """Do the runs of which the journal has nothing yet."""
    known = {key for key, entry in journal.entries.items() if not entry.get(GIVEN_UP)}
    left = {key: job for key, job in plan.jobs().items() if key not in known}
    if known:
        say(f"{len(known)} of {plan.runs} runs are there already, {len(left)} are left")
    if not left:
        return
    countdown = Countdown(plan.runs, len(known), say)
    with fleet() as workers:
        for outcome in JobDriver(left, workers).outcomes():
            journal.add(outcome.key, _entry(outcome))
            countdown.one_more()


def _entry(outcome: Outcome[str]) -> Entry:
    if not outcome.error:
        entry: Entry = outcome.result
        return entry
    return {"error": outcome.error} | ({GIVEN_UP: True} if outcome.is_given_up else {})
