"""carved as a SiLA 2 server: `python -m carved_client.integrations.sila --carved http://127.0.0.1:8420`.

SiLA client ──gRPC──> connector ──HTTP──> carved
                        ├─ PlateMeasurement   MeasurePlate (observable), GetResults
                        ├─ RunControl         hold, resume, stop, abort, emergency stop, acknowledge
                        ├─ InstrumentStatus   Status (observable)
                        └─ PlateHandover      when an arm may move the plate

The feature definitions are the `.sila.xml` files beside this module. `features.py` has their implementations.
"""

from .connector import connector

__all__ = ["connector"]
