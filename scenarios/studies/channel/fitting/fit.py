"""`convoy channel fit`: fit the links of a log and write them as a TOML block."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from scenarios.results.log_summary import PARTIAL
from scenarios.studies.channel.fitting.estimate import Estimate
from scenarios.studies.channel.fitting.fit_delay import fit_delay
from scenarios.studies.channel.fitting.fit_loss import fit_losses
from scenarios.studies.channel.fitting.recorded import RecordedLink, recorded_links
from transport.log.reader import LogReader

USED = ("gps", "verdict", "truth", "start")
"""Topics that the fit reads."""


@dataclass(frozen=True, slots=True)
class FittedLink:
    sender: str
    receiver: str
    messages: int
    keys: dict[str, Any]
    estimates: tuple[Estimate, ...]
    delay: str
    notes: tuple[str, ...] = ()
    log_faults: str = ""
    """Damage and holes of the log in one line: messages without a verdict are not fitted."""

    @property
    def entry(self) -> dict[str, Any]:
        return {"sender": self.sender, "receiver": self.receiver, **self.keys}


def fit_link(link: RecordedLink, log_faults: str = "") -> FittedLink:
    loss_keys, estimates, notes = fit_losses(link)
    delivered = link.delivered
    chosen = delivered if delivered.any() else ~delivered
    delay = fit_delay(link.number[chosen], link.sent_at_s[chosen], link.delay_ms[chosen])
    return FittedLink(
        sender=link.sender,
        receiver=link.receiver,
        messages=len(link.number),
        keys={**loss_keys, **delay.keys},
        estimates=(*estimates, *delay.estimates),
        delay=delay.description,
        notes=tuple(notes),
        log_faults=log_faults,
    )


def fit_log(log: Path, *, partial: bool = False) -> tuple[FittedLink, ...]:
    """Fit the laws of each link of a log; raises LogError.

    A damaged or incomplete log is refused unless `partial`: messages that it lacks are left out.
    """
    reader = LogReader(log)
    if not partial:
        reader.refuse_faults(*USED, remedy=PARTIAL)
    links, faults = recorded_links(log), reader.faults_in(USED)
    return tuple(fit_link(link, faults) for link in links)


def as_toml(links: tuple[FittedLink, ...]) -> str:
    blocks = [
        f"# {faults}" for faults in dict.fromkeys(link.log_faults for link in links) if faults
    ]
    for link in links:
        head = f"# {link.sender} → {link.receiver}, {link.messages} messages; 95 % intervals:"
        lines = [head, *(f"#   {line}" for line in (*link.estimates, *link.notes))]
        # tomli_w would write a short list of tables inline, as `link = [{…}]`.
        entry = tomli_w.dumps({"link": link.entry}).replace("[link]", "[[link]]", 1)
        blocks.append("\n".join([*lines, entry.rstrip()]))
    return "\n\n".join(blocks) + "\n"
