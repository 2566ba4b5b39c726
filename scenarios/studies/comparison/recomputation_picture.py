"""Recorded and recomputed decisions of a vehicle in Rerun."""

from collections.abc import Callable
from zlib import crc32

from scenarios.studies.comparison.recomputation import PLOTTED, Recomputation
from transport.picture.option import RerunOption
from transport.picture.view import OpenRecording

GREY, BLUE = (150, 150, 150), (0, 114, 178)


def show_recomputation(
    result: Recomputation, option: RerunOption, *, wait: Callable[[str], None]
) -> None:
    """Draw both decisions and their difference into a recording; raises ViewerError.

    A served picture is shown until `wait`, called with its address, returns.
    """
    subject = " ".join((str(result.log.resolve()), result.vehicle, *result.settings))
    identifier = f"recompute-{crc32(subject.encode()):08x}"
    with OpenRecording(option, identifier, result.sentence) as picture:
        if not picture.enabled:
            return
        from transport.picture.comparison.plots import draw_plots  # noqa: PLC0415 - an extra

        plots = {}
        for field, label, factor in PLOTTED:
            if field in result.recorded:
                before, after = factor * result.recorded[field], factor * result.recomputed[field]
                curves = {"recorded": before, "recomputed": after}
                plots[field] = f"{result.vehicle}: {label}", curves
                difference = {"difference": after - before}
                plots[f"{field}_difference"] = (
                    f"{result.vehicle}: recomputed minus recorded {label}",
                    difference,
                )
        draw_plots(picture.recording, result.at_s, plots, (GREY, BLUE))
        if option.sink == "serve":
            wait(picture.destination)
