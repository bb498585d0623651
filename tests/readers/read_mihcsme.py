"""Reads the MIHCSME JSON of carved with mihcsme-py, makes the spreadsheet of it and reads that again.

    read_mihcsme.py FILE.json OUT.json
"""

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from mihcsme_py import MIHCSMEMetadata, parse_excel_to_model, write_metadata_to_excel

source, out = map(Path, sys.argv[1:])
written = json.loads(source.read_text())
model = MIHCSMEMetadata.model_validate(written)
with TemporaryDirectory() as folder:
    sheet = Path(folder) / "plate.xlsx"
    write_metadata_to_excel(model, sheet)
    back = parse_excel_to_model(sheet)
wells = {c.well: c.conditions for c in back.assay_conditions}
assert wells == {c["well"]: c["conditions"] for c in written["assay_conditions"]}, wells
assert back.to_omero_dict() == model.to_omero_dict()
out.write_text(back.model_dump_json())
print(json.dumps(back.to_omero_dict()["StudyInformation"]))
