"""Holds study files against the models of the BioImage Archive (bia-rembi-models).

    validate_rembi.py IMPORTED TAKEN

What a model misses must be named in `to_fill_in`, and nothing else. With these places filled in, the file is valid.
"""

import json
import sys

from bia_rembi_models import _version
from bia_rembi_models.acquisition import ImageAcquisition
from bia_rembi_models.analysis import ImageAnalysis
from bia_rembi_models.sample import Biosample
from bia_rembi_models.specimen import Specimen
from bia_rembi_models.study import Study
from bia_rembi_models.study_component import StudyComponent
from pydantic import ValidationError

MODELS = {
    "study": Study,
    "study_components": StudyComponent,
    "biosamples": Biosample,
    "specimens": Specimen,
    "image_acquisitions": ImageAcquisition,
    "image_analyses": ImageAnalysis,
}

# What a person would write, also into the places that may stay empty.
PERSON = {
    "title": "Morphology of larvae under Wnt inhibition",
    "description": "Larvae of one clutch were treated and measured.",
    "private_until_date": "2027-01-31",
    "authors": [{"last_name": "Kim", "first_name": "A", "affiliation": {"name": "EBI", "address": "Hinxton"}}],
    "license": {"name": "CC0", "url": "https://example.com/cc_0"},
    "funding": {"funding_statement": "none"},
    "publications": [{"title": "in preparation"}],
    "links": [{"link_url": "https://example.com"}],
    "sample_preparation": "Tricaine in E3",
    "growth_protocol": "28 degrees",
    "imaging_instrument": "another microscope",
}


def items(document):
    for group, model in MODELS.items():
        found = document[group]
        for number, item in enumerate(found) if isinstance(found, list) else [("", found)]:
            yield f"{group}.{number}".rstrip("."), model, item


def missing(document):
    """Places that the models miss. An unknown key, which pydantic would ignore, fails."""
    places = set()
    for place, model, item in items(document):
        assert set(item) <= set(model.__fields__), (place, set(item) - set(model.__fields__))
        try:
            model.parse_obj(item)
        except ValidationError as error:
            for problem in error.errors():
                assert problem["type"] == "value_error.missing", (place, problem)
                places.add(".".join([place, *map(str, problem["loc"])]))
    return places


def check(file):
    document = json.load(open(file))
    assert set(document) == {*MODELS, "to_fill_in"}
    named = document["to_fill_in"]
    assert missing(document) == {entry["at"] for entry in named if entry["required"]}, missing(document)
    found = {place: item for place, _, item in items(document)}
    for entry in named:
        place, key = entry["at"].rsplit(".", 1)
        assert key not in found[place], entry
        found[place][key] = PERSON[key]
    assert missing(document) == set()
    return document, {entry["at"] for entry in named}


imported, named = check(sys.argv[1])
taken, named_of_taken = check(sys.argv[2])
assert named - named_of_taken == {"image_acquisitions.0.imaging_instrument"} and named_of_taken < named
for document in (imported, taken):
    (sample,) = document["biosamples"]
    assert sample["organism"]["ncbi_taxon"] == "http://purl.obolibrary.org/obo/NCBITaxon_7955"
    assert sample["biological_entity"] == "whole zebrafish larva, 5 dpf", sample
    assert sample["extrinsic_variables"] == ["DMSO <\u00b5> & co (negative control)"], sample
    (acquisition,) = document["image_acquisitions"]
    assert acquisition["image_acquisition_parameters"].startswith("12 views over one turn"), acquisition
    (component,) = document["study_components"]
    assert (component["name"], component["rembi_version"]) == ("P-017", _version)
    assert component["description"].startswith("Views of zebrafish larvae (1) and beads (1) of plate P-017"), component
    (analysis,) = document["image_analyses"]
    assert "segmentation" in analysis["analysis_overview"]
print("read")
