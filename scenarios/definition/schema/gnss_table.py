"""The table of a GNSS receiver, completed by its preset."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, model_validator

from scenarios.definition.schema.plug_ins.emission import RECEIVER_ERROR
from scenarios.definition.schema.plug_ins.table import plug_in
from scenarios.definition.schema.settings_table import SettingsTable, keys_with, one_of
from vehicles.car.positioning.error_term import ErrorTerm
from vehicles.car.positioning.gnss_settings import (
    ERRORS,
    PRESET_OF_STATE,
    PRESETS,
    GnssSettings,
    StateErrors,
)

if TYPE_CHECKING:
    ErrorPlugIn = SettingsTable[ErrorTerm]
else:
    ErrorPlugIn = plug_in(RECEIVER_ERROR, one_of(ERRORS))


class GnssTable(SettingsTable[GnssSettings]):
    """The emulated GNSS receiver. Its keys replace the values of a `preset`."""

    errors: Annotated[tuple[ErrorPlugIn, ...], Field(strict=False)] = ()

    @model_validator(mode="before")
    @classmethod
    def _lay_presets_under(cls, given: Any) -> Any:
        """Fill in the preset's values of keys that are not given."""
        if not isinstance(given, dict):
            return given
        under = [figures for preset, figures in PRESETS.items() if preset == given.get("preset")]
        whole = _laid_over(keys_with(GnssSettings, under[0]) if under else {}, given)
        for state, usual in PRESET_OF_STATE.items():
            key = f"while_{state}"
            if isinstance(whole.get(key), dict):
                figures = {one: value for one, value in PRESETS[usual].items() if one != "fix"}
                whole[key] = _laid_over(keys_with(StateErrors, figures), whole[key])
        return whole


def _laid_over(under: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Merge two tables and the tables inside them; `given` keys win."""
    whole = {**under, **given}
    for key, value in under.items():
        if isinstance(value, dict) and isinstance(given.get(key), dict):
            whole[key] = {**value, **given[key]}
    return whole
