"""Validates examples/biomero/descriptor.json by BIOMERO's own model, and compares it with the program that it describes.

    validate_biomero.py FOLDER VERSION
"""

import json
import re
import sys
from pathlib import Path

from biomero_schema.models import BIOMERO_SCHEMA_VERSION, WorkflowSchema

folder, version = Path(sys.argv[1]), sys.argv[2]
document = json.loads((folder / "descriptor.json").read_text())
workflow = WorkflowSchema.model_validate(document)
assert workflow.schema_version == BIOMERO_SCHEMA_VERSION, workflow.schema_version
# Nothing that the model would ignore.
kept = workflow.model_dump(by_alias=True, exclude_none=True, exclude_computed_fields=True)
assert set(document) <= set(kept), set(document) - set(kept)
for key in ("inputs", "outputs"):
    for entry, read in zip(document[key], kept[key], strict=True):
        assert entry.items() <= read.items(), (entry, read)
program = (folder / "measure").read_text()
for entry in workflow.inputs:
    flag = entry.command_line_flag.replace("@id", entry.id)
    assert f"{flag})" in program, flag
for entry in workflow.outputs:
    assert f"$out/{entry.id}.{entry.format}" in program, entry.id
image = workflow.container_image.image
for recipe in ("Dockerfile", "carved.def"):
    text = (folder / recipe).read_text()
    assert image in text and set(re.findall(r"\d+\.\d+\.\d+", text)) == {version}, recipe
print("read")
