"""The types of this package agree with the contract. No daemon is needed, because it serves `docs/openapi.json`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import pytest
from contract import Contract, aliases_of, classes_of

from carved_client import PlannedWell, RunPlan, errors, models, plan

FILE = Path(__file__).resolve().parents[3] / "docs" / "openapi.json"
REQUESTS = (RunPlan, PlannedWell)
#: A marker in the stream of events. The contract describes only the events.
NOT_A_SCHEMA = (models.Resync,)


def document() -> dict[str, Any]:
    parsed: dict[str, Any] = json.loads(FILE.read_text(encoding="utf-8"))
    return parsed


def differences(document: dict[str, Any]) -> list[str]:
    contract = Contract(document)
    classes = [cls for cls in classes_of(models, plan, errors) if cls not in NOT_A_SCHEMA]
    assert len(classes) > 15
    found: list[Iterator[str]] = [contract.alias(name, alias) for name, alias in aliases_of(models).items()]
    found += [contract.request(cls) if cls in REQUESTS else contract.answer(cls) for cls in classes]
    # The answer to a command that belongs to no run has no run.
    found.append(contract.answer(models.Acknowledged, "Noted"))
    return list(chain.from_iterable(found))


def test_the_types_of_this_package_are_those_of_the_contract() -> None:
    found = differences(document())
    assert not found, "\n".join(found)


Schemas = dict[str, Any]


def _type(schemas: Schemas) -> None:
    schemas["WellStatus"]["properties"]["volume_um3"]["type"] = ["string", "null"]


def _item_type(schemas: Schemas) -> None:
    schemas["PlateMap"]["properties"]["notes"]["items"] = {"type": "integer"}


def _integer_becomes_fraction(schemas: Schemas) -> None:
    schemas["Status"]["properties"]["revision"]["type"] = "number"


def _new_state(schemas: Schemas) -> None:
    schemas["State"]["enum"].append("Sleeping")


def _state_removed(schemas: Schemas) -> None:
    schemas["State"]["enum"].remove("Held")


def _enum_renamed(schemas: Schemas) -> None:
    schemas["Stage"] = schemas.pop("Phase")
    schemas["SpecimenStatus"]["properties"]["phase"]["$ref"] = "#/components/schemas/Stage"


def _text_becomes_enum(schemas: Schemas) -> None:
    schemas["Fault"]["properties"]["category"] = {"$ref": "#/components/schemas/Category"}


def _field_renamed(schemas: Schemas) -> None:
    schemas["Plate"]["properties"]["at_place"] = schemas["Plate"]["properties"].pop("present")


def _new_field(schemas: Schemas) -> None:
    schemas["WellStatus"]["properties"]["length_um"] = {"type": ["number", "null"]}


def _becomes_nullable(schemas: Schemas) -> None:
    schemas["RunStatus"]["properties"]["started"]["type"] = ["string", "null"]


def _reference_becomes_nullable(schemas: Schemas) -> None:
    reference = schemas["Status"]["properties"]["plate"]
    schemas["Status"]["properties"]["plate"] = {"oneOf": [reference, {"type": "null"}]}


def _is_never_null_any_more(schemas: Schemas) -> None:
    schemas["Plate"]["properties"]["barcode"]["type"] = "string"


def _may_be_missing(schemas: Schemas) -> None:
    schemas["Status"]["required"].remove("doing")


def _plan_has_another_field(schemas: Schemas) -> None:
    schemas["PlannedWell"]["properties"]["stage"] = {"type": ["string", "null"]}


def _plan_demands_more(schemas: Schemas) -> None:
    schemas["RunPlan"]["required"].append("external_id")


CHANGES = [
    *(_type, _item_type, _integer_becomes_fraction, _new_state, _state_removed, _enum_renamed, _text_becomes_enum),
    *(_field_renamed, _becomes_nullable, _reference_becomes_nullable, _is_never_null_any_more, _may_be_missing),
    *(_new_field, _plan_has_another_field, _plan_demands_more),
]


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__.strip("_"))
def test_a_change_of_the_contract_that_the_package_does_not_follow_is_found(change: Callable[[Schemas], None]) -> None:
    changed = document()
    change(changed["components"]["schemas"])
    assert differences(changed) != []
